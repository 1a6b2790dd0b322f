//! What is read, and how far reading is.

use crate::error::DataError;

/// Which motions are used.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LoadOptions {
    /// The shortest motion, in frames; 40 as in the public text-to-motion code.
    pub min_frames: usize,
    /// The longest motion, in frames; 199, because that code leaves out 200 and more.
    pub max_frames: usize,
}

impl Default for LoadOptions {
    fn default() -> Self {
        LoadOptions {
            min_frames: 40,
            max_frames: 199,
        }
    }
}

impl LoadOptions {
    /// Whether any length is within the limits.
    pub(crate) fn check(&self) -> Result<(), DataError> {
        let LoadOptions {
            min_frames,
            max_frames,
        } = *self;
        match (1..=max_frames).contains(&min_frames) {
            true => Ok(()),
            false => Err(DataError::Limits {
                min_frames,
                max_frames,
            }),
        }
    }
}

/// How far a long work is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Progress {
    /// How many clips or files are done.
    pub done: usize,
    /// How many there are.
    pub all: usize,
}
