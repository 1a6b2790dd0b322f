//! BVH, a text format with a hierarchy of joints and their rotations over time.

mod cursor;
mod euler;
mod read;
mod skeleton;
mod write;

use std::path::Path;

use crate::error::ReadError;
use crate::import::{ImportedMotion, ReadOptions, import};

pub use cursor::BvhError;
pub use skeleton::{BvhChannel, BvhJoint, BvhJointPose, BvhSkeleton, BvhSkeletonError};
pub use write::{BvhNames, BvhOptions, text};

/// Reads a motion from the text of a BVH file, in the same way as [`read`](crate::read()) reads it from a file. `path` is
/// used only in error messages.
///
/// # Errors
///
/// If the text is damaged; its skeleton is unknown or does not have the size of a human; or the motion is longer than an
/// hour.
pub fn read_text(
    text: &str,
    options: &ReadOptions,
    path: impl AsRef<Path>,
) -> Result<ImportedMotion, ReadError> {
    let path = path.as_ref();
    let bvh = read::parse(text, path)?;
    Ok(ImportedMotion {
        announced_frames: Some(bvh.announced_frames).filter(|n| *n != bvh.clip.frames),
        ..import(&bvh.clip, None, options, path)?
    })
}
