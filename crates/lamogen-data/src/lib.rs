//! Motion capture with captions, as training and evaluation need it.
//!
//! ```text
//! HumanML3D's folder ──┐
//! packed folder ───────┴─▶ Dataset: entries with captions, rows of pose features, statistics
//!                             │
//! motion files, captions ─────┴─pack──▶ packed folder
//! ```
//!
//! A [`Dataset`] holds all rows in memory, 16 bits a number. What cannot be used is left out and listed in
//! [`Dataset::problems`]. Features are those of [`lamogen_motion`]: 263 a frame, 20 frames a second, metres.

mod checksum;
mod dataset;
mod derived;
mod entry;
mod error;
mod form;
mod humanml3d;
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
pub use mirror::Mirror;
pub use options::{LoadOptions, Progress};
pub use pack::{PackOptions, pack, pack_all};
pub use problems::{Problem, ProblemKind, Problems};
pub use split::{Split, SplitError};
pub use variations::MotionVariation;

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
