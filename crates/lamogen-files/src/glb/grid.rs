//! The frames of a clip: times at equal intervals that match the keyframes of an animation exactly or nearly.

use gltf_json::animation::Interpolation;
use lamogen_motion::FRAMES_PER_SECOND;

use super::curve::{KeyframeCurve, KeyframeValue};

/// The interval in seconds below which two keyframes count as being at the same time.
const SAME_TIME: f64 = 5e-4;
/// The frame rate for keyframes that lie on no common grid.
const IRREGULAR_RATE: f64 = 120.0;
/// The lowest frame rate for curves that are not linear between keyframes.
const MIN_NONLINEAR_RATE: f64 = 60.0;
/// The largest distance of a keyframe from a frame of the grid, as a fraction of the interval between frames.
const GRID_TOLERANCE: f64 = 0.02;

/// The times of frames at equal intervals.
pub(super) struct FrameTimes {
    /// The time of the first frame, in seconds.
    start: f64,
    /// The interval between frames, in seconds.
    pub(super) step: f64,
    pub(super) frames: usize,
}

impl FrameTimes {
    /// Creates the grid for curves, given by the times of their keyframes and their interpolation: the common grid of the
    /// keyframes, or a fine one if there is none.
    pub(super) fn of_curves(curves: &[(&[f64], Interpolation)]) -> FrameTimes {
        let mut times: Vec<f64> = curves
            .iter()
            .flat_map(|(times, _)| *times)
            .copied()
            .collect();
        times.sort_by(f64::total_cmp);
        let mut last = f64::NEG_INFINITY;
        times.retain(|&time| {
            let is_new = time - last > SAME_TIME;
            if is_new {
                last = time;
            }
            is_new
        });
        let default_step = 1.0 / f64::from(FRAMES_PER_SECOND);
        let [start, .., end] = times[..] else {
            return FrameTimes {
                start: times.first().copied().unwrap_or(0.0),
                step: default_step,
                frames: 1,
            };
        };
        let gaps = times.windows(2).map(|pair| pair[1] - pair[0]);
        let shortest = gaps.clone().fold(f64::INFINITY, f64::min);
        // Times are rounded to 32 bits, so the step is precise only if it is computed from all gaps together.
        let steps: f64 = gaps.map(|gap| (gap / shortest).round()).sum();
        let mut step = (end - start) / steps;
        let is_on_grid = times.iter().all(|time| {
            let steps = (time - start) / step;
            (steps - steps.round()).abs() < GRID_TOLERANCE
        });
        if !is_on_grid {
            step = 1.0 / IRREGULAR_RATE;
        }
        let is_nonlinear = |&(times, interpolation): &(&[f64], Interpolation)| {
            times.len() > 1 && interpolation != Interpolation::Linear
        };
        if curves.iter().any(is_nonlinear) {
            step /= (step * MIN_NONLINEAR_RATE - 1e-6).ceil().max(1.0);
        }
        let last = ((end - start) / step - GRID_TOLERANCE).ceil();
        FrameTimes {
            start,
            step,
            frames: (last as usize).saturating_add(1),
        }
    }

    /// Returns the values of a curve at all frames, or a single value if it does not change.
    pub(super) fn sample<T: KeyframeValue>(&self, curve: &KeyframeCurve<T>) -> Vec<T> {
        let frames = match curve.is_constant() {
            true => 1,
            false => self.frames,
        };
        (0..frames)
            .map(|frame| {
                curve.value_at(
                    self.start + frame as f64 * self.step,
                    GRID_TOLERANCE * self.step,
                )
            })
            .collect()
    }
}
