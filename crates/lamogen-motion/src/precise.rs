//! Positions in 64 bits, in which they are turned and summed.

use glam::DVec3;

use crate::skeleton::JOINTS;

pub(crate) fn vector(point: [f32; 3]) -> DVec3 {
    DVec3::from(point.map(f64::from))
}

pub(crate) fn points(pose: &[[f32; 3]; JOINTS]) -> [DVec3; JOINTS] {
    pose.map(vector)
}
