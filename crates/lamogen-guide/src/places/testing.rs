//! A body for the tests of places.

use lamogen_motion::{JOINTS, Joint};

/// A body that stands at a place, turned to the left by an angle.
pub(super) fn pose([x, z]: [f32; 2], angle: f32) -> [[f32; 3]; JOINTS] {
    let (sin, cos) = angle.sin_cos();
    let mut pose = [[x, 0.9, z]; JOINTS];
    for (joint, left) in [
        (Joint::LeftHip, 0.1),
        (Joint::RightHip, -0.1),
        (Joint::LeftShoulder, 0.2),
        (Joint::RightShoulder, -0.2),
    ] {
        pose[joint.index()] = [x + left * cos, 0.9, z - left * sin];
    }
    pose
}
