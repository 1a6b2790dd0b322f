//! BVH: a text file with a hierarchy of joints and their rotations over time.

mod cursor;
mod euler;
mod read;
mod write;

pub use cursor::BvhError;
pub(crate) use read::read;
pub use write::{BvhNames, BvhOptions, text};
