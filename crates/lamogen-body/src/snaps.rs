//! Moments at which a whole body snaps round.

use glam::DQuat;
use lamogen_motion::JOINTS;

/// Turns of the pelvis between two frames from which on no body made them, in radians.
const SNAP: f64 = 0.6;
/// What is left of such a turn in a frame once it is spread over time, on average.
const SPREAD: f64 = 0.35;
/// How much frames count that are not believed, against 1: enough to tell a fit where to pass when nothing else does.
const DOUBTED: f64 = 1e-3;

/// How much each frame is to be believed, 0 to 1: hardly at all around frames between which the pelvis snaps round, so that the turn is spread
/// over as many frames as a body needs for it.
pub(crate) fn trust(local: &[[DQuat; JOINTS]]) -> Vec<f64> {
    let mut trust = vec![1.0; local.len()];
    for t in 1..local.len() {
        let turned = local[t][0].angle_between(local[t - 1][0]);
        if turned > SNAP {
            let half = (turned / SPREAD / 2.0).ceil() as usize;
            let first = t.saturating_sub(half);
            let last = (t + half).min(local.len());
            trust[first..last].fill(DOUBTED);
        }
    }
    trust
}

/// Whether a frame is believed.
pub(crate) fn is_believed(trust: f64) -> bool {
    trust > 0.5
}

/// Puts rotations on the way from the last believed frame to the next one where those between are not believed. Of the two quaternions
/// of a rotation the one next to the frame before is taken everywhere.
pub(crate) fn bridge(local: &mut [[DQuat; JOINTS]], trust: &[f64]) {
    let mut start = 0;
    for run in trust.chunk_by(|a, b| is_believed(*a) == is_believed(*b)) {
        let until = start + run.len();
        if !is_believed(run[0]) {
            let before = start.checked_sub(1).map(|t| local[t]);
            let after = local.get(until).copied();
            for (place, pose) in local[start..until].iter_mut().enumerate() {
                let part = (place + 1) as f64 / (run.len() + 1) as f64;
                *pose = match (before, after) {
                    (Some(a), Some(b)) => std::array::from_fn(|j| a[j].slerp(b[j], part)),
                    (Some(only), None) | (None, Some(only)) => only,
                    (None, None) => *pose,
                };
            }
        }
        start = until;
    }
    for t in 1..local.len() {
        let before = local[t - 1];
        for (turn, before) in local[t].iter_mut().zip(before) {
            if turn.dot(before) < 0.0 {
                *turn = -*turn;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn turned(angles: &[f64]) -> Vec<[DQuat; JOINTS]> {
        let pose = |angle: &f64| {
            let mut pose = [DQuat::IDENTITY; JOINTS];
            pose[0] = DQuat::from_rotation_y(*angle);
            pose
        };
        angles.iter().map(pose).collect()
    }

    #[test]
    fn half_a_turn_in_a_frame_is_spread_over_nine() {
        let angles: Vec<f64> = (0..40).map(|t| if t < 20 { 0.0 } else { 3.0 }).collect();
        let mut local = turned(&angles);
        let trust = trust(&local);
        let doubted = trust.iter().filter(|trust| !is_believed(**trust)).count();
        assert_eq!(doubted, 10);
        bridge(&mut local, &trust);
        let largest = local
            .windows(2)
            .map(|pair| pair[0][0].angle_between(pair[1][0]))
            .fold(0.0, f64::max);
        assert!(largest < 0.3, "{largest}");
        assert!(local[39][0].angle_between(turned(&[3.0])[0][0]) < 1e-9);
    }

    #[test]
    fn a_body_that_spins_fast_is_believed() {
        let angles: Vec<f64> = (0..40).map(|t| 0.5 * f64::from(t)).collect();
        assert!(trust(&turned(&angles)).iter().all(|trust| *trust == 1.0));
    }
}
