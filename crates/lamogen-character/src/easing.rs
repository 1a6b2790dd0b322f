//! The curves over which a limb is drawn to its target.

use lamogen_motion::smooth_step;

/// Returns a smooth curve that is nowhere below the values, which are 0 or more. It is above 0 up to twice `reach` frames
/// before and after a value that is.
pub(crate) fn soften(values: &[f64], reach: usize) -> Vec<f64> {
    let around = |frame: usize| frame.saturating_sub(reach)..(frame + reach + 1).min(values.len());
    let largest: Vec<f64> = (0..values.len())
        .map(|frame| values[around(frame)].iter().copied().fold(0.0, f64::max))
        .collect();
    (0..values.len())
        .map(|frame| {
            let range = around(frame);
            largest[range.clone()].iter().sum::<f64>() / range.len() as f64
        })
        .collect()
}

/// Returns 1 at 0, 0 from 1 on, and a smooth curve between.
pub(crate) fn fade(distance: f64) -> f64 {
    1.0 - smooth_step(distance)
}
