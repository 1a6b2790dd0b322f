//! A data set's entry: one motion with its captions.

use std::ops::Range;

use crate::split::Split;

/// A motion with its captions. Its rows are in the [`Dataset`](crate::Dataset) that it comes from.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// The name, unique in the data set.
    pub name: String,
    /// The split that the entry belongs to.
    pub split: Split,
    /// The length in frames, at 20 frames per second.
    pub frames: usize,
    /// Whether the entry is the mirror image of the stored rows.
    pub mirror: bool,
    /// The action in a word such as `walk-turn-left`, where the source has one.
    pub content: Option<String>,
    /// The style of the action in a word such as `tired`, where the source has one.
    pub style: Option<String>,
    /// The origin of the motion.
    pub source: Option<String>,
    /// The recording that the motion was cut from. Entries of one trial belong in one split.
    pub trial: Option<String>,
    /// The entry that this one is a variation of. A variation is a computed motion that nobody performed; it can show
    /// training how the same movement looks in another manner. See
    /// [`Dataset::with_variations`](crate::Dataset::with_variations).
    pub variation_of: Option<String>,
    /// A remark for readers, such as what was changed in the motion.
    pub note: Option<String>,
    /// The captions; at least one.
    pub captions: Vec<Caption>,
    /// The clip of the data set that holds the entry's rows.
    pub(crate) clip: usize,
    /// The entry's first row, counted over the whole data set.
    pub(crate) start: usize,
}

/// A sentence that describes a motion.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Caption {
    /// The sentence.
    pub text: String,
    /// The words with their parts of speech, such as `a/DET man/NOUN walk/VERB`, where the source has them.
    pub tokens: Option<String>,
}

impl Entry {
    /// Returns the index of the clip that holds the entry's rows. A mirror image and other parts of the clip have the
    /// same index.
    pub fn clip(&self) -> usize {
        self.clip
    }

    /// Returns the entry's rows, counted over the whole data set.
    pub(crate) fn rows(&self) -> Range<usize> {
        self.start..self.start + self.frames
    }
}
