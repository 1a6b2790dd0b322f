//! UTF-8 that was read in another encoding, read once more.

use std::sync::LazyLock;

use regex::bytes;

use super::badness::{is_bad, utf8_lookalikes};
use super::charmap::{self, CHARMAPS, Charmap};

/// Undoes every layer of wrong decoding that is found.
pub(super) fn fix_encoding(text: &str) -> String {
    let mut text = text.to_owned();
    loop {
        match fix_layer(&text) {
            Some(fixed) if fixed != text => text = fixed,
            _ => return text,
        }
    }
}

/// Undoes one layer, if the text looks as if it had one.
fn fix_layer(text: &str) -> Option<String> {
    if text.is_ascii() || !is_bad(text) {
        return None;
    }
    let reread = |charmap| read_again(text, charmap);
    if let Some(fixed) = CHARMAPS.iter().find_map(reread) {
        return Some(fixed);
    }
    let fixed = fix_parts(text);
    if fixed != text {
        return Some(fixed);
    }
    Some(text.chars().map(charmap::fix_c1).collect())
}

/// The text's bytes in that encoding as UTF-8, if the encoding has the text and they are UTF-8.
fn read_again(text: &str, charmap: &Charmap) -> Option<String> {
    let mut bytes = charmap.encode(text)?;
    if charmap.restores_spaces {
        bytes = restore_spaces(&bytes);
    }
    if charmap.is_lossy {
        bytes = LOST.replace_all(&bytes, "\u{fffd}".as_bytes()).into_owned();
    }
    decode(&bytes)
}

/// Fixes the parts of the text that look like UTF-8 read in another encoding, each on its own.
fn fix_parts(text: &str) -> String {
    let mut fixed = String::with_capacity(text.len());
    let mut done = 0;
    for part in utf8_lookalikes(text) {
        fixed.push_str(&text[done..part.start]);
        done = part.end;
        let part = &text[part];
        // The whole text would come here again.
        if part.len() < text.len() && is_bad(part) {
            fixed.push_str(&fix_encoding(part));
        } else {
            fixed.push_str(part);
        }
    }
    fixed + &text[done..]
}

/// Sequences of UTF-8 in which byte A0, a space that does not break, became a space. Sequences for
/// unlikely characters are left out.
static SPACED: LazyLock<bytes::Regex> = LazyLock::new(|| {
    pattern(&[
        r"[\xc2\xc3\xc5\xce\xd0\xd9]\x20",
        r"[\xe2\xe3]\x20[\x80-\x84\x86-\x9f\xa1-\xbf]",
        r"[\xe0-\xe3][\x80-\x84\x86-\x9f\xa1-\xbf]\x20",
        r"\xf0\x20[\x80-\xbf][\x80-\xbf]",
        r"\xf0[\x80-\xbf]\x20[\x80-\xbf]",
        r"\xf0[\x80-\xbf][\x80-\xbf]\x20",
    ])
});

/// The word à, which takes its space along, unless it begins another word of Portuguese.
static A_GRAVE: LazyLock<bytes::Regex> =
    LazyLock::new(|| pattern(&[r"\xc3\x20(\x20|quele|quela|quilo|s\x20)?"]));

/// Sequences of UTF-8, or of surrogates in it, with bytes that were lost: 1A stands for U+FFFD, and
/// once a sequence for a question mark.
static LOST: LazyLock<bytes::Regex> = LazyLock::new(|| {
    pattern(&[
        r"[\xc2-\xdf]\x1a",
        r"[\xc2-\xc3]\?",
        r"\xed[\xa0-\xaf][\x1a?]\xed[\xb0-\xbf][\x1a?\x80-\xbf]",
        r"\xed[\xa0-\xaf][\x1a?\x80-\xbf]\xed[\xb0-\xbf][\x1a?]",
        r"[\xe0-\xef][\x1a?][\x1a\x80-\xbf]",
        r"[\xe0-\xef][\x1a\x80-\xbf][\x1a?]",
        r"[\xf0-\xf4][\x1a?][\x1a\x80-\xbf][\x1a\x80-\xbf]",
        r"[\xf0-\xf4][\x1a\x80-\xbf][\x1a?][\x1a\x80-\xbf]",
        r"[\xf0-\xf4][\x1a\x80-\xbf][\x1a\x80-\xbf][\x1a?]",
        r"\x1a",
    ])
});

fn pattern(alternatives: &[&str]) -> bytes::Regex {
    bytes::Regex::new(&format!("(?-u){}", alternatives.join("|")))
        .expect("the patterns are constant")
}

fn restore_spaces(text: &[u8]) -> Vec<u8> {
    let text = A_GRAVE.replace_all(text, |found: &bytes::Captures| match found.get(1) {
        None => b"\xc3\xa0 ".to_vec(),
        Some(_) => found[0].to_vec(),
    });
    let restore = |byte: &u8| if *byte == b' ' { 0xa0 } else { *byte };
    SPACED
        .replace_all(&text, |found: &bytes::Captures| {
            found[0].iter().map(restore).collect::<Vec<_>>()
        })
        .into_owned()
}

/// UTF-8, in which a character may also stand as two surrogates (CESU-8), and U+0000 as C0 80
/// (Java).
fn decode(bytes: &[u8]) -> Option<String> {
    let mut text = String::with_capacity(bytes.len());
    let mut rest = bytes;
    let mut at = 0;
    while at < rest.len() {
        match variant(&rest[at..]) {
            None => at += 1,
            Some((character, length)) => {
                text.push_str(str::from_utf8(&rest[..at]).ok()?);
                text.push(character);
                rest = &rest[at + length..];
                at = 0;
            }
        }
    }
    Some(text + str::from_utf8(rest).ok()?)
}

/// The character at the beginning and its length in bytes, if UTF-8 does not write it so.
fn variant(bytes: &[u8]) -> Option<(char, usize)> {
    match *bytes {
        // "$" in ftfy's patterns lets the newline that ends a line be the last byte.
        [0xc0, 0x80, ..] | [0xc0, b'\n'] => Some(('\0', 2)),
        [
            0xed,
            a @ 0xa0..=0xaf,
            b @ 0x80..=0xbf,
            0xed,
            c @ 0xb0..=0xbf,
            d @ 0x80..=0xbf,
            ..,
        ]
        | [
            0xed,
            a @ 0xa0..=0xaf,
            b @ 0x80..=0xbf,
            0xed,
            c @ 0xb0..=0xbf,
            d @ b'\n',
        ] => {
            let bits = |byte: u8, mask: u8| u32::from(byte & mask);
            let number = (bits(a, 0x0f) << 16)
                + (bits(b, 0x3f) << 10)
                + (bits(c, 0x0f) << 6)
                + bits(d, 0x3f)
                + 0x1_0000;
            char::from_u32(number).map(|character| (character, 6))
        }
        _ => None,
    }
}
