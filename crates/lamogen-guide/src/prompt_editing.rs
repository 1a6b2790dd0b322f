//! Prompt editing, a comparison method of the paper: the tags are added to the prompt as words, without guidance.

use lamogen_laban::Tag;

/// Appends the phrases of tags (see [`Tag::phrase`]) to a prompt: the paper's comparison method "prompt editing".
///
/// ```
/// use lamogen_guide::prompt_with_tags;
/// use lamogen_laban::Tag;
///
/// let prompt = prompt_with_tags("a person jumps.", [Tag::Strong, Tag::Free]);
/// assert_eq!(prompt, "a person jumps with large energy freely");
/// ```
pub fn prompt_with_tags(prompt: &str, tags: impl IntoIterator<Item = Tag>) -> String {
    let prompt = prompt.trim_end().trim_end_matches('.').to_owned();
    tags.into_iter()
        .fold(prompt, |prompt, tag| format!("{prompt} {}", tag.phrase()))
}
