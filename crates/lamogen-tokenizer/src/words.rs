//! Words of a text, and the set of words that a model was trained on.

use std::collections::BTreeSet;

/// Splits a text into words in lower case. Each punctuation mark is a word of its own.
pub fn words(text: &str) -> Vec<String> {
    let mut words = Vec::new();
    let mut word = String::new();
    for letter in text.to_lowercase().chars() {
        let is_in_word =
            letter.is_alphanumeric() || letter == '\'' || letter == '-' && !word.is_empty();
        if is_in_word {
            word.push(letter);
            continue;
        }
        if !word.is_empty() {
            words.push(std::mem::take(&mut word));
        }
        if !letter.is_whitespace() {
            words.push(letter.to_string());
        }
    }
    if !word.is_empty() {
        words.push(word);
    }
    words
}

/// The set of words in the captions that a model was trained on.
///
/// ```
/// use lamogen_tokenizer::WordList;
///
/// let known = WordList::of(["a person walks", "someone jumps"]);
/// assert_eq!(known.unknown_words("A person moonwalks, moonwalks!"), ["moonwalks"]);
/// ```
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct WordList(BTreeSet<String>);

impl WordList {
    /// Collects the words of some texts.
    pub fn of<'t>(texts: impl IntoIterator<Item = &'t str>) -> Self {
        let mut known = WordList::default();
        texts.into_iter().for_each(|text| known.add(text));
        known
    }

    /// Adds the words of a text.
    pub fn add(&mut self, text: &str) {
        self.0
            .extend(words(text).into_iter().filter(|word| is_word(word)));
    }

    /// Reads a list with one word per line.
    pub fn from_lines(lines: &str) -> Self {
        let lines = lines.lines().map(str::trim);
        WordList(
            lines
                .filter(|line| !line.is_empty())
                .map(str::to_owned)
                .collect(),
        )
    }

    /// Writes the list that [`from_lines`](Self::from_lines) reads, in alphabetical order.
    pub fn to_lines(&self) -> String {
        self.0.iter().flat_map(|word| [word, "\n"]).collect()
    }

    /// Returns the number of words.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Returns whether the set has no words.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Returns whether at least one word of a text is in the set.
    pub fn contains_any(&self, text: &str) -> bool {
        words(text).iter().any(|word| self.0.contains(word))
    }

    /// Returns the words of a text that are not in the set, each once, in the order of the text. Punctuation is left out.
    pub fn unknown_words(&self, text: &str) -> Vec<String> {
        let mut unseen = Vec::new();
        for word in words(text) {
            if is_word(&word) && !self.0.contains(&word) && !unseen.contains(&word) {
                unseen.push(word);
            }
        }
        unseen
    }
}

/// Returns whether a word is not punctuation.
fn is_word(word: &str) -> bool {
    word.contains(char::is_alphanumeric)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_in_lower_case_and_punctuation_stands_alone() {
        assert_eq!(
            words("It's a U-turn, to the LEFT!"),
            ["it's", "a", "u-turn", ",", "to", "the", "left", "!"]
        );
        assert_eq!(words("  "), Vec::<String>::new());
    }

    #[test]
    fn a_list_is_read_as_it_was_written() {
        let known = WordList::of(["walks to the left", "U-turn 2"]);
        assert_eq!(WordList::from_lines(&known.to_lines()), known);
        assert!(known.unknown_words("walks 2 u-turn").is_empty());
        assert_eq!(known.unknown_words("höpft 左 walks höpft"), ["höpft", "左"]);
        assert!(known.contains_any("höpft 左 WALKS"));
        assert!(!known.contains_any("höpft 左 12345 !!!"));
    }
}
