//! The frames of a clip: moments at equal distances on which an animation's keyframes lie, or lie near.

use gltf_json::animation::Interpolation;
use lamogen_motion::FRAMES_PER_SECOND;

use super::curve::{Curve, Value};

/// Keyframes nearer than this, in seconds, are one.
const ONE_MOMENT: f64 = 5e-4;
/// Frames a second where keyframes follow no common grid.
const FINE: f64 = 120.0;
/// Frames a second at least where something is not linear between keyframes.
const BENT: f64 = 60.0;
/// How far keyframes may lie beside a common grid, in parts of its frame.
const OFF_GRID: f64 = 0.02;

/// Moments at equal distances.
pub(super) struct Grid {
    start: f64,
    pub(super) step: f64,
    pub(super) frames: usize,
}

impl Grid {
    /// The moments for curves whose keyframes are at these times: their common grid, or a fine one.
    pub(super) fn of(curves: &[(&[f64], Interpolation)]) -> Grid {
        let mut times: Vec<f64> = curves
            .iter()
            .flat_map(|(times, _)| *times)
            .copied()
            .collect();
        times.sort_by(f64::total_cmp);
        let mut last = f64::NEG_INFINITY;
        times.retain(|&time| {
            let is_new = time - last > ONE_MOMENT;
            if is_new {
                last = time;
            }
            is_new
        });
        let still = 1.0 / f64::from(FRAMES_PER_SECOND);
        let [start, .., end] = times[..] else {
            return Grid {
                start: times.first().copied().unwrap_or(0.0),
                step: still,
                frames: 1,
            };
        };
        let gaps = times.windows(2).map(|pair| pair[1] - pair[0]);
        let shortest = gaps.clone().fold(f64::INFINITY, f64::min);
        // Times are rounded to 32 bits; only all gaps together tell the step well.
        let steps: f64 = gaps.map(|gap| (gap / shortest).round()).sum();
        let mut step = (end - start) / steps;
        let is_on_grid = times.iter().all(|time| {
            let steps = (time - start) / step;
            (steps - steps.round()).abs() < OFF_GRID
        });
        if !is_on_grid {
            step = 1.0 / FINE;
        }
        let is_bent = |&(times, interpolation): &(&[f64], Interpolation)| {
            times.len() > 1 && interpolation != Interpolation::Linear
        };
        if curves.iter().any(is_bent) {
            step /= (step * BENT - 1e-6).ceil().max(1.0);
        }
        let last = ((end - start) / step - OFF_GRID).ceil();
        Grid {
            start,
            step,
            frames: (last as usize).saturating_add(1),
        }
    }

    /// A curve at all moments; one value where it does not change.
    pub(super) fn sampled<T: Value>(&self, curve: &Curve<T>) -> Vec<T> {
        let frames = match curve.is_constant() {
            true => 1,
            false => self.frames,
        };
        (0..frames)
            .map(|frame| curve.at(self.start + frame as f64 * self.step, OFF_GRID * self.step))
            .collect()
    }
}
