//! BVH: a text file with a hierarchy of joints and their rotations over time.

mod euler;
mod read;
mod write;

pub use read::BvhError;
pub(crate) use read::read;
pub use write::{BvhNames, BvhOptions, text};
