//! Positions in 64 bits, in which they are rotated and summed, and the curve over which one passes to another.

use glam::DVec3;

use crate::skeleton::JOINTS;

/// Converts a point to 64 bits.
pub(crate) fn vector(point: [f32; 3]) -> DVec3 {
    DVec3::from(point.map(f64::from))
}

/// Returns a curve from 0 to 1 that begins and ends level: the share of what follows at the part `part` of the way. It stays 0 before
/// the way and 1 after it.
pub fn smooth_step(part: f64) -> f64 {
    let part = part.clamp(0.0, 1.0);
    part * part * (3.0 - 2.0 * part)
}

/// Converts the joint positions of a pose to 64 bits.
pub(crate) fn points(pose: &[[f32; 3]; JOINTS]) -> [DVec3; JOINTS] {
    pose.map(vector)
}
