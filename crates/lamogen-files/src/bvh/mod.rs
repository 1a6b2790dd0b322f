//! BVH: a text file with a hierarchy of joints and their rotations over time.

mod cursor;
mod euler;
mod read;
mod write;

use std::path::Path;

use crate::error::ReadError;
use crate::import::{ImportedMotion, ReadOptions, import};

pub use cursor::BvhError;
pub use write::{BvhNames, BvhOptions, text};

/// Reads a motion from the text of a BVH, as [`read`](crate::read()) does from a file. `path` stands in error messages alone.
///
/// # Errors
///
/// If the text is damaged; its skeleton is unknown or has no human size; or there is more than an hour of motion.
pub fn read_text(
    text: &str,
    options: &ReadOptions,
    path: impl AsRef<Path>,
) -> Result<ImportedMotion, ReadError> {
    let path = path.as_ref();
    imported(&read::parse(text, path)?, options, path)
}

/// Reads a motion from a file.
pub(crate) fn read(path: &Path, options: &ReadOptions) -> Result<ImportedMotion, ReadError> {
    imported(&read::read(path)?, options, path)
}

fn imported(
    bvh: &read::Bvh,
    options: &ReadOptions,
    path: &Path,
) -> Result<ImportedMotion, ReadError> {
    Ok(ImportedMotion {
        announced_frames: Some(bvh.announced).filter(|n| *n != bvh.clip.frames),
        ..import(&bvh.clip, options, path)?
    })
}
