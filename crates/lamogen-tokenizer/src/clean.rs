//! The cleaning of text that CLIP does before it splits the text into words.

mod badness;
mod charmap;
mod ftfy;
mod html;
mod mojibake;

/// Repairs the text, expands HTML's character references (`&…;`) twice, replaces each run of white space by one space, and
/// converts the text to lower case.
pub(crate) fn clean(text: &str) -> String {
    let repaired = ftfy::fix_text(text);
    let unescaped = html::unescape(&repaired);
    let text = html::unescape(&unescaped);
    let words: Vec<_> = text
        .split(is_space)
        .filter(|word| !word.is_empty())
        .collect();
    words.join(" ").to_lowercase()
}

/// Returns whether Python's `str.split` treats a character as white space: Unicode's white space and four separators of
/// ASCII.
fn is_space(character: char) -> bool {
    character.is_whitespace() || matches!(character, '\x1c'..='\x1f')
}
