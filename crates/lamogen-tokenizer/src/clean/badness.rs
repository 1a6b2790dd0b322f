//! What text looks like that was decoded in the wrong encoding.
//!
//! Classes and rules are those of ftfy 6.3.1 (`badness.py`, `chardata.py`), whose author collected
//! them from years of broken text.

use std::ops::Range;
use std::sync::LazyLock;

use regex::Regex;

/// Classes of characters that appear in broken text, as they are written between brackets.
const CLASSES: [(&str, &str); 13] = [
    // In many other places too.
    ("common", r"\u{a0}\u{ad}´·\u{2013}-\u{2015}’…"),
    ("c1", r"\x80-\x9f"),
    // Hardly anywhere else.
    ("bad", "¤¦¨ª¬¯¸ºƒˆˇ˘˛˜†‡‰⌐◊\u{fffd}"),
    ("law", "§¶"),
    ("currency", "¢£¥₧€"),
    ("start", "¡©«¿΄΅‘‚“„•‹\u{f8ff}"),
    ("end", "®»˝”›™"),
    ("numeric", "±-³µ¹¼-¾×÷⁄№∂∆∏∑√∞∩∫≈≠≡≤≥"),
    // Parts of faces made of letters.
    ("kaomoji", "°Ò-ÖÙ-Üò-öø-üŌŐŪŲ"),
    (
        "upper_accented",
        "À-ÑØÜÝĀĂĄĆČĎĐĒĖĘĚĞĢĪİĶĹĻĽŁŃŅŇŒŘŚŞŠŢŤŮŰŸŹŻŽҐ",
    ),
    ("lower_accented", "ß-ñüāăąćčďđēėęěğģīįķĺļľłœŕśşšťźżžґﬁﬂ"),
    ("upper_common", "ÞΆΈ-ΊΌΎΏΑ-ΫЁ-Я"),
    ("lower_common", "ά-ωа-џ"),
];

/// Box drawings, without the line that faces are made of.
const BOX: &str = "│┌┐┘├┤┬┼═-╬▀▄█▌▐-▓";

/// Sequences of characters that good text does not have. A name in braces stands for its class.
const RULES: &[&str] = &[
    "[{c1}]",
    "[{bad}{lower_accented}{upper_accented}{box}{start}{end}{currency}{numeric}{law}][{bad}]",
    "[a-zA-Z][{lower_common}{upper_common}][{bad}]",
    "[{bad}][{lower_accented}{upper_accented}{box}{start}{end}{currency}{numeric}{law}]",
    "[{lower_accented}{lower_common}{box}{end}{currency}{numeric}][{upper_accented}]",
    "[{box}{end}{currency}{numeric}][{lower_accented}]",
    "[{lower_accented}{box}{end}][{currency}]",
    r"[\s\x1c-\x1f][{upper_accented}][{currency}]",
    "[{upper_accented}{box}][{numeric}{law}]",
    "[{lower_accented}{upper_accented}{box}{currency}{end}][{start}][{numeric}]",
    "[{lower_accented}{upper_accented}{currency}{numeric}{box}{law}][{end}][{start}]",
    "[{currency}{numeric}{box}][{start}]",
    "[a-z][{upper_accented}][{start}{currency}]",
    "[{box}][{kaomoji}]",
    "[{lower_accented}{upper_accented}{currency}{numeric}{start}{end}{law}][{box}]",
    "[{box}][{end}]",
    r"[{lower_accented}{upper_accented}][{start}{end}][\p{L}\p{N}_]",
    "[Œœ][^A-Za-z]",
    "[{upper_accented}]°",
    // Two characters of Windows-1252.
    r"[ÂÃÎÐ][€œŠš¢£Ÿž\u{a0}\u{ad}®©°·»{start}{end}–—´]",
    "×[²³]",
    // Arabic: four characters, for these are common ones.
    "(?:[ØÙ][{common}{currency}{bad}{numeric}{start}ŸŠ®°µ»]){2}",
    // South Asian alphabets.
    "à[²µ¹¼½¾]",
    // MacRoman.
    "√[±∂†≠®™´≤≥¥µø]",
    "≈[°¢]",
    "‚Ä[ìîïòôúùû†°¢π]",
    "‚[âó][àä°ê]",
    // Windows-1251: punctuation; two Cyrillic characters or more; three layers of decoding.
    "вЂ",
    "[ВГРС][{c1}{bad}{start}{end}{currency}°µ][ВГРС]",
    "ГўВЂВ.[A-Za-z ]",
    // à, á, and the space that does not break.
    r"Ã[\u{a0}¡]",
    r"[a-z][\s\x1c-\x1f]?[ÃÂ] ",
    "^[ÃÂ] ",
    "[a-z.,?!{end}]Â[ {start}{end}]",
    // Windows-1253: punctuation; two Greek characters or more.
    r"β€[™\u{a0}Ά\u{ad}®°]",
    "[ΒΓΞΟ][{c1}{bad}{start}{end}{currency}°][ΒΓΞΟ]",
    // Windows-1257.
    "ā€",
];

