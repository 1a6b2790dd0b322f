//! The seam of a loop: a jump between its last frame and its first is spread over the frames around it.

use glam::{DQuat, DVec3};
use lamogen_motion::{JOINTS, smooth_step};

use crate::pose::{BoneOffsets, Pose};

/// The number of frames before and after the seam over which a jump is spread.
const SPREAD: usize = 10;

/// Removes the travel of a loop that is played several times, evenly over its frames. Its first frame stays where it is.
pub(crate) fn remove_travel(frames: usize, reference: &mut [[DVec3; JOINTS]]) {
    let travel = (reference[frames][0] - reference[0][0]) * DVec3::new(1.0, 0.0, 1.0);
    for (t, pose) in reference.iter_mut().enumerate() {
        let shift = travel * (t as f64 / frames as f64);
        for place in pose {
            *place -= shift;
        }
    }
}

/// Closes the seams of a loop that is played three times: spreads the jumps between its cycles over the frames around them.
pub(crate) fn close_seams(
    offsets: &BoneOffsets,
    frames: usize,
    reference: &mut [[DVec3; JOINTS]],
    solved: &mut [[DQuat; JOINTS]],
) {
    let travel = (reference[frames][0] - reference[0][0]) * DVec3::new(1.0, 0.0, 1.0);
    // The second cycle knows what is before and after it. The others are copies of it.
    let cycle = frames..2 * frames;
    let mut root: Vec<DVec3> = reference[cycle.clone()]
        .iter()
        .map(|pose| pose[0])
        .collect();
    let mut local = solved[cycle].to_vec();
    close_seam(&mut root, &mut local, travel);
    for t in 0..reference.len() {
        let (cycle, frame) = (t / frames, t % frames);
        let place = root[frame] + (cycle as f64 - 1.0) * travel;
        for (own, new) in solved[t].iter_mut().zip(local[frame]) {
            // The sign goes on as it was.
            *own = if own.dot(new) < 0.0 { -new } else { new };
        }
        reference[t] = Pose::of(offsets, place, &solved[t]).positions;
    }
}

/// Spreads what is left of a jump between the last frame of a loop and the first one, which follows it, over the frames around:
/// of positions and of velocities, of the root and of the local rotations. The step at the seam becomes the mean of the steps
/// beside it, and the velocities beside it differ by what the accelerations there say.
///
/// `travel` is the travel of a cycle in metres. Loops of fewer than six frames are left as they are.
fn close_seam(root: &mut [DVec3], local: &mut [[DQuat; JOINTS]], travel: DVec3) {
    let frames = root.len();
    let spread = SPREAD.min(frames / 2);
    if frames < 6 {
        return;
    }
    let last = frames - 1;
    let root_step = |from: usize, to: usize| match from == last {
        true => root[to] + travel - root[from],
        false => root[to] - root[from],
    };
    let root_jump = SeamJump::new(root_step, last);
    let turn_jumps: [SeamJump; JOINTS] = std::array::from_fn(|joint| {
        let at = |frame: usize| local[frame][joint];
        let step =
            |from: usize, to: usize| (at(from).inverse() * near(at(to), at(from))).to_scaled_axis();
        SeamJump::new(step, last)
    });
    for k in 0..spread {
        for (frame, side) in [(last - k, 1.0), (k, -1.0)] {
            root[frame] += root_jump.correction(k, side, spread);
            for (jump, joint) in turn_jumps.iter().zip(&mut local[frame]) {
                let turn = DQuat::from_scaled_axis(jump.correction(k, side, spread));
                *joint = (*joint * turn).normalize();
            }
        }
    }
}

/// What is left over at a seam, compared with the frames beside it.
#[derive(Clone, Copy, Debug)]
struct SeamJump {
    /// The part of the step at the seam that goes beyond the mean of the steps beside it.
    position: DVec3,
    /// The part of the difference between the steps beside the seam that goes beyond what the accelerations beside it say.
    velocity: DVec3,
}

impl SeamJump {
    /// Measures the jump between the last frame and frame 0. `step` returns the step from a frame to another.
    fn new(step: impl Fn(usize, usize) -> DVec3, last: usize) -> SeamJump {
        let (before, after) = (step(last - 1, last), step(0, 1));
        let accelerations = before - step(last - 2, last - 1) + step(1, 2) - after;
        SeamJump {
            position: step(last, 0) - (before + after) / 2.0,
            velocity: after - before - accelerations,
        }
    }

    /// Returns the change of a frame that is `k` frames from the end of the loop (`side` is 1) or from its beginning (-1).
    fn correction(&self, k: usize, side: f64, spread: usize) -> DVec3 {
        let share = jump_share(k, spread) / 2.0;
        share * (side * self.position - k as f64 * self.velocity)
    }
}

/// Returns the share of a jump at a frame so many frames from it: 1 at the jump, 0 from `spread` frames on.
pub(crate) fn jump_share(frame: usize, spread: usize) -> f64 {
    1.0 - smooth_step(frame as f64 / spread as f64)
}

/// Returns of the two quaternions of a rotation the one nearer to another.
fn near(turn: DQuat, to: DQuat) -> DQuat {
    if turn.dot(to) < 0.0 { -turn } else { turn }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_jump_at_the_seam_becomes_a_step_like_its_neighbours() {
        let frames = 40;
        let angle = |frame: usize| 0.02 * frame as f64;
        let mut root: Vec<DVec3> = (0..frames)
            .map(|frame| DVec3::new(0.01 * frame as f64, 0.9, 0.0))
            .collect();
        let mut local: Vec<[DQuat; JOINTS]> = (0..frames)
            .map(|frame| [DQuat::from_rotation_y(angle(frame)); JOINTS])
            .collect();
        let travel = DVec3::new(0.5, 0.0, 0.0);
        close_seam(&mut root, &mut local, travel);
        let step = root[0] + travel - root[frames - 1];
        assert!((step.x - 0.01).abs() < 0.002, "{step}");
        let turn = local[frames - 1][0].angle_between(local[0][0]);
        assert!((turn - 0.02).abs() < 0.03, "{turn}");
        // Nothing moves far from the seam.
        assert_eq!(root[20], DVec3::new(0.2, 0.9, 0.0));
        for pair in root.windows(2) {
            assert!((pair[1] - pair[0]).length() < 0.02);
        }
    }

    #[test]
    fn a_closed_loop_stays_as_it_is() {
        let frames = 40;
        let angle = |frame: usize| std::f64::consts::TAU * frame as f64 / frames as f64;
        let mut root: Vec<DVec3> = (0..frames)
            .map(|frame| DVec3::new(angle(frame).sin(), 0.9, angle(frame).cos()))
            .collect();
        let turn = |frame: usize| DQuat::from_rotation_x(0.4 * angle(frame).sin());
        let mut local: Vec<[DQuat; JOINTS]> =
            (0..frames).map(|frame| [turn(frame); JOINTS]).collect();
        let (old_root, old_local) = (root.clone(), local.clone());
        close_seam(&mut root, &mut local, DVec3::ZERO);
        for frame in 0..frames {
            assert!(root[frame].distance(old_root[frame]) < 2e-3);
            assert!(local[frame][3].angle_between(old_local[frame][3]) < 2e-3);
        }
    }
}
