//! Converts joint positions to local joint rotations on a T-pose rest skeleton, and back.

mod fit;
mod resample;
mod rest;
mod solve;
mod twist;

pub use rest::RestPose;

#[cfg(test)]
mod tests;

use std::ops::Range;

use glam::{DQuat, DVec3};

use crate::motion::{FRAMES_PER_SECOND, Motion};
use crate::precise::vector;
use crate::skeleton::{JOINTS, Joint};

/// A motion as joint rotations, as rigs, engines and files such as BVH and GLB need it.
///
/// Rotations are quaternions `[x, y, z, w]` of length 1. The rotation of a joint turns its children and is relative to
/// the frame of its parent; the pelvis turns in the world. Without any rotation the body stands in its [`RestPose`].
#[derive(Clone, Debug, PartialEq)]
pub struct Rotations {
    rest: RestPose,
    root: Vec<[f32; 3]>,
    local: Vec<[[f32; 4]; JOINTS]>,
    frames_per_second: f32,
    /// The travel of each cycle along the ground, if the movement is a loop.
    loop_travel: Option<[f32; 2]>,
}

/// The distance between the joints of a rigid body and those of a motion, in metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RigDistance {
    /// The mean distance over all joints and frames.
    pub mean: f32,
    /// The largest distance.
    pub largest: f32,
    /// The joint with the largest distance.
    pub joint: Joint,
    /// The frame of the largest distance.
    pub frame: usize,
}

impl Rotations {
    /// Solves the rotations of a motion. [`joints`](Self::joints) then gives the positions of the motion as closely as a
    /// rigid body can: bones get their median length, and the children of the pelvis, as those of the upper spine, keep
    /// their positions relative to each other.
    ///
    /// Pelvis and upper spine get the rotation that fits their three children best (least squares). Every other joint
    /// gets the smallest swing that points its bone in the right direction. Upper arms and thighs are also twisted so
    /// that elbows and knees bend as hinges; where a limb is too straight to show its twist, the twist is carried over
    /// smoothly from frames where it is known. Nothing flips, whichever way the body faces, because every joint is
    /// solved over the whole motion at once. Head, hands and toes turn with their parents.
    pub fn of(motion: &Motion) -> Rotations {
        Rotations::on_body(motion, &RestPose::of(motion))
    }

    /// As [`of`](Self::of), on a given body: the bones keep their directions and get the lengths of that body.
    pub fn on_body(motion: &Motion, rest: &RestPose) -> Rotations {
        let global = solve::solve_global(motion, rest);
        let mut last = [DQuat::IDENTITY; JOINTS];
        let local = global.iter().map(|global| {
            for joint in Joint::ALL {
                let j = joint.index();
                let turn = match joint.parent() {
                    None => global[j],
                    Some(parent) => global[parent.index()].inverse() * global[j],
                };
                // Of the two quaternions of a rotation, take the one nearer to that of the frame before.
                last[j] = match turn.dot(last[j]) < 0.0 {
                    true => -turn,
                    false => turn,
                }
                .normalize();
            }
            last.map(|turn| turn.to_array().map(|x| x as f32))
        });
        Rotations {
            local: local.collect(),
            root: motion.joints().iter().map(|pose| pose[0]).collect(),
            rest: rest.clone(),
            frames_per_second: FRAMES_PER_SECOND,
            loop_travel: motion.loop_travel(),
        }
    }

    /// Makes rotations from known values: the position of the pelvis at every frame in metres, and the local rotations
    /// at every frame as quaternions of length 1.
    ///
    /// # Panics
    ///
    /// If `root` and `local` do not have the same number of frames, or have none.
    pub fn new(
        rest: RestPose,
        root: Vec<[f32; 3]>,
        local: Vec<[[f32; 4]; JOINTS]>,
        frames_per_second: f32,
    ) -> Rotations {
        assert!(
            root.len() == local.len() && !root.is_empty(),
            "expected a place and rotations for every frame, found {} and {}",
            root.len(),
            local.len()
        );
        Rotations {
            rest,
            root,
            local,
            frames_per_second,
            loop_travel: None,
        }
    }

