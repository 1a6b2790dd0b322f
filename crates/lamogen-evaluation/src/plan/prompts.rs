//! The prompts, and the selection of some of them.

/// The captions of a motion of the data set, and the lengths of the motions that are generated for them.
#[derive(Clone, Debug)]
pub struct EvalPrompt {
    pub captions: Vec<String>,
    /// The lengths in frames, which the repeats take in turn.
    pub frames: Vec<usize>,
}

impl EvalPrompt {
    /// Returns the caption for a repeat. The repeats take the captions in turn.
    pub fn caption(&self, repeat: u64) -> &str {
        &self.captions[repeat as usize % self.captions.len()]
    }

    /// Returns the length in frames for a repeat.
    pub fn frames(&self, repeat: u64) -> usize {
        self.frames[repeat as usize % self.frames.len()]
    }
}

/// A selection of prompts at equal distances, since the list of all prompts may be sorted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PromptSelection {
    count: usize,
    total: usize,
}

impl PromptSelection {
    /// Selects `count` of `total` prompts, or all if there are no more.
    pub fn spread(count: usize, total: usize) -> PromptSelection {
        let count = count.min(total);
        PromptSelection { count, total }
    }

    /// Returns the places of the selected prompts, ascending.
    pub fn iter(self) -> impl Iterator<Item = usize> + Clone {
        (0..self.count).map(move |place| place * self.total / self.count)
    }
}
