//! The errors of reading and writing motions.

use std::io;
use std::path::PathBuf;

use lamogen_motion::npy::NpyError;
use lamogen_motion::{Joint, MotionError, POSE_FEATURES};

use crate::bvh::BvhError;
use crate::format::{MAX_DISTANCE, MAX_FRAMES};
use crate::glb::GlbError;
use crate::mapping::MappingError;
use crate::names::UnknownSkeleton;

/// The reason why a file cannot be read as a motion.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// The file cannot be opened or read.
    #[error("{path}: {reason}")]
    #[allow(missing_docs)]
    Io { path: PathBuf, reason: io::Error },
    /// The extension of the file's name belongs to no known format.
    #[error(
        "{path}: expected a name that ends in .bvh, .glb, .gltf, .vrm, .vrma or .npy, found {found}"
    )]
    #[allow(missing_docs)]
    Ending { path: PathBuf, found: String },
    /// The frame rate of the options is out of range.
    #[error("{path}: expected 0.001 to 10000 frames a second, found {found}")]
    #[allow(missing_docs)]
    FrameRate { path: PathBuf, found: f32 },
    /// The file is a placeholder for the real file: a pointer of Git LFS, or a web page.
    #[error("{path}: {problem}")]
    #[allow(missing_docs)]
    Placeholder {
        path: PathBuf,
        problem: &'static str,
    },
    /// A BVH file cannot be read.
    #[error(transparent)]
    Bvh(#[from] BvhError),
    /// A GLB or glTF file cannot be read.
    #[error(transparent)]
    Glb(#[from] GlbError),
    /// An `.npy` file cannot be read.
    #[error(transparent)]
    Npy(#[from] NpyError),
    /// The shape of the array is not that of a motion.
    #[error(
        "{path}: expected joints (frames, 22, 3), (frames, 66) or (22, 3, frames), those of SMPL and SMPL-H with 24 and 52, \
         several such motions, or pose features (frames, {POSE_FEATURES}); found the shape {found:?}"
    )]
    #[allow(missing_docs)]
    Shape { path: PathBuf, found: Vec<usize> },
    /// The array holds integers, and the options do not give their unit.
    #[error(
        "{path}: expected floats, or whole numbers with their unit, found whole numbers: say what unit they count, such as mm"
    )]
    #[allow(missing_docs)]
    Integers { path: PathBuf },
    /// The array has no motion of the requested number.
    #[error("{path}: expected the number of a motion, from 0 to {last}, found {found:?}", last = .motions.saturating_sub(1))]
    #[allow(missing_docs)]
    Index {
        path: PathBuf,
        motions: usize,
        found: String,
    },
    /// The skeleton follows no known naming scheme.
    #[error("{path}: {reason}")]
    #[allow(missing_docs)]
    Skeleton {
        path: PathBuf,
        reason: UnknownSkeleton,
    },
    /// The mapping does not fit the file.
    #[error("{path}: {reason}")]
    #[allow(missing_docs)]
    Mapping { path: PathBuf, reason: MappingError },
    /// The body has no human size in any unit.
    #[error(
        "{path}: expected a body of human size in metres, centimetres, millimetres, inches or CMU's unit, found \
         one that measures {size} from ankle to hip and from pelvis to head (1.48 m on an adult); say \
         what unit the file has"
    )]
    #[allow(missing_docs)]
    Size { path: PathBuf, size: f64 },
    /// The motion is longer than an hour.
    #[error("{path}: expected at most an hour of motion, found {seconds:.0} s")]
    #[allow(missing_docs)]
    Long { path: PathBuf, seconds: f64 },
    /// The numbers of the file are not a valid motion.
    #[error("{path}: {reason}")]
    #[allow(missing_docs)]
    Motion { path: PathBuf, reason: MotionError },
}

/// The reason why a motion cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// The extension of the file's name belongs to no known format.
    #[error(
        "{path}: expected a name that ends in .bvh, .glb, .vrma, .npy or .features.npy, found {found}"
    )]
    #[allow(missing_docs)]
    Ending { path: PathBuf, found: String },
    /// The frame rate of the options is out of range, or not the one that the format has.
    #[error("{path}: expected {expected} frames a second, found {found}")]
    #[allow(missing_docs)]
    FrameRate {
        path: PathBuf,
        expected: &'static str,
        found: f32,
    },
    /// The unit is not a length, or is so small or large that numbers in it lose digits.
    #[error("{path}: expected a unit of 0.000001 to 1000000 metres, found {found}")]
    #[allow(missing_docs)]
    Unit { path: PathBuf, found: f64 },
    /// A joint is too far away from the origin.
    #[error("{path}: expected positions within {most} m of the origin, found {joint} at frame {frame} {found:e} m away", joint = .joint.name(), most = MAX_DISTANCE)]
    #[allow(missing_docs)]
    Far {
        path: PathBuf,
        frame: usize,
        joint: Joint,
        found: f32,
    },
    /// The motion would have more frames than lamogen writes into one file.
    #[error("{path}: expected at most {most} frames, found {found}: take fewer frames a second", most = MAX_FRAMES)]
    #[allow(missing_docs)]
    Frames { path: PathBuf, found: usize },
    /// A GLB file cannot be written.
    #[error(transparent)]
    Glb(#[from] GlbError),
    /// An `.npy` file cannot be written.
    #[error(transparent)]
    Npy(#[from] NpyError),
    /// The file cannot be written.
    #[error("{path}: {reason}")]
    #[allow(missing_docs)]
    Io { path: PathBuf, reason: io::Error },
}