    /// Makes the movement a loop: see [`Motion::with_loop_travel`].
    pub fn with_loop_travel(self, travel: Option<[f32; 2]>) -> Rotations {
        Rotations {
            loop_travel: travel,
            ..self
        }
    }

    /// Returns the travel of a loop in a cycle: see [`Motion::loop_travel`].
    pub fn loop_travel(&self) -> Option<[f32; 2]> {
        self.loop_travel
    }

    /// Returns the skeleton that the rotations turn.
    pub fn rest(&self) -> &RestPose {
        &self.rest
    }

    /// Returns the number of frames.
    pub fn frames(&self) -> usize {
        self.root.len()
    }

    /// Returns some of the frames, which are no loop.
    ///
    /// # Panics
    ///
    /// If the range is empty or reaches beyond the last frame.
    pub fn between(&self, frames: Range<usize>) -> Rotations {
        Rotations::new(
            self.rest.clone(),
            self.root[frames.clone()].to_vec(),
            self.local[frames].to_vec(),
            self.frames_per_second,
        )
    }

    /// Returns the frames of both, one after the other, without a loop. `next` has to stand where it goes on.
    ///
    /// # Panics
    ///
    /// If they are of different skeletons or have different frame rates.
    pub fn followed_by(&self, next: &Rotations) -> Rotations {
        assert!(
            self.rest == next.rest && self.frames_per_second == next.frames_per_second,
            "expected rotations of one skeleton and one frame rate"
        );
        let last = self.local.last().copied().unwrap_or_default();
        // Of the two quaternions of a rotation, the nearer one follows.
        let dot = |a: [f32; 4], b: [f32; 4]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>();
        let first = next.local.first().copied().unwrap_or_default();
        let signs: [f32; JOINTS] =
            std::array::from_fn(|joint| match dot(last[joint], first[joint]) {
                negative if negative < 0.0 => -1.0,
                _ => 1.0,
            });
        let turned = next
            .local
            .iter()
            .map(|pose| std::array::from_fn(|joint| pose[joint].map(|value| signs[joint] * value)));
        Rotations::new(
            self.rest.clone(),
            [&self.root[..], &next.root].concat(),
            self.local.iter().copied().chain(turned).collect(),
            self.frames_per_second,
        )
    }

    /// Returns the frame rate in frames a second: 20, unless the rotations were made or
    /// [resampled](Self::resampled) at another rate.
    pub fn frames_per_second(&self) -> f32 {
        self.frames_per_second
    }

    /// Returns the position of the pelvis at every frame, in metres, Y up.
    pub fn root(&self) -> &[[f32; 3]] {
        &self.root
    }

    /// Returns the local rotations at every frame, indexed by [`Joint::index`]. Of the two quaternions of a rotation,
    /// the one nearer to that of the frame before is used, so that the numbers of two frames may be interpolated.
    pub fn local(&self) -> &[[[f32; 4]; JOINTS]] {
        &self.local
    }

    /// Computes the joint positions at every frame, in metres, by forward kinematics.
    pub fn joints(&self) -> Vec<[[f32; 3]; JOINTS]> {
        let poses = self.root.iter().zip(&self.local);
        poses
            .map(|(&root, local)| {
                let pose = WorldPose::new(&self.rest, root, local);
                pose.positions.map(|point| point.as_vec3().to_array())
            })
            .collect()
    }

    /// Transfers the movement to another body. Every bone keeps its direction and gets the length that it has on that
    /// body; the children of pelvis and upper spine are placed as on that body. The path and the height of the pelvis
    /// are scaled by the length of the legs. Contacts, such as hands that touch each other or feet on the ground, are
    /// not kept beyond that.
    ///
    /// # Panics
    ///
    /// If the body that moves now has no legs, that is, if all four leg bones have no length.
    pub fn on(&self, body: &RestPose) -> Rotations {
        let leg = self.rest.leg();
        assert!(leg > 0.0, "a body without legs tells no size");
        let scale = body.leg() / leg;
        Rotations {
            rest: body.clone(),
            root: { self.root.iter() }
                .map(|place| place.map(|x| x * scale))
                .collect(),
            loop_travel: self.loop_travel.map(|travel| travel.map(|x| x * scale)),
            ..self.clone()
        }
    }

