//! Comparison of a sentence's phrasing with captions.

use std::collections::HashSet;

use super::sentences::{Phrasing, Sentence};

/// A set of captions, with their words and their pairs of consecutive words.
#[derive(Clone, Debug, Default)]
pub struct Captions {
    /// Each caption as its words.
    captions: HashSet<Vec<String>>,
    words: HashSet<String>,
    /// The pairs of consecutive words.
    pairs: HashSet<[String; 2]>,
}

/// The words and pairs of words of a sentence that captions do not have.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Novelty {
    /// Whether the sentence is a caption, apart from case and punctuation.
    pub is_caption: bool,
    /// The words of the sentence that are in no caption.
    pub words: Vec<String>,
    /// The pairs of consecutive words that are in no caption.
    pub pairs: Vec<[String; 2]>,
}

impl Novelty {
    /// Returns whether a sentence may have this phrasing: `training` if all its words and pairs of consecutive words are
    /// in captions, `novel` if some are not and the sentence is not a caption.
    pub fn allows(&self, phrasing: Phrasing) -> bool {
        let is_known = self.words.is_empty() && self.pairs.is_empty();
        match phrasing {
            Phrasing::Training => is_known,
            Phrasing::Novel => !is_known && !self.is_caption,
        }
    }
}

impl Captions {
    /// Collects the words and pairs of words of captions.
    pub fn new<'a>(captions: impl IntoIterator<Item = &'a str>) -> Captions {
        let mut collected = Captions::default();
        for caption in captions {
            let words = words(caption);
            collected.pairs.extend(pairs(&words));
            collected.words.extend(words.iter().cloned());
            collected.captions.insert(words);
        }
        collected
    }

    /// Compares a sentence with the captions.
    pub fn novelty(&self, sentence: &Sentence) -> Novelty {
        let words = words(&sentence.text);
        let pairs = pairs(&words).filter(|pair| !self.pairs.contains(pair));
        let unknown = words.iter().filter(|word| !self.words.contains(*word));
        Novelty {
            pairs: pairs.collect(),
            words: unknown.cloned().collect(),
            is_caption: self.captions.contains(&words),
        }
    }
}

/// Returns the words of a text in lower case: its runs of letters, digits and apostrophes.
fn words(text: &str) -> Vec<String> {
    let text = text.to_lowercase();
    let words = text.split(|c: char| !c.is_alphanumeric() && c != '\'');
    words
        .filter(|word| !word.is_empty())
        .map(str::to_owned)
        .collect()
}

/// Returns the pairs of consecutive words.
fn pairs(words: &[String]) -> impl Iterator<Item = [String; 2]> {
    words
        .windows(2)
        .map(|pair| [pair[0].clone(), pair[1].clone()])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn novelty(text: &str) -> Novelty {
        let captions = [
            "A person walks.",
            "someone walks to the left",
            "a person jumps",
        ];
        Captions::new(captions).novelty(&Sentence {
            group: "walk".into(),
            phrasing: Phrasing::Novel,
            seconds: 4.0,
            text: text.into(),
            checks: Vec::new(),
        })
    }

    #[test]
    fn a_caption_is_found_whatever_its_case_and_dots() {
        let found = novelty("a person, walks");
        assert!(found.is_caption && !found.allows(Phrasing::Novel));
    }

    #[test]
    fn words_in_an_order_that_captions_have_are_training_phrasing() {
        let found = novelty("a person walks to the left");
        assert!(!found.is_caption && found.allows(Phrasing::Training));
        assert!(!found.allows(Phrasing::Novel));
    }

    #[test]
    fn another_word_or_another_order_is_novel() {
        let found = novelty("to the left walks a penguin");
        assert_eq!(found.words, ["penguin"]);
        assert_eq!(found.pairs.len(), 3);
        assert!(found.allows(Phrasing::Novel) && !found.allows(Phrasing::Training));
    }
}
