//! Two-bone inverse kinematics.

use glam::{DQuat, DVec3};

use crate::precise::smooth_step;

/// The part of its length to which a limb is stretched at most by [`bend_limb`], unless it is straighter already.
pub const MAX_STRETCH: f64 = 0.9999;

/// The distance of the middle joint from the line between the ends of a limb, in units of the first bone, from which on the limb
/// itself says where it bends to.
const CLEAR_BEND: f64 = 0.25;

/// Bends a limb of two bones, given by the places of its joints, so that its end comes to a target. Returns the rotations of both bones
/// in the world. A target that the limb cannot reach is taken in its direction as far as the limb reaches. The bones have lengths.
///
/// The middle joint stays in the plane of the limb, turned with the line from its root to its end. If a pole is given, which is a
/// direction, a limb that is almost straight leans to it by as much as it is bent more than before.
pub fn bend_limb(
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
    // A limb that is straight already may stay so.
    let longest = (end - root).length().max(MAX_STRETCH * (upper + lower));
    let distance = distance.clamp((upper - lower).abs() * 1.0001, longest);
    let along = (upper * upper - lower * lower + distance * distance) / (2.0 * distance);
    let out = (upper * upper - along * along).max(0.0).sqrt();
    // The part of the first bone across the line from root to end is the direction in which the middle joint bends.
    let mut across = swing * (first - old * first.dot(old));
    if let Some(pole) = pole {
        let pole = (pole - new * pole.dot(new)).normalize_or_zero();
        let straightness = 1.0 - smooth_step(across.length() / (CLEAR_BEND * upper));
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
