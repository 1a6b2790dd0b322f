//! VRM animations (`.vrma`), motions that every VRM character can play.
//!
//! A VRM animation is a GLB file with the extension [`VRMC_vrm_animation`], which says which nodes are the bones of a
//! human body. Players such as three-vrm and UniVRM put its rotations on any VRM character, of version 0.x or 1.0,
//! whatever its proportions and the axes of its bones.
//!
//! A file that lamogen writes has
//! - a root node `lamogen` and below it the 22 joints, named as VRM's [human bones](human_bone()), in a T-pose that faces +Z
//!   with Y up, in metres, without any rotation and scale;
//! - one animation with linear keyframes: the translation of the hips, and a rotation of every bone with
//!   children. Head, hands and toes have none if the motion does not turn them, so that a player may;
//! - no mesh.
//!
//! Two things differ from a [GLB](crate::glb) of the same motion, but not the positions of the joints:
//! - **The rest pose stands on the ground of the motion**: the balls of the feet are as high as they are where the motion
//!   stands. Players scale the path of the hips by the height of the character's hips in units of this rest pose, and the
//!   character then stands on its own soles.
//! - **The trunk has two bones, spine and chest**, which share its twist. Players leave out the rotation of a bone that a
//!   character does not have, and many characters have no upper chest. The chest has all of the upper spine's rotation. The
//!   bend of the middle spine, which is no human bone, is a translation of a node below it, which players do not look at;
//!   so the joints are where they are in the motion. `extras` of the extension name the node of the middle spine.
//!
//! [`read`](crate::read()) finds the joints of such a file by its human bones, whatever its nodes are called.
//!
//! [`VRMC_vrm_animation`]: https://github.com/vrm-c/vrm-specification/tree/master/specification/VRMC_vrm_animation-1.0

mod bones;
mod read;
mod spine;
mod write;

pub use bones::human_bone;
pub(crate) use read::{SCHEME, human_joints};
pub use write::{VrmaOptions, bytes, write};

/// The name of the extension.
pub(crate) const EXTENSION: &str = "VRMC_vrm_animation";

/// The field of the extension's `extras` that names the node of the middle spine.
pub(crate) const MIDDLE_SPINE: &str = "middleSpine";

/// The usual number of keyframes per second: what the specification proposes.
pub(crate) const FRAMES_PER_SECOND: f32 = 30.0;
