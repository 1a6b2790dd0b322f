//! Kinds of motion: which motions of a data set are meant.

use serde::Deserialize;

use crate::entry::Entry;
use crate::sides::swap_sides;

/// One in so many captions may contain a word that is not wanted: writers use words in many senses.
const RARE: usize = 8;

/// The motions with one of some contents, perhaps only those whose captions have certain words.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Kind {
    /// The contents that the motion may have.
    pub content: Vec<String>,
    /// Words that a caption of the motion has to contain, all of them in one caption.
    #[serde(default)]
    pub words: Vec<String>,
    /// Words that at most one in eight captions of the motion may contain.
    #[serde(default)]
    pub without: Vec<String>,
}

impl Kind {
    /// Returns whether an entry is one of the motions.
    pub fn fits(&self, entry: &Entry) -> bool {
        let content = entry.content.as_ref();
        let has_content = content.is_some_and(|content| self.content.contains(content));
        let has = |text: &str, word: &String| text.to_lowercase().contains(word.as_str());
        let texts = || entry.captions.iter().map(|caption| caption.text.as_str());
        let unwanted = texts().filter(|text| self.without.iter().any(|word| has(text, word)));
        has_content
            && texts().any(|text| self.words.iter().all(|word| has(text, word)))
            && unwanted.count() * RARE <= entry.captions.len()
    }

    /// Returns the kind with left and right exchanged.
    pub fn other_side(&self) -> Kind {
        let swapped = |words: &[String]| words.iter().map(|word| swap_sides(word)).collect();
        Kind {
            content: swapped(&self.content),
            words: swapped(&self.words),
            without: swapped(&self.without),
        }
    }
}
