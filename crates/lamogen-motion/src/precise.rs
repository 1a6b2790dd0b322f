//! Conversion of positions to 64 bits, in which they are rotated and summed.

use glam::DVec3;

use crate::skeleton::JOINTS;

/// Converts a point to 64 bits.
pub(crate) fn vector(point: [f32; 3]) -> DVec3 {
    DVec3::from(point.map(f64::from))
}

/// Converts the joint positions of a pose to 64 bits.
pub(crate) fn points(pose: &[[f32; 3]; JOINTS]) -> [DVec3; JOINTS] {
    pose.map(vector)
}
