//! Repair of broken text, as ftfy's `fix_text` does it with its default options.

use std::borrow::Cow;
use std::sync::LazyLock;

use regex::{Captures, Regex};
use unicode_normalization::UnicodeNormalization;

use super::{charmap, html, mojibake};

/// Repairs a text line by line.
pub(super) fn fix_text(text: &str) -> String {
    // From the first line with "<" on, the text is treated as HTML and keeps its character references.
    let mut is_html = false;
    text.split_inclusive('\n')
        .map(|line| {
            is_html |= line.contains('<');
            fix_line(line, is_html)
        })
        .collect()
}

/// Repairs a line until a repair changes nothing.
fn fix_line(line: &str, is_html: bool) -> String {
    let mut text = line.to_owned();
    loop {
        let mut fixed = text.clone();
        if !is_html {
            fixed = unescape(&fixed).into_owned();
        }
        fixed = mojibake::fix_encoding(&fixed);
        fixed = fixed.chars().map(charmap::fix_c1).collect();
        fixed = split_ligatures(&fixed);
        fixed = fix_width(&fixed);
        fixed = fixed.chars().map(straighten_quote).collect();
        fixed = fix_line_breaks(&fixed);
        fixed = TERMINAL_ESCAPE.replace_all(&fixed, "").into_owned();
        fixed.retain(|character| !is_control(character));
        fixed = fixed.nfc().collect();
        if fixed == text {
            return text;
        }
        text = fixed;
    }
}

static REFERENCE: LazyLock<Regex> =
    LazyLock::new(|| Regex::new("&#?[0-9A-Za-z]{1,24};").expect("the pattern is constant"));

static TERMINAL_ESCAPE: LazyLock<Regex> =
    LazyLock::new(|| Regex::new(r"\x1b\[[\d;]*[a-zA-Z]").expect("the pattern is constant"));

/// Expands complete character references, and also names of letters that were converted to upper case: `&EACUTE;`
/// becomes É.
fn unescape(text: &str) -> Cow<'_, str> {
    REFERENCE.replace_all(text, |found: &Captures| {
        let reference = &found[0];
        if let Some(expansion) = html::expand_named(reference) {
            return expansion.to_owned();
        }
        let unescaped = html::unescape(reference);
        if reference.starts_with("&#") {
            let complete = !unescaped.contains(';');
            return if complete {
                unescaped.into_owned()
            } else {
                reference.to_owned()
            };
        }
        let is_upper = !reference.contains(|character: char| character.is_ascii_lowercase());
        match html::expand_named(&reference.to_ascii_lowercase()) {
            Some(expansion) if is_upper && unescaped == reference => expansion.to_uppercase(),
            _ => reference.to_owned(),
        }
    })
}

/// Replaces ligatures and digraphs of Latin letters by their separate letters.
fn split_ligatures(text: &str) -> String {
    let mut split = String::with_capacity(text.len());
    for character in text.chars() {
        split.push_str(match character {
            'Ĳ' => "IJ",
            'ĳ' => "ij",
            'ŉ' => "ʼn",
            'Ǳ' => "DZ",
            'ǲ' => "Dz",
            'ǳ' => "dz",
            'Ǆ' => "DŽ",
            'ǅ' => "Dž",
            'ǆ' => "dž",
            'Ǉ' => "LJ",
            'ǈ' => "Lj",
            'ǉ' => "lj",
            'Ǌ' => "NJ",
            'ǋ' => "Nj",
            'ǌ' => "nj",
            'ﬀ' => "ff",
            'ﬁ' => "fi",
            'ﬂ' => "fl",
            'ﬃ' => "ffi",
            'ﬄ' => "ffl",
            'ﬅ' => "ſt",
            'ﬆ' => "st",
            other => {
                split.push(other);
                continue;
            }
        });
    }
    split
}

/// Replaces full-width and half-width forms by the ordinary characters.
fn fix_width(text: &str) -> String {
    let mut fixed = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '\u{3000}' => fixed.push(' '),
            '\u{ff01}'..='\u{ffef}' => fixed.extend([character].into_iter().nfkc()),
            other => fixed.push(other),
        }
    }
    fixed
}

/// Replaces a curly quotation mark by a straight one.
fn straighten_quote(character: char) -> char {
    match character {
        '\u{2bc}' | '‘'..='‛' => '\'',
        '“'..='‟' => '"',
        other => other,
    }
}

/// Replaces all line breaks by `\n`.
fn fix_line_breaks(text: &str) -> String {
    text.replace("\r\n", "\n")
        .replace(['\r', '\u{85}', '\u{2028}', '\u{2029}'], "\n")
}

/// Returns whether a character is a control character that is invisible and has no use in text.
fn is_control(character: char) -> bool {
    matches!(
        character,
        '\0'..='\x08'
            | '\x0b'
            | '\x0e'..='\x1f'
            | '\x7f'
            | '\u{206a}'..='\u{206f}'
            | '\u{feff}'
            | '\u{fff9}'..='\u{fffc}'
    )
}
