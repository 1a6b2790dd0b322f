//! Motion capture data sets with captions, for training and evaluation.
//!
//! ```text
//! HumanML3D's folder ──┐
//! packed folder ───────┴─▶ Dataset: entries with captions, rows of pose features, statistics
//!                             │
//! motion files, captions ─────┴─pack──▶ packed folder
//! ```
//!
//! A [`Dataset`] holds all rows in memory, 16 bits per number. Motions that cannot be used are left out and listed in
//! [`Dataset::problems`]. The features are those of [`lamogen_motion`]: 263 per frame, 20 frames per second, metres.

mod checksum;
mod compositions;
mod dataset;
mod derived;
mod entry;
mod error;
mod form;
mod humanml3d;
mod kind;
mod mirror;
mod more_captions;
mod options;
mod pack;
mod packed;
mod problems;
mod rows;
mod sides;
mod speeds;
mod split;
mod statistics;
#[cfg(test)]
mod testing;
mod variations;

pub use checksum::Checksum;
pub use dataset::Dataset;
pub use entry::{Caption, Entry};
pub use error::DataError;
pub use humanml3d::{BenchmarkClip, BenchmarkSplit};
pub use mirror::Mirror;
pub use options::{LoadOptions, Progress};
pub use pack::{PackOptions, pack, pack_all};
pub use problems::{Problem, ProblemKind, Problems};
pub use split::{Split, SplitError};
pub use variations::MotionVariation;

/// Entry points for the fuzz targets in `fuzz/`.
#[doc(hidden)]
pub mod fuzzing {
    /// Parses a text as a file of captions in each of its forms.
    pub fn parse_captions(text: &str) {
        let _ = crate::humanml3d::text::parse(text);
        let _ = crate::humanml3d::benchmark::count_lines(text);
        let _ = crate::more_captions::parse(text);
        let _ = crate::pack::listing::parse(text);
        let _ = crate::compositions::check(text);
        let _ = text.lines().map(crate::Entry::from_json).count();
    }
}

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
