//! Twists over time: near what is known at some frames, smooth between.

use std::f64::consts::TAU;

/// What is known of a twist at one frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hint {
    /// In radians; whole turns do not count.
    pub(super) angle: f64,
    /// How much it counts, against 1 for turning no further from frame to frame; 0 where nothing is known.
    pub(super) weight: f64,
}

/// Where nothing is known at all, a twist of 0.
const NOTHING: f64 = 1e-9;

/// The angles with the least `Σ weight (angle - hint)² + Σ (angle' - angle)²`, over hints of one or several
/// kinds for the same frames. Whole turns are taken so that every hint is next to the hints before it.
pub(super) fn smooth(kinds: &[&[Hint]]) -> Vec<f64> {
    let frames = kinds.first().map_or(0, |hints| hints.len());
    let (mut diagonal, mut right) = (vec![NOTHING; frames], vec![0.0; frames]);
    let mut last = 0.0;
    for frame in 0..frames {
        // The weightiest first: the others go next to it.
        let mut hints: Vec<Hint> = kinds.iter().map(|hints| hints[frame]).collect();
        hints.retain(|hint| hint.weight > 0.0);
        hints.sort_by(|a, b| b.weight.total_cmp(&a.weight));
        for (place, hint) in hints.iter().enumerate() {
            let angle = hint.angle + TAU * ((last - hint.angle) / TAU).round();
            diagonal[frame] += hint.weight;
            right[frame] += hint.weight * angle;
            if place == 0 {
                last = angle;
            }
        }
    }
    for frame in 1..frames {
        diagonal[frame - 1] += 1.0;
        diagonal[frame] += 1.0;
    }
    // Neighbours are joined by -1: Thomas' elimination of a system with three diagonals.
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

    fn hint(angle: f64, weight: f64) -> Hint {
        Hint { angle, weight }
    }

    #[test]
    fn what_is_not_known_is_carried_through() {
        let mut hints = vec![hint(0.0, 0.0); 11];
        hints[0] = hint(1.0, 1e6);
        hints[10] = hint(2.0, 1e6);
        for (frame, angle) in smooth(&[&hints]).into_iter().enumerate() {
            let straight = 1.0 + 0.1 * frame as f64;
            assert!((angle - straight).abs() < 1e-4, "{frame}: {angle}");
        }
    }

    #[test]
    fn a_turn_past_the_end_of_the_circle_goes_on() {
        let hints: Vec<Hint> = (0..100)
            .map(|frame| {
                let angle = 0.2 * f64::from(frame);
                hint(angle - TAU * (angle / TAU).round(), 1e6)
            })
            .collect();
        let angles = smooth(&[&hints]);
        assert!(
            angles
                .windows(2)
                .all(|pair| (pair[1] - pair[0] - 0.2).abs() < 1e-3)
        );
    }

    #[test]
    fn nothing_known_is_no_twist() {
        assert_eq!(smooth(&[&[hint(3.0, 0.0); 4]]), [0.0; 4]);
        assert_eq!(smooth(&[&[]]), [0.0; 0]);
    }
}
