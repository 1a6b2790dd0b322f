//! Text as CLIP cleans it before it counts words.

mod badness;
mod charmap;
mod ftfy;
mod html;
mod mojibake;

/// Repairs the text, expands what HTML wrote as `&…;` twice, puts one space for every run of white
/// space, and makes it lower case.
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

/// What Python's `str.split` takes for white space: Unicode's, and four separators of ASCII.
fn is_space(character: char) -> bool {
    character.is_whitespace() || matches!(character, '\x1c'..='\x1f')
}