static BAD: LazyLock<Regex> = LazyLock::new(|| {
    let mut rules = RULES.join("|").replace("{box}", BOX);
    for (name, class) in CLASSES {
        rules = rules.replace(&format!("{{{name}}}"), class);
    }
    Regex::new(&rules).expect("the rules are constant")
});

/// Whether the text has a sequence of characters that good text does not have.
pub(super) fn is_bad(text: &str) -> bool {
    BAD.is_match(text)
}

/// Characters of bytes C2 to DF, with which UTF-8 begins two bytes, in any of the encodings.
const FIRST_OF_2: &str = "Â-ßĀĂĆČĎĐĒĖĘĚĞĢĪİĶĹĻŁŃŅŇŌŐŘŚŞŠŢŪŮŰŲŹŻŽΒ-ΡΣ-ίВ-Я";

/// Of bytes E0 to EF.
const FIRST_OF_3: &str = "à-ïāăąćčďēėęěģīįķĺļŕźΰ-οа-п";

/// Of bytes F0 and F3, the only ones that characters in use begin with.
const FIRST_OF_4: &str = "ðóđğšπσру";

/// Of bytes 80 to BF, with which UTF-8 goes on.
const NEXT: &str = r"\x80-¿ÆØæøĄąĽľŁłŒœŖŗŚśŞ-šŤťŸ-žƒˆˇ˘˛-˝΄-ΆΈ-ΊΌΎΏЁ-ЌЎЏё-ќўџҐґ†‡‰‹›€№™";

/// Of the same bytes: a space for A0, and punctuation that good text has too.
const NEXT_OR_COMMON: &str = r" \u{2013}-\u{2015}‘-‚“-„•…";

static LOOKALIKE: LazyLock<Regex> = LazyLock::new(|| {
    let next = format!("[{NEXT}{NEXT_OR_COMMON}]");
    let sequences =
        format!("(?:[{FIRST_OF_2}]{next}|[{FIRST_OF_3}]{next}{{2}}|[{FIRST_OF_4}]{next}{{3}})+");
    Regex::new(&sequences).expect("the classes are constant")
});

static BEGINS_WITH_NEXT: LazyLock<Regex> =
    LazyLock::new(|| Regex::new(&format!("^[{NEXT}]")).expect("the class is constant"));

/// Where sequences stand that look like UTF-8, but not in the middle of a longer garble.
pub(super) fn utf8_lookalikes(text: &str) -> Vec<Range<usize>> {
    let mut found = Vec::new();
    let mut from = 0;
    while let Some(sequence) = LOOKALIKE.find_at(text, from) {
        let before = text[..sequence.start()].char_indices().next_back();
        if before.is_some_and(|(at, _)| BEGINS_WITH_NEXT.is_match(&text[at..])) {
            let first = sequence.as_str().chars().next();
            from = sequence.start() + first.map_or(1, char::len_utf8);
        } else {
            from = sequence.end();
            found.push(sequence.range());
        }
    }
    found
}
