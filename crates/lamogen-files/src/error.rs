//! What can go wrong between a file and a motion.

use std::io;
use std::path::PathBuf;

use lamogen_motion::npy::NpyError;
use lamogen_motion::{Joint, MotionError, POSE_FEATURES};

use crate::bvh::BvhError;
use crate::format::{MOST_DISTANT, MOST_FRAMES};
use crate::glb::GlbError;
use crate::mapping::MappingError;
use crate::names::UnknownSkeleton;

/// Why a file is not read as a motion.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// The file's name tells no format.
    #[error("{path}: expected a name that ends in .bvh, .glb, .gltf or .npy, found {found}")]
    #[allow(missing_docs)]
    Ending { path: PathBuf, found: String },
    /// A frame rate that cannot be.
    #[error("{path}: expected 0.001 to 10000 frames a second, found {found}")]
    #[allow(missing_docs)]
    FrameRate { path: PathBuf, found: f32 },
    /// Something else in the place of the file: a pointer of Git LFS, a web page.
    #[error("{path}: {problem}")]
    #[allow(missing_docs)]
    Placeholder {
        path: PathBuf,
        problem: &'static str,
    },
    /// A BVH.
    #[error(transparent)]
    Bvh(#[from] BvhError),
    /// A GLB or glTF.
    #[error(transparent)]
    Glb(#[from] GlbError),
    /// An array.
    #[error(transparent)]
    Npy(#[from] NpyError),
    /// An array of another shape.
    #[error(
        "{path}: expected joints (frames, 22, 3), (frames, 66) or (22, 3, frames), those of SMPL and SMPL-H with 24 and 52, \
         several such motions, or pose features (frames, {POSE_FEATURES}); found the shape {found:?}"
    )]
    #[allow(missing_docs)]
    Shape { path: PathBuf, found: Vec<usize> },
    /// An array of whole numbers, of which nobody says what they count.
    #[error(
        "{path}: expected floats, or whole numbers with their unit, found whole numbers: say what unit they count, such as mm"
    )]
    #[allow(missing_docs)]
    Integers { path: PathBuf },
    /// A motion that an array does not have.
    #[error("{path}: expected the number of a motion, from 0 to {last}, found {found:?}", last = .motions.saturating_sub(1))]
    #[allow(missing_docs)]
    Index {
        path: PathBuf,
        motions: usize,
        found: String,
    },
    /// The skeleton is not known.
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
    /// A motion of more than an hour.
    #[error("{path}: expected at most an hour of motion, found {seconds:.0} s")]
    #[allow(missing_docs)]
    Long { path: PathBuf, seconds: f64 },
    /// What was read is no motion.
    #[error("{path}: {reason}")]
    #[allow(missing_docs)]
    Motion { path: PathBuf, reason: MotionError },
}

/// Why a motion is not written.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// The file's name tells no format.
    #[error(
        "{path}: expected a name that ends in .bvh, .glb, .npy or .features.npy, found {found}"
    )]
    #[allow(missing_docs)]
    Ending { path: PathBuf, found: String },
    /// A frame rate that cannot be.
    #[error("{path}: expected {expected} frames a second, found {found}")]
    #[allow(missing_docs)]
    FrameRate {
        path: PathBuf,
        expected: &'static str,
        found: f32,
    },
    /// A unit that is no length, or one in which numbers lose their digits.
    #[error("{path}: expected a unit of 0.000001 to 1000000 metres, found {found}")]
    #[allow(missing_docs)]
    Unit { path: PathBuf, found: f64 },
    /// A motion that is nowhere near the origin.
    #[error("{path}: expected positions within {most} m of the origin, found {joint} at frame {frame} {found:e} m away", joint = .joint.name(), most = MOST_DISTANT)]
    #[allow(missing_docs)]
    Far {
        path: PathBuf,
        frame: usize,
        joint: Joint,
        found: f32,
    },
    /// More frames than a file is written for.
    #[error("{path}: expected at most {most} frames, found {found}: take fewer frames a second", most = MOST_FRAMES)]
    #[allow(missing_docs)]
    Frames { path: PathBuf, found: usize },
    /// A GLB.
    #[error(transparent)]
    Glb(#[from] GlbError),
    /// An array.
    #[error(transparent)]
    Npy(#[from] NpyError),
    /// The file cannot be written.
    #[error("{path}: {reason}")]
    #[allow(missing_docs)]
    Io { path: PathBuf, reason: io::Error },
}
