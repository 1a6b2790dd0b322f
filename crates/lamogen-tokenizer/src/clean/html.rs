//! Expansion of HTML's character references, as Python's `html.unescape` does it.

use std::borrow::Cow;
use std::collections::HashMap;
use std::sync::LazyLock;

use regex::{Captures, Regex};

use super::charmap;

static REFERENCE: LazyLock<Regex> = LazyLock::new(|| {
    Regex::new(r"&(?:#([0-9]+);?|#[xX]([0-9a-fA-F]+);?|[^\t\n\f <&\#;]{1,32};?)")
        .expect("the pattern is constant")
});

/// The map from named references to characters, such as from `&eacute;` to é. Some names are also listed without the
/// semicolon, such as `&eacute`.
static ENTITIES: LazyLock<HashMap<&str, &str>> = LazyLock::new(|| {
    let entities = entities::ENTITIES.iter();
    entities
        .map(|entity| (entity.entity, entity.characters))
        .collect()
});

/// Returns the characters that a named reference stands for. The reference includes its `&` and its `;`, if it has one.
pub(super) fn expand_named(reference: &str) -> Option<&'static str> {
    ENTITIES.get(reference).copied()
}

/// Replaces every reference by the characters that it stands for. The semicolon may be missing where HTML allows it.
pub(super) fn unescape(text: &str) -> Cow<'_, str> {
    REFERENCE.replace_all(text, |found: &Captures| {
        if let Some(digits) = found.get(1) {
            expand_numeric(digits.as_str(), 10)
        } else if let Some(digits) = found.get(2) {
            expand_numeric(digits.as_str(), 16)
        } else {
            expand_longest_name(&found[0])
        }
    })
}

/// Returns the character with a given number: nothing if HTML does not allow the character, and the replacement character
/// if the number has no character.
fn expand_numeric(digits: &str, radix: u32) -> String {
    // The text has digits only, so the only possible error is a number that is too large.
    let number = u32::from_str_radix(digits, radix).unwrap_or(u32::MAX);
    let character = match number {
        0 => char::REPLACEMENT_CHARACTER,
        // These numbers are read as in web browsers.
        0x80..=0x9F => charmap::fix_c1(char::from(number as u8)),
        0x01..=0x08 | 0x0B | 0x0E..=0x1F | 0x7F | 0xFDD0..=0xFDEF => return String::new(),
        _ if number & 0xFFFE == 0xFFFE && number <= 0x10_FFFF => return String::new(),
        _ => char::from_u32(number).unwrap_or(char::REPLACEMENT_CHARACTER),
    };
    character.into()
}

/// Expands the reference, or else the longest name at its beginning. `&` without a name is kept.
fn expand_longest_name(reference: &str) -> String {
    if let Some(expansion) = expand_named(reference) {
        return expansion.into();
    }
    // The shortest names have two letters.
    let ends = reference.char_indices().rev().map(|(end, _)| end);
    ends.take_while(|&end| end > 2)
        .find_map(|end| Some(expand_named(&reference[..end])?.to_owned() + &reference[end..]))
        .unwrap_or_else(|| reference.into())
}
