//! One motion of a data set, with what is said of it.

use std::ops::Range;

use crate::split::Split;

/// A motion with its captions. Its rows are in the [`Dataset`](crate::Dataset) that it comes from.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// Its name, the only one of the kind in the data set.
    pub name: String,
    /// What it is for.
    pub split: Split,
    /// Its length in frames, at 20 a second.
    pub frames: usize,
    /// Whether it is the mirror image of the rows that are stored.
    pub mirror: bool,
    /// What is done, in a word such as `walk-turn-left`, where the source says so.
    pub content: Option<String>,
    /// How it is done, in a word such as `tired`, where the source says so.
    pub style: Option<String>,
    /// Where it is from.
    pub source: Option<String>,
    /// The recording that it was cut from; entries of one trial belong into one split.
    pub trial: Option<String>,
    /// The entry that it is a variation of: a motion that nobody made, with which training may show what it is to move otherwise. See
    /// [`Dataset::with_variations`](crate::Dataset::with_variations).
    pub variation_of: Option<String>,
    /// What is good to know of it.
    pub note: Option<String>,
    /// What is said of it; at least one.
    pub captions: Vec<Caption>,
    /// Which clip of the data set its rows lie in.
    pub(crate) clip: usize,
    /// Its first row, counted over the whole data set.
    pub(crate) start: usize,
}

/// A sentence that describes a motion.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Caption {
    /// The sentence.
    pub text: String,
    /// Its words with their parts of speech, such as `a/DET man/NOUN walk/VERB`, where the source has them.
    pub tokens: Option<String>,
}

impl Entry {
    /// Which clip of the data set its rows lie in: that of its mirror image, and of other parts of the same clip.
    pub fn clip(&self) -> usize {
        self.clip
    }

    /// Its rows, counted over the whole data set.
    pub(crate) fn rows(&self) -> Range<usize> {
        self.start..self.start + self.frames
    }
}
