//! glTF: not here yet.

use std::path::{Path, PathBuf};

use lamogen_motion::Rotations;

use crate::clip::Clip;

/// Why a glTF cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum GlbError {
    /// This version does not know the format.
    #[error("{0}: expected another format than glTF, which this version does not know")]
    Unknown(PathBuf),
}

pub(crate) fn read(path: &Path) -> Result<Clip, GlbError> {
    Err(GlbError::Unknown(path.to_owned()))
}

pub(crate) fn write(path: &Path, _: &Rotations) -> Result<(), GlbError> {
    Err(GlbError::Unknown(path.to_owned()))
}
