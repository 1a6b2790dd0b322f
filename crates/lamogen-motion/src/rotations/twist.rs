//! Smooth twist angles over time, fitted to estimates at single frames.

use std::f64::consts::TAU;

/// An estimate of a twist angle at one frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct TwistEstimate {
    /// The angle in radians; adding whole turns changes nothing.
    pub(super) angle: f64,
    /// The weight of the estimate, where keeping the angle from frame to frame has weight 1; 0 if nothing is known.
    pub(super) weight: f64,
}

/// The weight of a twist of 0 at every frame, which decides only where nothing is known at all.
const ZERO_WEIGHT: f64 = 1e-9;

/// Returns the angles, one for each frame, with the least `Σ weight (angle - estimate)² + Σ (angle' - angle)²`, where
/// `angle'` is the angle of the next frame.
///
/// Each of `series` has one estimate for every frame. Whole turns are added to an estimate so that it is as near as
/// possible to the estimates at the frames before.
pub(super) fn smooth_twists(series: &[&[TwistEstimate]]) -> Vec<f64> {
    let frames = series.first().map_or(0, |estimates| estimates.len());
    let (mut diagonal, mut right) = (vec![ZERO_WEIGHT; frames], vec![0.0; frames]);
    let mut last = 0.0;
    for frame in 0..frames {
        // The estimate with the largest weight comes first, and the others are unwrapped to be near it.
        let mut estimates: Vec<TwistEstimate> = series.iter().map(|series| series[frame]).collect();
        estimates.retain(|estimate| estimate.weight > 0.0);
        estimates.sort_by(|a, b| b.weight.total_cmp(&a.weight));
        for (rank, estimate) in estimates.iter().enumerate() {
            let angle = estimate.angle + TAU * ((last - estimate.angle) / TAU).round();
            diagonal[frame] += estimate.weight;
            right[frame] += estimate.weight * angle;
            if rank == 0 {
                last = angle;
            }
        }
    }
    for frame in 1..frames {
        diagonal[frame - 1] += 1.0;
        diagonal[frame] += 1.0;
    }
    // Solve the tridiagonal system, whose off-diagonal entries are -1, by the Thomas algorithm.
    for frame in 1..frames {
        let factor = 1.0 / diagonal[frame - 1];
        diagonal[frame] -= factor;
        right[frame] += factor * right[frame - 1];
    }
    for frame in (0..frames).rev() {
        let next = match frame + 1 < frames {
            true => right[frame + 1],
            false => 0.0,
        };
        right[frame] = (right[frame] + next) / diagonal[frame];
    }
    right
}

#[cfg(test)]
mod tests {
    use super::*;

    fn estimate(angle: f64, weight: f64) -> TwistEstimate {
        TwistEstimate { angle, weight }
    }

    #[test]
    fn what_is_not_known_is_carried_through() {
        let mut estimates = vec![estimate(0.0, 0.0); 11];
        estimates[0] = estimate(1.0, 1e6);
        estimates[10] = estimate(2.0, 1e6);
        for (frame, angle) in smooth_twists(&[&estimates]).into_iter().enumerate() {
            let straight = 1.0 + 0.1 * frame as f64;
            assert!((angle - straight).abs() < 1e-4, "{frame}: {angle}");
        }
    }

    #[test]
    fn a_turn_past_the_end_of_the_circle_goes_on() {
        let estimates: Vec<TwistEstimate> = (0..100)
            .map(|frame| {
                let angle = 0.2 * f64::from(frame);
                estimate(angle - TAU * (angle / TAU).round(), 1e6)
            })
            .collect();
        let angles = smooth_twists(&[&estimates]);
        assert!(
            angles
                .windows(2)
                .all(|pair| (pair[1] - pair[0] - 0.2).abs() < 1e-3)
        );
    }

    #[test]
    fn nothing_known_is_no_twist() {
        assert_eq!(smooth_twists(&[&[estimate(3.0, 0.0); 4]]), [0.0; 4]);
        assert_eq!(smooth_twists(&[&[]]), [0.0; 0]);
    }
}
