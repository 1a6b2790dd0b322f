//! From pose features to joint positions, on the host. [`joints`](crate::joints) does the same to tensors, so
//! that a network can be guided through it.

use glam::{DQuat, DVec3};

use crate::features::{FeatureGroup, POSE_FEATURES};
use crate::precise::vector;
use crate::skeleton::{JOINTS, Joint};

/// Global joint positions in metres of pose features (not normalised): the motion starts over the origin facing
/// +Z (Guo et al. 2022, `recover_from_ric`).
pub(crate) fn decode(features: &[[f32; POSE_FEATURES]]) -> Vec<[[f32; 3]; JOINTS]> {
    // Half the angle: the features count it so.
    let mut heading = 0.0;
    let mut ground = DVec3::ZERO;
    let mut before: Option<&[f32; POSE_FEATURES]> = None;
    let poses = features.iter().map(|row| {
        if let Some(before) = before.replace(row) {
            heading += f64::from(before[FeatureGroup::RootYaw.range().start]);
            let velocity = FeatureGroup::RootVelocity.range();
            let [x, z] = [before[velocity.start], before[velocity.start + 1]].map(f64::from);
            ground += turn(heading) * DVec3::new(x, 0.0, z);
        }
        let height = f64::from(row[FeatureGroup::RootHeight.range().start]);
        let mut pose = [[0.0; 3]; JOINTS];
        pose[Joint::Pelvis.index()] = (ground + height * DVec3::Y).as_vec3().to_array();
        let (locals, _) = row[FeatureGroup::LocalPositions.range()].as_chunks::<3>();
        for (point, &local) in pose[1..].iter_mut().zip(locals) {
            let local = turn(heading) * vector(local);
            *point = (ground + local).as_vec3().to_array();
        }
        pose
    });
    poses.collect()
}

/// From the body's heading into the world.
fn turn(half_angle: f64) -> DQuat {
    DQuat::from_rotation_y(-2.0 * half_angle)
}
