//! Options of reading, and progress.

use crate::error::DataError;

/// The lengths of motions that are loaded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LoadOptions {
    /// The least length in frames; 40 by default, as in the public text-to-motion code.
    pub min_frames: usize,
    /// The greatest length in frames; 199 by default, because the public code leaves out motions of 200 frames or more.
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
    /// Checks that a length can be within the limits.
    ///
    /// # Errors
    ///
    /// If the limits allow no length.
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

/// The progress of reading or packing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Progress {
    /// The number of clips, files or rows that are done.
    pub done: usize,
    /// The number of clips, files or rows in all.
    pub all: usize,
}
