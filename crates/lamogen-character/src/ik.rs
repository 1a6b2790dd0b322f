//! Two-bone inverse kinematics, and the curves over which a limb is drawn to its target.

use glam::{DQuat, DVec3};
use lamogen_motion::smooth_step;

/// The part of its length to which a limb is stretched at most.
pub(crate) const MAX_STRETCH: f64 = 0.9999;

/// The distance of the middle joint from the line between the ends of a limb, in units of the first bone, from which on the limb
/// itself says where it bends to.
const CLEAR_BEND: f64 = 0.25;

/// Bends a limb of two bones so that its end comes to a target. Returns the rotations of both bones in the world.
///
/// The middle joint stays in the plane of the limb, turned with the line from its root to its end. If a pole is given, which is a
/// direction, a limb that is almost straight leans to it by as much as it is bent more than before.
pub(crate) fn bend(
    [root, middle, end]: [DVec3; 3],
    target: DVec3,
    pole: Option<DVec3>,
) -> [DQuat; 2] {
    let (first, second) = (middle - root, end - middle);
    let (upper, lower) = (first.length(), second.length());
    let (Some(old), Some(new)) = (
        (end - root).try_normalize(),
        (target - root).try_normalize(),
    ) else {
        return [DQuat::IDENTITY; 2];
    };
    let swing = DQuat::from_rotation_arc(old, new);
    let distance = (target - root).length();
    let distance = distance.clamp(
        (upper - lower).abs() * 1.0001,
        MAX_STRETCH * (upper + lower),
    );
    let along = (upper * upper - lower * lower + distance * distance) / (2.0 * distance);
    let out = (upper * upper - along * along).max(0.0).sqrt();
    // The part of the first bone across the line from root to end is the direction in which the middle joint bends.
    let mut across = swing * (first - old * first.dot(old));
    if let Some(pole) = pole {
        let pole = (pole - new * pole.dot(new)).normalize_or_zero();
        let straightness = fade(across.length() / (CLEAR_BEND * upper));
        across += straightness * pole * (out - across.length()).max(0.0);
    }
    let across = match across.length() > 1e-6 * upper {
        true => across.normalize(),
        false => swing * old.any_orthonormal_vector(),
    };
    let new_middle = root + new * along + across * out;
    let new_end = root + new * distance;
    let arc = |from: DVec3, to: DVec3| DQuat::from_rotation_arc(from.normalize(), to.normalize());
    [
        arc(first, new_middle - root),
        arc(second, new_end - new_middle),
    ]
}

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
