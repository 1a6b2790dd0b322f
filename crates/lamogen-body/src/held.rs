//! The frames that a fit begins with and does not move.

use glam::{DQuat, DVec3};
use lamogen_motion::{JOINTS, Rotations};

use crate::pose::positions;
use crate::seam::jump_share;

/// The number of frames after held ones over which the body comes to its own height and its own rotations: one second.
const HELD_FRAMES: usize = 20;

/// Puts the frames that a fit begins with in the place of the first ones. The others are moved along the ground, since a path
/// that was scaled to the body's size does not lead on from them. So was their height, by legs that a network stretches little by
/// little after frames that are known to it; they come to it within a second.
pub(crate) fn hold_start(start: &Rotations, reference: &mut [[DVec3; JOINTS]]) {
    let held = start.frames().min(reference.len());
    let poses = &positions(start)[..held];
    if let Some(last) = poses.last() {
        let shift = last[0] - reference[held - 1][0];
        for (t, pose) in reference[held..].iter_mut().enumerate() {
            let height = jump_share(t + 1, HELD_FRAMES);
            let shift = shift * DVec3::new(1.0, height, 1.0);
            for place in pose {
                *place += shift;
            }
        }
    }
    reference[..held].copy_from_slice(poses);
}

/// Puts the rotations of the frames that a fit begins with in the place of the first ones. The others come to their own within a
/// second.
pub(crate) fn hold_turns(start: &Rotations, solved: &mut [[DQuat; JOINTS]]) {
    let held = start.frames().min(solved.len());
    let before = held.checked_sub(1).map(|last| solved[last]);
    for (frame, turns) in start.local().iter().zip(&mut *solved) {
        for (turn, own) in frame.iter().zip(turns) {
            let turn = DQuat::from_array(turn.map(f64::from)).normalize();
            // Both signs are the same rotation; the numbers of the next frame are near to those of the frame's own.
            *own = turn * turn.dot(*own).signum();
        }
    }
    let Some(before) = before else {
        return;
    };
    let (held, after) = solved.split_at_mut(held);
    let last = held[held.len() - 1];
    let jumps: [DVec3; JOINTS] =
        std::array::from_fn(|joint| (before[joint].inverse() * last[joint]).to_scaled_axis());
    for (t, turns) in after.iter_mut().enumerate() {
        let share = jump_share(t + 1, HELD_FRAMES);
        for (turn, jump) in turns.iter_mut().zip(jumps) {
            *turn = (*turn * DQuat::from_scaled_axis(share * jump)).normalize();
        }
    }
}
