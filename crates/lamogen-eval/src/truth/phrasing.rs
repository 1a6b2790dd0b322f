//! Whether a sentence is phrased as captions are.

use std::collections::HashSet;

use super::sentences::{Phrasing, Sentence};

/// The words of captions, and which follow which.
#[derive(Clone, Debug, Default)]
pub struct Captions {
    whole: HashSet<Vec<String>>,
    words: HashSet<String>,
    pairs: HashSet<[String; 2]>,
}

/// How a sentence lies among captions.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Novelty {
    /// Whether it is a caption, but for case and punctuation.
    pub is_caption: bool,
    /// Its words that no caption has.
    pub words: Vec<String>,
    /// Two words each that follow each other in no caption.
    pub pairs: Vec<[String; 2]>,
}

impl Novelty {
    /// Whether the sentence may be called so: `training` if every two words that follow each other do so in a caption, `novel` if
    /// some do not, so that it is none.
    pub fn allows(&self, phrasing: Phrasing) -> bool {
        let is_known = self.words.is_empty() && self.pairs.is_empty();
        match phrasing {
            Phrasing::Training => is_known,
            Phrasing::Novel => !is_known && !self.is_caption,
        }
    }
}

impl Captions {
    /// Learns what captions there are.
    pub fn new<'a>(captions: impl IntoIterator<Item = &'a str>) -> Captions {
        let mut known = Captions::default();
        for caption in captions {
            let words = words(caption);
            known.pairs.extend(pairs(&words));
            known.words.extend(words.iter().cloned());
            known.whole.insert(words);
        }
        known
    }

    /// Looks a sentence up.
    pub fn novelty(&self, sentence: &Sentence) -> Novelty {
        let words = words(&sentence.text);
        let pairs = pairs(&words).filter(|pair| !self.pairs.contains(pair));
        let unknown = words.iter().filter(|word| !self.words.contains(*word));
        Novelty {
            pairs: pairs.collect(),
            words: unknown.cloned().collect(),
            is_caption: self.whole.contains(&words),
        }
    }
}

/// Letters and digits that follow each other, in lower case.
fn words(text: &str) -> Vec<String> {
    let text = text.to_lowercase();
    let words = text.split(|c: char| !c.is_alphanumeric() && c != '\'');
    words
        .filter(|word| !word.is_empty())
        .map(str::to_owned)
        .collect()
}

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
    fn words_in_an_order_that_captions_have_are_phrased_as_they_are() {
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
