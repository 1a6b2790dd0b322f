//! Rough curvatures of the value of a fit, by which the steps of its minimiser are divided.

use glam::{DQuat, DVec3};
use lamogen_motion::{JOINTS, Joint};

use super::{FRAME_WIDTH, MotionFit};
use crate::banded::{BandedFactorization, SECOND_DIFFERENCE, THIRD_DIFFERENCE};
use crate::options::{FitOptions, is_of_leg};
use crate::pose::{BoneOffsets, PARENT_JOINTS, Pose};

/// What is added to the curvature of the root at frames where a goal counts far more than the terms of the fit, and half of it
/// to that of joints. It is of the size of the root's own. Without it, the first step moves an arm too far, and the steps
/// that follow are too short; with the goal's whole curvature, the frame hardly moves beside its neighbours.
const STIFF_CURVATURE: f64 = 80.0;
/// What is added to the curvature at held frames: far more than all terms together.
const HELD_CURVATURE: f64 = 1e9;

impl MotionFit {
    /// Estimates the curvature of the fit's value along the root and along every joint that has children, each by itself.
    /// Steps of the minimiser are divided by these curvatures. `stiff_frames` are those of the goal.
    pub(super) fn curvatures(&self, stiff_frames: &[usize]) -> Vec<BandedFactorization> {
        let FitOptions {
            nearness,
            smoothness,
            jerk,
            turning,
            rotation,
            stand,
            ..
        } = self.options;
        let frames = self.minimizer.point().len() / FRAME_WIDTH;
        // The weight of all contacts at each frame.
        let mut standing = vec![0.0; self.reference.len()];
        for contact in &self.contacts {
            for standing in &mut standing[contact.from..contact.until] {
                *standing += stand;
            }
        }
        let joints = JOINTS as f64;
        let mut stiff = vec![0.0; self.reference.len()];
        for &frame in stiff_frames {
            stiff[frame] = STIFF_CURVATURE;
        }
        // The differences over the seam of a loop are no part of the banded matrices. Without these numbers, which are not below
        // them, steps there are far too long, and those of the whole motion become short.
        let over_seam = |t: usize, second: f64, third: f64| match self.seam {
            None => 0.0,
            Some(_) => {
                let place = t.min(frames - 1 - t);
                second * seam_bound(&SECOND_DIFFERENCE, place)
                    + third * seam_bound(&THIRD_DIFFERENCE, place)
            }
        };
        // Frames that cannot move do not give way to the frames beside them.
        let of_held = |t: usize| if t < self.held { HELD_CURVATURE } else { 0.0 };
        let third = |t: usize| jerk + smoothness * self.border_factor(t);
        let root_third = |t: usize| 2.0 * third(t) * joints;
        let root = |t: usize| {
            2.0 * (nearness * self.trust[t] * joints + standing[t])
                + stiff[t]
                + over_seam(t, 0.0, root_third(t))
                + of_held(t)
                + 1e-3
        };
        let mut all = vec![BandedFactorization::new(frames, root, 0.0, root_third)];
        let levers = squared_levers(&self.offsets);
        for joint in PARENT_JOINTS {
            // The numbers of a quaternion change half as fast as the angle, which is a factor of 4 on squares.
            let lever = 4.0 * levers[joint.index()];
            let contact_share = if moves_foot(joint) { 0.25 } else { 0.0 };
            let prior = self.options.prior_of(joint);
            let second = 2.0 * (rotation + turning) * self.options.turning_factor(joint);
            let third = |t: usize| 2.0 * third(t) * lever;
            let diagonal = |t: usize| {
                let near = nearness * self.trust[t] * lever;
                2.0 * (near + contact_share * standing[t] + prior)
                    + 0.5 * stiff[t]
                    + over_seam(t, second, third(t))
                    + of_held(t)
                    + 1e-4
            };
            all.push(BandedFactorization::new(frames, diagonal, second, third));
        }
        all
    }
}

/// Returns what the squares of differences over the seam of a loop add to the diagonal at a frame so many frames from the seam, so
/// that the diagonal alone is not below them.
fn seam_bound(factors: &[f64], place: usize) -> f64 {
    let sum = |factors: &[f64]| factors.iter().map(|factor| factor.abs()).sum::<f64>();
    // A frame is the last one of the differences of which all others lie on the other side, the last but one of those …
    factors.get(place + 1..).map_or(0.0, sum) * sum(factors)
}

/// Returns whether a joint moves a foot: whether it is the pelvis, a hip, a knee or an ankle.
fn moves_foot(joint: Joint) -> bool {
    joint == Joint::Pelvis || is_of_leg(joint)
}

/// Returns, for every joint, the sum of its squared distances in the rest pose to all joints that it moves, in m².
fn squared_levers(offsets: &BoneOffsets) -> [f64; JOINTS] {
    let pose = Pose::of(offsets, DVec3::ZERO, &[DQuat::IDENTITY; JOINTS]);
    let mut sums = [0.0; JOINTS];
    for joint in Joint::ALL {
        let position = pose.positions[joint.index()];
        for ancestor in std::iter::successors(joint.parent(), |ancestor| ancestor.parent()) {
            sums[ancestor.index()] += position.distance_squared(pose.positions[ancestor.index()]);
        }
    }
    sums
}
