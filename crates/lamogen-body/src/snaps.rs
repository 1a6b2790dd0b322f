//! Finds frames at which the whole body snaps round, and interpolates across them.

use glam::DQuat;
use lamogen_motion::JOINTS;

/// A turn of the pelvis between two frames by more than this, in radians, is too fast for a real body.
const SNAP_ANGLE: f64 = 0.6;
/// The average turn in a frame, in radians, after such a snap has been spread over several frames.
const SPREAD_ANGLE: f64 = 0.35;
/// The trust in frames around a snap, where other frames have 1. It is just enough to guide a fit where nothing else does.
const SNAP_TRUST: f64 = 1e-3;

/// Returns the trust in each frame, 0 to 1: nearly 0 around frames between which the pelvis snaps round, and 1 elsewhere.
/// A fit can then spread the turn over as many frames as a body needs for it.
pub(crate) fn frame_trust(local: &[[DQuat; JOINTS]]) -> Vec<f64> {
    let mut trust = vec![1.0; local.len()];
    for t in 1..local.len() {
        let turned = local[t][0].angle_between(local[t - 1][0]);
        if turned > SNAP_ANGLE {
            let half = (turned / SPREAD_ANGLE / 2.0).ceil() as usize;
            let first = t.saturating_sub(half);
            let last = (t + half).min(local.len());
            trust[first..last].fill(SNAP_TRUST);
        }
    }
    trust
}

/// Returns whether a frame with this trust may be relied on.
pub(crate) fn is_trusted(trust: f64) -> bool {
    trust > 0.5
}

/// Replaces the rotations of frames that are not trusted by an interpolation between the trusted frames before and after
/// them. At every frame, of the two quaternions of a rotation, the one nearer to that of the frame before is taken.
pub(crate) fn bridge_snaps(local: &mut [[DQuat; JOINTS]], trust: &[f64]) {
    let mut start = 0;
    for run in trust.chunk_by(|a, b| is_trusted(*a) == is_trusted(*b)) {
        let until = start + run.len();
        if !is_trusted(run[0]) {
            let before = start.checked_sub(1).map(|t| local[t]);
            let after = local.get(until).copied();
            for (index, pose) in local[start..until].iter_mut().enumerate() {
                let fraction = (index + 1) as f64 / (run.len() + 1) as f64;
                *pose = match (before, after) {
                    (Some(a), Some(b)) => std::array::from_fn(|j| a[j].slerp(b[j], fraction)),
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

    /// Returns local rotations whose pelvis turns about Y to the given angles in radians.
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
        let trust = frame_trust(&local);
        let untrusted = trust.iter().filter(|trust| !is_trusted(**trust)).count();
        assert_eq!(untrusted, 10);
        bridge_snaps(&mut local, &trust);
        let largest = local
            .windows(2)
            .map(|pair| pair[0][0].angle_between(pair[1][0]))
            .fold(0.0, f64::max);
        assert!(largest < 0.3, "{largest}");
        assert!(local[39][0].angle_between(turned(&[3.0])[0][0]) < 1e-9);
    }

    #[test]
    fn a_body_that_spins_fast_is_trusted() {
        let angles: Vec<f64> = (0..40).map(|t| 0.5 * f64::from(t)).collect();
        assert!(
            frame_trust(&turned(&angles))
                .iter()
                .all(|trust| *trust == 1.0)
        );
    }
}
