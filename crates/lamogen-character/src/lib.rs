//! Puts human motion on rigged characters: glTF and VRM files with a skin, and skeletons of BVH files.
//!
//! ```text
//! hero.glb ──Character::open──▶ skeleton: rest pose, joints by their names or a VRM's map
//!                                   │
//! Motion ──rotations relative to the rest pose, in the body's frame──▶ retarget ──▶ CharacterAnimation
//!                                   │                                                    │
//!                                   └── feet that stand, hands that touch: two-bone IK      ▼
//! hero_jump.glb ◀──the same file, byte for byte, and one more animation──────── Character::save
//! ```

mod arms;
mod bind_pose;
mod body_part;
mod bvh;
mod character;
mod document;
mod easing;
mod error;
mod hands;
mod legs;
mod mesh;
mod retarget;
mod skeleton;
mod vrm;

pub use bind_pose::RestPoseNotice;
pub use character::{
    BoneTrack, Character, CharacterAnimation, CharacterOptions, PositionTrack, SaveOptions,
};
pub use error::CharacterError;
pub use mesh::{BonePose, CharacterMesh, MeshBone, MeshGroup, MeshPoses, MeshVertex};
pub use retarget::RetargetOptions;

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
