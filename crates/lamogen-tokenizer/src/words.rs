//! Words of a text, and the set of words that a model was trained on.

use std::collections::BTreeSet;

use crate::function_words::{is_english, says_nothing};

/// Splits a text into words in lower case. Each punctuation mark is a word of its own.
pub fn words(text: &str) -> Vec<String> {
    split(&text.to_lowercase())
}

/// Splits a text into words as they are written. Each punctuation mark is a word of its own.
fn split(text: &str) -> Vec<String> {
    let mut words = Vec::new();
    let mut word = String::new();
    for letter in text.chars() {
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

    /// Returns whether a text says anything in words of the set.
    ///
    /// Words that say nothing of a movement by themselves do not count: articles, pronouns, prepositions, words for any person
    /// ("someone"), numbers and words of one or two letters. At least one other word has to be known. A text may share such a word
    /// with English by chance ("elle lève la main"), so a text without any word such as "the" or "his" needs as many known words
    /// as unknown ones. Capitalised words after the first one are names, which may be unknown.
    ///
    /// ```
    /// use lamogen_tokenizer::WordList;
    ///
    /// let known = WordList::of(["a person walks to the main road"]);
    /// assert!(known.says_anything("Grzegorz Wolski walks"));
    /// assert!(!known.says_anything("a person"));
    /// assert!(!known.says_anything("elle lève la main droite"));
    /// ```
    pub fn says_anything(&self, text: &str) -> bool {
        let (mut known, mut unknown, mut has_english) = (0, 0, false);
        for (place, written) in split(text).iter().enumerate() {
            let word = written.to_lowercase();
            has_english |= is_english(&word);
            if !is_word(&word) || says_nothing(&word) {
                continue;
            }
            let is_name = place > 0 && written.starts_with(char::is_uppercase);
            match self.0.contains(&word) {
                true => known += 1,
                false if is_name => {}
                false => unknown += 1,
            }
        }
        known > 0 && (has_english || known >= unknown)
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
    }

    #[test]
    fn a_text_says_something_if_a_word_of_a_movement_is_known() {
        let known = WordList::of([
            "a person walks forward and jumps two times",
            "he waves with the right hand on the main court of the pie shop, and still dances",
            "someone runs 3 metres to la casa",
        ]);
        for text in [
            "walks",
            "a person zorbs and jumps",
            "Jumps!",
            "WALKS FORWARD",
            "the frobnicator of Quux zyzzles zazzily, then dances",
            "Sasuke Uchiha runs",
            "Zaphod dances",
        ] {
            assert!(known.says_anything(text), "{text}");
        }
        for text in [
            "",
            "!!! ???",
            "the",
            "a person",
            "7 8 9 person",
            "3",
            "someone, with his",
            "a person zorbs",
            "eine Person springt",
            "der Mensch steht still",
            "elle lève la main droite",
            "il court très vite",
            "alguien da una patada con el pie derecho",
            "人が跳ぶ",
            "человек прыгает",
        ] {
            assert!(!known.says_anything(text), "{text}");
        }
    }
}
