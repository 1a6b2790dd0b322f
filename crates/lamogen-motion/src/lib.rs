//! The body that lamogen moves: its skeleton and pose features, and conversions between pose features, joint
//! positions and joint rotations.
//!
//! ```text
//! normalised features ──Normalization──▶ pose features ──joints──▶ joint positions ──▶ Motion
//!   [batch, frames, 263]                 (HumanML3D)               [batch, frames, 22, 3]
//! ```
//!
//! Units are metres and frames at [`FRAMES_PER_SECOND`]; Y points up. Functions of tensors are
//! differentiable and work on whole batches; [`Motion`] holds one motion on the host.

mod caption;
mod decode;
mod encode;
mod features;
mod jitter;
mod joints;
mod limb;
mod motion;
mod normalization;
pub mod npy;
mod padding;
mod placement;
mod precise;
mod quality;
mod rotations;
mod skeleton;
mod travel;
mod turning;

pub use caption::TimedCaption;
pub use encode::{canonical, encode, encode_canonical, encode_every_frame};
pub use features::{FOOT_CONTACT_JOINTS, FeatureGroup, POSE_FEATURES};
pub use jitter::Jitter;
pub use joints::joints;
pub use lamogen_io::{
    TEMPORARY_PREFIX, TemporaryPath, describe_placeholder_at, placeholder,
    remove_stale_temporaries, remove_temporaries, replace_atomically, write_atomically,
};
pub use limb::{MAX_STRETCH, bend_limb};
pub use motion::{BodyError, FRAMES_PER_SECOND, Motion, MotionError};
pub use normalization::{Normalization, NormalizationError};
pub use padding::frame_mask;
pub use placement::{GroundMove, Placement};
pub use precise::smooth_step;
pub use quality::{BoneDrift, FootSliding};
pub use rotations::{RestPose, RigDistance, Rotations};
pub use skeleton::{ARMS, CHAINS, JOINTS, Joint, LEGS};
pub use travel::{Keyframes, LoopEnd, RootMotion, close_path, ground_path, loop_frame_rate};
pub use turning::{JointTurn, JointTurning};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
