//! Character references of HTML, as Python's `html.unescape` expands them.

use std::borrow::Cow;
use std::collections::HashMap;
use std::sync::LazyLock;

use regex::{Captures, Regex};

use super::charmap;

static REFERENCE: LazyLock<Regex> = LazyLock::new(|| {
    Regex::new(r"&(?:#([0-9]+);?|#[xX]([0-9a-fA-F]+);?|[^\t\n\f <&\#;]{1,32};?)")
        .expect("the pattern is constant")
});

/// From `&eacute;`, and for some names also `&eacute`, to é.
static NAMES: LazyLock<HashMap<&str, &str>> = LazyLock::new(|| {
    let entities = entities::ENTITIES.iter();
    entities
        .map(|entity| (entity.entity, entity.characters))
        .collect()
});

/// What a reference with its `&` and its `;`, if it has one, stands for.
pub(super) fn named(reference: &str) -> Option<&'static str> {
    NAMES.get(reference).copied()
}

/// Replaces every reference by what it stands for. Semicolons may lack where HTML forgives it.
pub(super) fn unescape(text: &str) -> Cow<'_, str> {
    REFERENCE.replace_all(text, |found: &Captures| {
        if let Some(digits) = found.get(1) {
            numeric(digits.as_str(), 10)
        } else if let Some(digits) = found.get(2) {
            numeric(digits.as_str(), 16)
        } else {
            by_longest_name(&found[0])
        }
    })
}

/// The character with that number, nothing if HTML has no use for it, and the replacement
/// character if there is none.
fn numeric(digits: &str, radix: u32) -> String {
    // Digits only, so that the one error is a number that is too large.
    let number = u32::from_str_radix(digits, radix).unwrap_or(u32::MAX);
    let character = match number {
        0 => char::REPLACEMENT_CHARACTER,
        // As web browsers read them.
        0x80..=0x9F => charmap::fix_c1(char::from(number as u8)),
        0x01..=0x08 | 0x0B | 0x0E..=0x1F | 0x7F | 0xFDD0..=0xFDEF => return String::new(),
        _ if number & 0xFFFE == 0xFFFE && number <= 0x10_FFFF => return String::new(),
        _ => char::from_u32(number).unwrap_or(char::REPLACEMENT_CHARACTER),
    };
    character.into()
}

/// Expands the reference, or else the longest name at its beginning; `&` without a name stays.
fn by_longest_name(reference: &str) -> String {
    if let Some(expansion) = named(reference) {
        return expansion.into();
    }
    // The shortest names have two letters.
    let ends = reference.char_indices().rev().map(|(end, _)| end);
    ends.take_while(|&end| end > 2)
        .find_map(|end| Some(named(&reference[..end])?.to_owned() + &reference[end..]))
        .unwrap_or_else(|| reference.into())
}
