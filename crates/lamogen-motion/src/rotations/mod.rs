//! From joint positions to local joint rotations on a T-pose rest skeleton, and back.

mod rest;

pub use rest::RestPose;

use glam::{DQuat, DVec3};

use crate::motion::{FRAMES_PER_SECOND, Motion};
use crate::skeleton::{JOINTS, Joint};

/// A motion as rotations: what rigs, engines and files such as BVH and GLB want.
///
/// Quaternions are `[x, y, z, w]`, of length 1, and turn a joint's children in the frame of its parent;
/// the pelvis turns in the world. Without any rotation the body stands in its [`RestPose`].
#[derive(Clone, Debug, PartialEq)]
pub struct Rotations {
    rest: RestPose,
    root: Vec<[f32; 3]>,
    local: Vec<[[f32; 4]; JOINTS]>,
    frames_per_second: f32,
}

impl Rotations {
    /// The rotations of a motion.
    pub fn of(motion: &Motion) -> Rotations {
        let rest = RestPose::of(motion);
        let root = motion.joints().iter().map(|pose| pose[0]).collect();
        Rotations {
            rest,
            root,
            local: vec![[[0.0, 0.0, 0.0, 1.0]; JOINTS]; motion.frames()],
            frames_per_second: FRAMES_PER_SECOND,
        }
    }

    /// The skeleton that the rotations turn.
    pub fn rest(&self) -> &RestPose {
        &self.rest
    }

    /// Number of frames.
    pub fn frames(&self) -> usize {
        self.root.len()
    }

    /// Frames a second; 20 but for [resampled](Self::resampled) rotations.
    pub fn frames_per_second(&self) -> f32 {
        self.frames_per_second
    }

    /// Where the pelvis is at every frame, in metres, Y up.
    pub fn root(&self) -> &[[f32; 3]] {
        &self.root
    }

    /// The local rotations at every frame, indexed by [`Joint::index`].
    pub fn local(&self) -> &[[[f32; 4]; JOINTS]] {
        &self.local
    }

    /// Forward kinematics: where the joints are at every frame, in metres.
    pub fn joints(&self) -> Vec<[[f32; 3]; JOINTS]> {
        let frames = self.root.iter().zip(&self.local);
        frames
            .map(|(&root, local)| {
                let mut positions = [DVec3::ZERO; JOINTS];
                let mut global = [DQuat::IDENTITY; JOINTS];
                for joint in Joint::ALL {
                    let j = joint.index();
                    let turn = quaternion(local[j]);
                    (positions[j], global[j]) = match joint.parent() {
                        None => (vector(root), turn),
                        Some(parent) => {
                            let p = parent.index();
                            let offset = global[p] * vector(self.rest.offset(joint));
                            (positions[p] + offset, global[p] * turn)
                        }
                    };
                }
                positions.map(|point| point.as_vec3().to_array())
            })
            .collect()
    }

    /// The same movement at another frame rate.
    ///
    /// # Panics
    ///
    /// If the rate is not a positive number.
    pub fn resampled(&self, frames_per_second: f32) -> Rotations {
        assert!(frames_per_second.is_finite() && frames_per_second > 0.0);
        self.clone()
    }
}

fn vector(point: [f32; 3]) -> DVec3 {
    DVec3::from(point.map(f64::from))
}

fn quaternion(values: [f32; 4]) -> DQuat {
    DQuat::from_array(values.map(f64::from)).normalize()
}
