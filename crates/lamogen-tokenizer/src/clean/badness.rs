//! Recognition of text that was decoded in the wrong encoding.
//!
//! The classes and rules are those of ftfy 6.3.1 (`badness.py`, `chardata.py`). The author of ftfy collected them from
//! years of broken text.

use std::ops::Range;
use std::sync::LazyLock;

use regex::Regex;

/// The classes of characters that appear in broken text, each as the content of a bracket expression.
const CLASSES: [(&str, &str); 13] = [
    // Characters that are common in good text too.
    ("common", r"\u{a0}\u{ad}´·\u{2013}-\u{2015}’…"),
    ("c1", r"\x80-\x9f"),
    // Characters that are rare in good text.
    ("bad", "¤¦¨ª¬¯¸ºƒˆˇ˘˛˜†‡‰⌐◊\u{fffd}"),
    ("law", "§¶"),
    ("currency", "¢£¥₧€"),
    ("start", "¡©«¿΄΅‘‚“„•‹\u{f8ff}"),
    ("end", "®»˝”›™"),
    ("numeric", "±-³µ¹¼-¾×÷⁄№∂∆∏∑√∞∩∫≈≠≡≤≥"),
    // Characters of kaomoji, faces that are made of letters.
    ("kaomoji", "°Ò-ÖÙ-Üò-öø-üŌŐŪŲ"),
    (
        "upper_accented",
        "À-ÑØÜÝĀĂĄĆČĎĐĒĖĘĚĞĢĪİĶĹĻĽŁŃŅŇŒŘŚŞŠŢŤŮŰŸŹŻŽҐ",
    ),
    ("lower_accented", "ß-ñüāăąćčďđēėęěğģīįķĺļľłœŕśşšťźżžґﬁﬂ"),
    ("upper_common", "ÞΆΈ-ΊΌΎΏΑ-ΫЁ-Я"),
    ("lower_common", "ά-ωа-џ"),
];

/// Box-drawing characters, without the line that is used in kaomoji.
const BOX: &str = "│┌┐┘├┤┬┼═-╬▀▄█▌▐-▓";

/// The sequences of characters that do not occur in good text. A name in braces stands for its class.
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
    // Windows-1252: two characters.
    r"[ÂÃÎÐ][€œŠš¢£Ÿž\u{a0}\u{ad}®©°·»{start}{end}–—´]",
    "×[²³]",
    // Arabic: four characters, because shorter sequences are common in good text.
    "(?:[ØÙ][{common}{currency}{bad}{numeric}{start}ŸŠ®°µ»]){2}",
    // South Asian scripts.
    "à[²µ¹¼½¾]",
    // MacRoman.
    "√[±∂†≠®™´≤≥¥µø]",
    "≈[°¢]",
    "‚Ä[ìîïòôúùû†°¢π]",
    "‚[âó][àä°ê]",
    // Windows-1251: punctuation; at least two Cyrillic characters; three layers of wrong decoding.
    "вЂ",
    "[ВГРС][{c1}{bad}{start}{end}{currency}°µ][ВГРС]",
    "ГўВЂВ.[A-Za-z ]",
    // The letters à and á, and the no-break space.
    r"Ã[\u{a0}¡]",
    r"[a-z][\s\x1c-\x1f]?[ÃÂ] ",
    "^[ÃÂ] ",
    "[a-z.,?!{end}]Â[ {start}{end}]",
    // Windows-1253: punctuation; at least two Greek characters.
    r"β€[™\u{a0}Ά\u{ad}®°]",
    "[ΒΓΞΟ][{c1}{bad}{start}{end}{currency}°][ΒΓΞΟ]",
    // Windows-1257.
    "ā€",
];

static BAD_SEQUENCE: LazyLock<Regex> = LazyLock::new(|| {
    let mut rules = RULES.join("|").replace("{box}", BOX);
    for (name, class) in CLASSES {
        rules = rules.replace(&format!("{{{name}}}"), class);
    }
    Regex::new(&rules).expect("the rules are constant")
});

/// Returns whether the text has a sequence of characters that does not occur in good text.
pub(super) fn is_bad(text: &str) -> bool {
    BAD_SEQUENCE.is_match(text)
}

/// The characters that bytes C2 to DF stand for in any of the encodings. These bytes start a sequence of two bytes in
/// UTF-8.
const LEAD_OF_2: &str = "Â-ßĀĂĆČĎĐĒĖĘĚĞĢĪİĶĹĻŁŃŅŇŌŐŘŚŞŠŢŪŮŰŲŹŻŽΒ-ΡΣ-ίВ-Я";

/// The characters of bytes E0 to EF, which start a sequence of three bytes.
const LEAD_OF_3: &str = "à-ïāăąćčďēėęěģīįķĺļŕźΰ-οа-п";

/// The characters of bytes F0 and F3, which are the only bytes that start a sequence of four bytes for a character in use.
const LEAD_OF_4: &str = "ðóđğšπσру";

/// The characters of bytes 80 to BF, which continue a sequence in UTF-8.
const CONTINUATION: &str = r"\x80-¿ÆØæøĄąĽľŁłŒœŖŗŚśŞ-šŤťŸ-žƒˆˇ˘˛-˝΄-ΆΈ-ΊΌΎΏЁ-ЌЎЏё-ќўџҐґ†‡‰‹›€№™";

/// Other characters of bytes 80 to BF: a space for A0, and punctuation that is common in good text too.
const COMMON_CONTINUATION: &str = r" \u{2013}-\u{2015}‘-‚“-„•…";

static UTF8_LOOKALIKE: LazyLock<Regex> = LazyLock::new(|| {
    let next = format!("[{CONTINUATION}{COMMON_CONTINUATION}]");
    let sequences =
        format!("(?:[{LEAD_OF_2}]{next}|[{LEAD_OF_3}]{next}{{2}}|[{LEAD_OF_4}]{next}{{3}})+");
    Regex::new(&sequences).expect("the classes are constant")
});

static STARTS_WITH_CONTINUATION: LazyLock<Regex> =
    LazyLock::new(|| Regex::new(&format!("^[{CONTINUATION}]")).expect("the class is constant"));

/// Returns the ranges of sequences that look like UTF-8 read in another encoding, except those in the middle of a longer
/// broken sequence.
pub(super) fn utf8_lookalikes(text: &str) -> Vec<Range<usize>> {
    let mut found = Vec::new();
    let mut from = 0;
    while let Some(sequence) = UTF8_LOOKALIKE.find_at(text, from) {
        let before = text[..sequence.start()].char_indices().next_back();
        if before.is_some_and(|(index, _)| STARTS_WITH_CONTINUATION.is_match(&text[index..])) {
            let first = sequence.as_str().chars().next();
            from = sequence.start() + first.map_or(1, char::len_utf8);
        } else {
            from = sequence.end();
            found.push(sequence.range());
        }
    }
    found
}
