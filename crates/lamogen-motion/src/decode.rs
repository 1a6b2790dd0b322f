//! Decodes pose features into joint positions on the host. [`joints`](crate::joints) does the same with tensors and
//! is differentiable, so that a network can be guided through it.

use glam::{DQuat, DVec3};

use crate::features::{FeatureGroup, POSE_FEATURES};
use crate::precise::vector;
use crate::skeleton::{JOINTS, Joint};

/// Returns the global joint positions, in metres, that pose features (not normalised) describe. The motion starts
/// over the origin facing +Z (Guo et al. 2022, `recover_from_ric`).
pub(crate) fn decode(features: &[[f32; POSE_FEATURES]]) -> Vec<[[f32; 3]; JOINTS]> {
    // Half the heading angle in radians: the features store half angles.
    let mut half_heading = 0.0;
    // The point on the ground below the root.
    let mut ground = DVec3::ZERO;
    let mut previous: Option<&[f32; POSE_FEATURES]> = None;
    let poses = features.iter().map(|row| {
        if let Some(previous) = previous.replace(row) {
            half_heading += f64::from(previous[FeatureGroup::RootYaw.range().start]);
            let velocity = FeatureGroup::RootVelocity.range();
            let [x, z] = [previous[velocity.start], previous[velocity.start + 1]].map(f64::from);
            ground += heading_rotation(half_heading) * DVec3::new(x, 0.0, z);
        }
        let height = f64::from(row[FeatureGroup::RootHeight.range().start]);
        let mut pose = [[0.0; 3]; JOINTS];
        pose[Joint::Pelvis.index()] = (ground + height * DVec3::Y).as_vec3().to_array();
        let (locals, _) = row[FeatureGroup::LocalPositions.range()].as_chunks::<3>();
        for (point, &local) in pose[1..].iter_mut().zip(locals) {
            let local = heading_rotation(half_heading) * vector(local);
            *point = (ground + local).as_vec3().to_array();
        }
        pose
    });
    poses.collect()
}

/// Returns the rotation from the frame of the body's heading to the world.
fn heading_rotation(half_heading: f64) -> DQuat {
    DQuat::from_rotation_y(-2.0 * half_heading)
}