    /// Measures how far [`joints`](Self::joints) are from those of a motion of the same frame rate, over the frames that
    /// both have. For the motion that the rotations were solved from, this is the part that a rigid body cannot follow.
    pub fn distance(&self, motion: &Motion) -> RigDistance {
        let mut measured = RigDistance {
            mean: 0.0,
            largest: 0.0,
            joint: Joint::Pelvis,
            frame: 0,
        };
        let (mut sum, mut count) = (0.0, 0);
        for (frame, (ours, theirs)) in self.joints().iter().zip(motion.joints()).enumerate() {
            for joint in Joint::ALL {
                let [ours, theirs] = [ours, theirs].map(|pose| vector(pose[joint.index()]));
                let distance = ours.distance(theirs);
                sum += distance;
                count += 1;
                if distance as f32 > measured.largest {
                    (measured.largest, measured.joint, measured.frame) =
                        (distance as f32, joint, frame);
                }
            }
        }
        measured.mean = (sum / f64::from(count.max(1))) as f32;
        measured
    }

    /// Returns the first frames.
    ///
    /// # Panics
    ///
    /// If there are fewer frames, or `frames` is 0.
    pub(crate) fn first(&self, frames: usize) -> Rotations {
        Rotations::new(
            self.rest.clone(),
            self.root[..frames].to_vec(),
            self.local[..frames].to_vec(),
            self.frames_per_second,
        )
    }

    /// Returns a loop with the given travel that is played several times, and then so many frames of the next cycle.
    pub(crate) fn repeated(&self, cycles: usize, extra: usize, travel: [f32; 2]) -> Rotations {
        let frames = cycles * self.frames() + extra;
        let root = (0..frames).map(|frame| {
            let cycle = (frame / self.frames()) as f32;
            let [x, y, z] = self.root[frame % self.frames()];
            [x + cycle * travel[0], y, z + cycle * travel[1]]
        });
        let mut local: Vec<[[f32; 4]; JOINTS]> = Vec::with_capacity(frames);
        for frame in 0..frames {
            let mut pose = self.local[frame % self.frames()];
            if let Some(before) = local.last() {
                for (turn, before) in pose.iter_mut().zip(before) {
                    let dot: f32 = turn.iter().zip(before).map(|(a, b)| a * b).sum();
                    if dot < 0.0 {
                        *turn = turn.map(|x| -x);
                    }
                }
            }
            local.push(pose);
        }
        Rotations::new(
            self.rest.clone(),
            root.collect(),
            local,
            self.frames_per_second,
        )
    }
}

/// Where the joints are, and how they are turned, at a frame.
struct WorldPose {
    positions: [DVec3; JOINTS],
    rotations: [DQuat; JOINTS],
}

impl WorldPose {
    /// Computes the pose by forward kinematics.
    fn new(rest: &RestPose, root: [f32; 3], local: &[[f32; 4]; JOINTS]) -> WorldPose {
        let mut positions = [DVec3::ZERO; JOINTS];
        let mut rotations = [DQuat::IDENTITY; JOINTS];
        for joint in Joint::ALL {
            let j = joint.index();
            let turn = quaternion(local[j]);
            (positions[j], rotations[j]) = match joint.parent() {
                None => (vector(root), turn),
                Some(parent) => {
                    let p = parent.index();
                    let offset = rotations[p] * vector(rest.offset(joint));
                    (positions[p] + offset, rotations[p] * turn)
                }
            };
        }
        WorldPose {
            positions,
            rotations,
        }
    }
}

/// Converts a quaternion to 64 bits and length 1.
fn quaternion(values: [f32; 4]) -> DQuat {
    DQuat::from_array(values.map(f64::from)).normalize()
}
