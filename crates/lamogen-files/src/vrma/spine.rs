//! Distribution of the trunk's twist over the bones of the spine.

use glam::{DQuat, DVec3};
use lamogen_motion::{JOINTS, Joint, RestPose, Rotations};

/// The joints of the spine that get a part of the twist, each with the joint above it, and how far it turns with the upper
/// spine: 0 means that it turns as the pelvis does, 1 as the upper spine does.
///
/// All of the twist is below the upper spine, because players leave out the rotation of an upper chest that a character
/// does not have.
const SHARES: [(Joint, Joint, f64); 2] = [
    (Joint::Spine1, Joint::Spine2, 0.5),
    (Joint::Spine2, Joint::Spine3, 1.0),
];

/// Returns rotations that give the same positions of all joints, and in which the lower and the middle spine share the
/// twist between pelvis and upper spine. In [`Rotations::of`] they only swing, and all twist is in the upper spine.
pub(super) fn share_twist(rotations: &Rotations) -> Rotations {
    let mut last = [DQuat::IDENTITY; JOINTS];
    let local = rotations.local().iter().map(|local| {
        let local = local.map(|turn| DQuat::from_array(turn.map(f64::from)).normalize());
        let mut pose = share_twist_of_pose(rotations.rest(), local);
        // Of the two quaternions of a rotation, take the one nearer to that of the frame before.
        for (turn, last) in pose.iter_mut().zip(&mut last) {
            if turn.dot(*last) < 0.0 {
                *turn = -*turn;
            }
            *last = *turn;
        }
        pose.map(|turn| turn.to_array().map(|x| x as f32))
    });
    let local = local.collect();
    Rotations::new(
        rotations.rest().clone(),
        rotations.root().to_vec(),
        local,
        rotations.frames_per_second(),
    )
}

/// Shares the twist in one pose, which is given by its local rotations.
fn share_twist_of_pose(rest: &RestPose, mut local: [DQuat; JOINTS]) -> [DQuat; JOINTS] {
    let pelvis = local[Joint::Pelvis.index()];
    let mut upper = pelvis;
    let mut solved = Vec::with_capacity(SHARES.len());
    for (joint, ..) in SHARES {
        upper *= local[joint.index()];
        solved.push(upper);
    }
    upper *= local[Joint::Spine3.index()];

    let mut above = pelvis;
    for ((joint, child, share), solved) in SHARES.into_iter().zip(solved) {
        let bone = DVec3::from(rest.offset(child).map(f64::from));
        let turn = match bone.try_normalize() {
            // The bone keeps its direction; only its twist changes.
            Some(bone) => {
                let twisted = pelvis.slerp(upper, share);
                DQuat::from_rotation_arc(twisted * bone, solved * bone) * twisted
            }
            None => solved,
        };
        local[joint.index()] = (above.inverse() * turn).normalize();
        above = turn;
    }
    local[Joint::Spine3.index()] = (above.inverse() * upper).normalize();
    local
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::glb::example;

    /// Returns the twist of a rotation about an axis, in degrees.
    fn twist(turn: DQuat, axis: DVec3) -> f64 {
        2.0 * turn.xyz().dot(axis).atan2(turn.w).to_degrees()
    }

    #[test]
    fn joints_stay_where_they_are_and_numbers_do_not_jump() {
        let rotations = example::rotations();
        let shared = share_twist(&rotations);
        assert_ne!(shared, rotations);
        for (found, expected) in shared.joints().iter().zip(rotations.joints()) {
            for (found, expected) in found.iter().zip(expected) {
                let gap =
                    DVec3::from(found.map(f64::from)).distance(expected.map(f64::from).into());
                assert!(gap < 1e-6, "{gap}");
            }
        }
        for pair in shared.local().windows(2) {
            for (a, b) in pair[0].iter().zip(&pair[1]) {
                assert!(a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>() > 0.0);
            }
        }
    }

    #[test]
    fn the_twist_of_the_shoulders_is_in_spine_and_chest() {
        let mut local = [DQuat::IDENTITY; JOINTS];
        local[Joint::Spine3.index()] = DQuat::from_rotation_y(0.6);
        let pose = share_twist_of_pose(&RestPose::humanml3d(), local);
        let degrees = 0.6f64.to_degrees();
        for (joint, share) in [
            (Joint::Spine1, 0.5),
            (Joint::Spine2, 0.5),
            (Joint::Spine3, 0.0),
        ] {
            let found = twist(pose[joint.index()], DVec3::Y);
            assert!((found - share * degrees).abs() < 1e-9, "{}", joint.name());
        }
    }
}
