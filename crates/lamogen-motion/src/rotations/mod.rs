//! From joint positions to local joint rotations on a T-pose rest skeleton, and back.

mod fit;
mod rest;
mod solve;
mod twist;

pub use rest::RestPose;

#[cfg(test)]
mod tests;

use glam::{DQuat, DVec3};

use crate::motion::{FRAMES_PER_SECOND, Motion};
use crate::precise::vector;
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

/// How far rotations of rigid bones are from a motion, in metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RigDistance {
    /// Between all joints on average.
    pub mean: f32,
    /// At worst.
    pub largest: f32,
    /// The joint where it is worst.
    pub joint: Joint,
    /// The frame at which it is.
    pub frame: usize,
}

impl Rotations {
    /// The rotations of a motion, by which [`joints`](Self::joints) gives its positions again, as far as a
    /// rigid body can: bones get their median length, and what sits around pelvis and upper spine moves
    /// together.
    ///
    /// Pelvis and upper spine turn as fits their three children best (least squares). Every other joint
    /// turns by the smallest swing that points its bone the right way; upper arms and thighs are twisted
    /// so that elbows and knees bend as hinges, and where a limb is too straight to tell, the twist is
    /// carried smoothly from where it is known. Nothing flips, whichever way the body faces, because every
    /// joint is solved over the whole motion at once. Head, hands and toes keep the turn of their parents.
    pub fn of(motion: &Motion) -> Rotations {
        Rotations::on_body(motion, &RestPose::of(motion))
    }

    /// As [`of`](Self::of), with the bones of a body that is given: bones keep their directions and get its lengths.
    pub fn on_body(motion: &Motion, rest: &RestPose) -> Rotations {
        let global = solve::solve(motion, rest);
        let mut last = [DQuat::IDENTITY; JOINTS];
        let local = global.iter().map(|global| {
            for joint in Joint::ALL {
                let j = joint.index();
                let turn = match joint.parent() {
                    None => global[j],
                    Some(parent) => global[parent.index()].inverse() * global[j],
                };
                // Of the two quaternions of a rotation the one next to the frame before.
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
        }
    }

    /// Rotations that are known: where the pelvis is at every frame, and the local rotations, which have length 1.
    ///
    /// # Panics
    ///
    /// If there are not as many places as rotations, or none.
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

    /// The local rotations at every frame, indexed by [`Joint::index`]. Of the two quaternions of a rotation it is
    /// the one nearer to that of the frame before, so that they may be mixed number by number.
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

    /// The same movement of another body: every bone keeps its direction and gets the other's length, and what sits
    /// around pelvis and upper spine is placed as on the other. Ways and heights of the pelvis grow with the legs.
    /// Where hands touch each other or feet the ground is not kept beyond that.
    ///
    /// # Panics
    ///
    /// If the body that moves now has no legs: if all four bones have no length.
    pub fn on(&self, body: &RestPose) -> Rotations {
        let leg = self.rest.leg();
        assert!(leg > 0.0, "a body without legs tells no size");
        let scale = body.leg() / leg;
        Rotations {
            rest: body.clone(),
            root: { self.root.iter() }
                .map(|place| place.map(|x| x * scale))
                .collect(),
            ..self.clone()
        }
    }

    /// How far [`joints`](Self::joints) are from those of a motion of the same frame rate, over the frames that both
    /// have: for the motion that the rotations were made of, what a rigid body cannot follow.
    pub fn distance(&self, motion: &Motion) -> RigDistance {
        let mut found = RigDistance {
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
                if distance as f32 > found.largest {
                    (found.largest, found.joint, found.frame) = (distance as f32, joint, frame);
                }
            }
        }
        found.mean = (sum / f64::from(count.max(1))) as f32;
        found
    }

    /// The same movement at another frame rate: rotations along the shortest arc between two frames, the
    /// pelvis along a smooth curve through its places. It begins with the first frame and ends with the
    /// last one, or up to half a new frame beside it.
    ///
    /// # Panics
    ///
    /// If the rate is not a positive number.
    pub fn resampled(&self, frames_per_second: f32) -> Rotations {
        assert!(
            frames_per_second.is_finite() && frames_per_second > 0.0,
            "a frame rate is a positive number, not {frames_per_second}"
        );
        if frames_per_second == self.frames_per_second {
            return self.clone();
        }
        let step = f64::from(self.frames_per_second) / f64::from(frames_per_second);
        let last = self.frames() - 1;
        let frames = (last as f64 / step).round() as usize + 1;
        let places = (0..frames).map(|frame| {
            let place = (frame as f64 * step).min(last as f64);
            let before = (place.floor() as usize).min(last.saturating_sub(1));
            (before, place - before as f64)
        });
        let (root, local) = places
            .map(|(before, part)| {
                (
                    self.root_between(before, part),
                    self.local_between(before, part),
                )
            })
            .unzip();
        Rotations {
            rest: self.rest.clone(),
            root,
            local,
            frames_per_second,
        }
    }

    /// Catmull and Rom's curve through four neighbours; beyond the ends it goes straight on.
    fn root_between(&self, before: usize, part: f64) -> [f32; 3] {
        let last = self.frames() - 1;
        let at = |frame: usize| vector(self.root[frame.min(last)]);
        let (b, c) = (at(before), at(before + 1));
        let a = match before {
            0 => b * 2.0 - c,
            before => at(before - 1),
        };
        let d = match before + 2 > last {
            true => c * 2.0 - b,
            false => at(before + 2),
        };
        let (speed_b, speed_c) = ((c - a) / 2.0, (d - b) / 2.0);
        let [t, t2, t3] = [1, 2, 3].map(|power| part.powi(power));
        let place = b * (2.0 * t3 - 3.0 * t2 + 1.0)
            + speed_b * (t3 - 2.0 * t2 + t)
            + c * (3.0 * t2 - 2.0 * t3)
            + speed_c * (t3 - t2);
        place.as_vec3().to_array()
    }

    fn local_between(&self, before: usize, part: f64) -> [[f32; 4]; JOINTS] {
        let after = (before + 1).min(self.frames() - 1);
        std::array::from_fn(|joint| {
            let [from, to] = [before, after].map(|frame| quaternion(self.local[frame][joint]));
            from.slerp(to, part).to_array().map(|x| x as f32)
        })
    }
}

fn quaternion(values: [f32; 4]) -> DQuat {
    DQuat::from_array(values.map(f64::from)).normalize()
}
