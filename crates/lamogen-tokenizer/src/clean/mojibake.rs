//! Repair of mojibake: UTF-8 that was decoded in another encoding.

use std::sync::LazyLock;

use regex::bytes;

use super::badness::{is_bad, utf8_lookalikes};
use super::charmap::{self, CHARMAPS, Charmap};

/// Undoes all layers of wrong decoding.
pub(super) fn fix_encoding(text: &str) -> String {
    let mut text = text.to_owned();
    loop {
        match fix_layer(&text) {
            Some(fixed) if fixed != text => text = fixed,
            _ => return text,
        }
    }
}

/// Undoes one layer of wrong decoding, if the text looks as if it had one.
fn fix_layer(text: &str) -> Option<String> {
    if text.is_ascii() || !is_bad(text) {
        return None;
    }
    let fixed_by = |charmap| redecode(text, charmap);
    if let Some(fixed) = CHARMAPS.iter().find_map(fixed_by) {
        return Some(fixed);
    }
    let fixed = fix_parts(text);
    if fixed != text {
        return Some(fixed);
    }
    Some(text.chars().map(charmap::fix_c1).collect())
}

/// Encodes the text in an encoding and decodes the bytes as UTF-8. Returns `None` if one of these steps is not possible.
fn redecode(text: &str, charmap: &Charmap) -> Option<String> {
    let mut bytes = charmap.encode(text)?;
    if charmap.restores_spaces {
        bytes = restore_spaces(&bytes);
    }
    if charmap.is_lossy {
        bytes = LOST_BYTES
            .replace_all(&bytes, "\u{fffd}".as_bytes())
            .into_owned();
    }
    decode(&bytes)
}

/// Fixes, one by one, the parts of the text that look like UTF-8 read in another encoding.
fn fix_parts(text: &str) -> String {
    let mut fixed = String::with_capacity(text.len());
    let mut done = 0;
    for part in utf8_lookalikes(text) {
        fixed.push_str(&text[done..part.start]);
        done = part.end;
        let part = &text[part];
        // A part that is the whole text would lead to an endless recursion.
        if part.len() < text.len() && is_bad(part) {
            fixed.push_str(&fix_encoding(part));
        } else {
            fixed.push_str(part);
        }
    }
    fixed + &text[done..]
}

/// Sequences of UTF-8 in which byte A0, a no-break space, was replaced by a space. Sequences for unlikely characters are
/// left out.
static SPACED_SEQUENCE: LazyLock<bytes::Regex> = LazyLock::new(|| {
    pattern(&[
        r"[\xc2\xc3\xc5\xce\xd0\xd9]\x20",
        r"[\xe2\xe3]\x20[\x80-\x84\x86-\x9f\xa1-\xbf]",
        r"[\xe0-\xe3][\x80-\x84\x86-\x9f\xa1-\xbf]\x20",
        r"\xf0\x20[\x80-\xbf][\x80-\xbf]",
        r"\xf0[\x80-\xbf]\x20[\x80-\xbf]",
        r"\xf0[\x80-\xbf][\x80-\xbf]\x20",
    ])
});

/// The word à with the space after it, unless à is the beginning of another Portuguese word.
static A_GRAVE: LazyLock<bytes::Regex> =
    LazyLock::new(|| pattern(&[r"\xc3\x20(\x20|quele|quela|quilo|s\x20)?"]));

/// Sequences of UTF-8, or of surrogates in UTF-8, with lost bytes. A lost byte appears as 1A, which stands for U+FFFD, and
/// in some sequences as a question mark.
static LOST_BYTES: LazyLock<bytes::Regex> = LazyLock::new(|| {
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
    SPACED_SEQUENCE
        .replace_all(&text, |found: &bytes::Captures| {
            found[0].iter().map(restore).collect::<Vec<_>>()
        })
        .into_owned()
}

/// Decodes UTF-8, in which a character may also be written as two surrogates (CESU-8), and U+0000 as C0 80 (Java).
fn decode(bytes: &[u8]) -> Option<String> {
    let mut text = String::with_capacity(bytes.len());
    let mut rest = bytes;
    let mut index = 0;
    while index < rest.len() {
        match decode_variant(&rest[index..]) {
            None => index += 1,
            Some((character, length)) => {
                text.push_str(str::from_utf8(&rest[..index]).ok()?);
                text.push(character);
                rest = &rest[index + length..];
                index = 0;
            }
        }
    }
    Some(text + str::from_utf8(rest).ok()?)
}

/// Decodes the character at the beginning, if it is written in a way that standard UTF-8 does not allow. Returns the
/// character and its length in bytes.
fn decode_variant(bytes: &[u8]) -> Option<(char, usize)> {
    match *bytes {
        // The "$" in ftfy's patterns also matches the newline at the end of a line in place of the last byte.
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
