//! GLB, the binary form of glTF 2.0, which game engines, browsers and Blender open.
//!
//! A file that lamogen writes has a root node `lamogen`, below it the 22 joints with the names of
//! [`Joint::name`](lamogen_motion::Joint::name), one animation, and a body. Units and axes are those of glTF and of
//! lamogen: metres, seconds, right-handed, Y up, facing +Z, with the body's left along +X. Blender converts Y up to its
//! own Z up.
//!
//! - The transforms of the nodes are the T-pose with its feet on the ground, without any rotation.
//! - The animation has linear keyframes at the frames of the motion: the translation of the pelvis, and a rotation of
//!   each joint that turns. Rotations have length 1 and do not change their sign from frame to frame.
//! - The body is **one skinned mesh** of capsules, each bound to one joint. The alternative, a separate mesh on the node
//!   of every joint, looks the same, but Blender imports it as empties with child objects, and Unity and Godot as plain
//!   transforms. A skin is imported as an armature, a rig or a `Skeleton3D`, which can be retargeted and exported again.
//!   Every vertex has weight 1 for one joint, because a capsule is rigid.
//!
//! [`read`](crate::read) accepts any glTF file that has names for its nodes.

mod body;
mod buffer;
mod capsule;
mod container;
mod curve;
mod grid;
mod meshopt;
mod read;
mod reduction;
mod skeleton;
mod skins;
mod surfaces;
mod write;

use std::io;
use std::path::PathBuf;

pub(crate) use buffer::{BufferBuilder, BufferViewTarget};
pub use container::split_chunks;
pub(crate) use read::{GltfMotion, read};
pub(crate) use skeleton::{SkeletonFile, node_index};
pub use skins::inverse_bind_matrices;
pub use surfaces::{Surface, SurfaceImage, SurfaceMaterial, Surfaces, surfaces};
pub use write::{GlbOptions, bytes, write};

/// The errors of reading and writing GLB and glTF files.
#[derive(Debug, thiserror::Error)]
pub enum GlbError {
    /// The file, or another file to which it refers, cannot be opened, read or written.
    #[error("{path}: {reason}")]
    #[allow(missing_docs)]
    Io { path: PathBuf, reason: io::Error },
    /// The file is not glTF 2.0, is damaged, or needs an unsupported feature.
    #[error("{path}: {reason}")]
    #[allow(missing_docs)]
    Format { path: PathBuf, reason: String },
    /// The file has no animation of the requested name.
    #[error("{path}: expected an animation named {asked:?}, found {}", quoted_list(.found))]
    #[allow(missing_docs)]
    Animation {
        path: PathBuf,
        asked: String,
        found: Vec<String>,
    },
    /// The motion has a number that is not finite.
    #[error("expected finite positions and rotations, found a number that is not")]
    NotFinite,
    /// The motion is too long for the format.
    #[error("expected a motion of at most 4 GiB, found {bytes} bytes")]
    #[allow(missing_docs)]
    TooLarge { bytes: usize },
}

/// Formats names for an error message.
fn quoted_list(names: &[String]) -> String {
    match names {
        [] => "none".into(),
        names => names
            .iter()
            .map(|name| format!("{name:?}"))
            .collect::<Vec<_>>()
            .join(", "),
    }
}

#[cfg(test)]
pub(crate) mod example {
    //! A motion for tests: a body that walks, turns around and swings its limbs.

    use glam::{DQuat, DVec3};
    use lamogen_motion::{JOINTS, Joint, Motion, Rotations};

    pub(crate) fn motion(frames: usize) -> Motion {
        let poses = (0..frames).map(|frame| {
            let time = frame as f64 / 20.0;
            let mut place = [DVec3::ZERO; JOINTS];
            let mut turn = [DQuat::IDENTITY; JOINTS];
            for joint in Joint::ALL {
                let j = joint.index();
                let phase = time * 2.0 + j as f64;
                match joint.parent() {
                    None => {
                        place[j] = DVec3::new(time.sin(), 0.95 + 0.05 * phase.sin(), 0.8 * time);
                        turn[j] = DQuat::from_rotation_y(3.0 * time);
                    }
                    Some(parent) => {
                        let p = parent.index();
                        place[j] = place[p] + turn[p] * bone(joint);
                        turn[j] = turn[p] * DQuat::from_rotation_x(0.4 * phase.sin());
                    }
                }
            }
            place.map(|point| point.as_vec3().to_array())
        });
        Motion::from_joints(poses.collect()).unwrap()
    }

    pub(crate) fn rotations() -> Rotations {
        Rotations::of(&motion(40))
    }

    fn bone(joint: Joint) -> DVec3 {
        use Joint::*;
        let left = match joint {
            Pelvis => [0.0; 3],
            LeftHip | RightHip => [0.07, -0.09, 0.0],
            LeftKnee | RightKnee => [0.0, -0.38, 0.0],
            LeftAnkle | RightAnkle => [0.0, -0.4, 0.0],
            LeftFoot | RightFoot => [0.0, -0.06, 0.12],
            Spine1 | Spine2 | Spine3 => [0.0, 0.12, 0.0],
            Neck => [0.0, 0.2, 0.0],
            Head => [0.0, 0.1, 0.0],
            LeftCollar | RightCollar => [0.08, 0.11, 0.0],
            LeftShoulder | RightShoulder => [0.1, 0.0, 0.0],
            LeftElbow | RightElbow => [0.26, 0.0, 0.0],
            LeftWrist | RightWrist => [0.25, 0.0, 0.0],
        };
        let mirrored = joint.name().starts_with("right");
        DVec3::from(left) * DVec3::new(if mirrored { -1.0 } else { 1.0 }, 1.0, 1.0)
    }
}
