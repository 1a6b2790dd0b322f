//! The trunk of a motion as the two bones that players turn on every character: spine and chest.

use glam::{DQuat, DVec3};
use lamogen_motion::{JOINTS, Joint, Rotations};

/// How far the spine twists with the chest: 0 means that it twists as the hips do, 1 as the chest does.
const TWIST_SHARE: f64 = 0.5;

/// The rotations of the bones of a VRM animation.
pub(super) struct TrunkBones {
    /// The local rotations. The middle spine has none, and that of the upper spine, the chest, is relative to the lower spine.
    pub(super) rotations: Rotations,
    /// The position of the upper spine at every frame, relative to the middle spine and in the frame of the lower spine, in
    /// metres.
    pub(super) chest_offsets: Vec<[f32; 3]>,
}

impl TrunkBones {
    /// Distributes the rotations of the three joints of the spine.
    ///
    /// The chest gets the rotation of the upper spine in the world. The spine points where the lower spine does, and twists half
    /// as far as the chest; in [`Rotations::of`] it only swings, and all twist is in the upper spine.
    pub(super) fn of(rotations: &Rotations) -> TrunkBones {
        let mut last = [DQuat::IDENTITY; JOINTS];
        let frames = rotations.local().iter().map(|local| {
            let local = local.map(|turn| DQuat::from_array(turn.map(f64::from)).normalize());
            let (mut pose, offset) = trunk_of_pose(rotations, local);
            // Of the two quaternions of a rotation, take the one nearer to that of the frame before.
            for (turn, last) in pose.iter_mut().zip(&mut last) {
                if turn.dot(*last) < 0.0 {
                    *turn = -*turn;
                }
                *last = *turn;
            }
            let pose = pose.map(|turn| turn.to_array().map(|x| x as f32));
            (pose, offset.as_vec3().to_array())
        });
        let (local, chest_offsets) = frames.unzip();
        let rest = rotations.rest().clone();
        let rate = rotations.frames_per_second();
        TrunkBones {
            rotations: Rotations::new(rest, rotations.root().to_vec(), local, rate),
            chest_offsets,
        }
    }
}

/// Returns the local rotations of the bones in one pose, and the position of the chest relative to the middle spine.
fn trunk_of_pose(rotations: &Rotations, mut local: [DQuat; JOINTS]) -> ([DQuat; JOINTS], DVec3) {
    let offset = |joint: Joint| DVec3::from(rotations.rest().offset(joint).map(f64::from));
    let hips = local[Joint::Pelvis.index()];
    let lower = hips * local[Joint::Spine1.index()];
    let middle = lower * local[Joint::Spine2.index()];
    let chest = middle * local[Joint::Spine3.index()];
    let spine = match offset(Joint::Spine2).try_normalize() {
        // The bone keeps its direction; only its twist changes.
        Some(bone) => {
            let twisted = hips.slerp(chest, TWIST_SHARE);
            DQuat::from_rotation_arc(twisted * bone, lower * bone) * twisted
        }
        None => lower,
    };
    local[Joint::Spine1.index()] = (hips.inverse() * spine).normalize();
    local[Joint::Spine2.index()] = DQuat::IDENTITY;
    local[Joint::Spine3.index()] = (spine.inverse() * chest).normalize();
    (local, spine.inverse() * (middle * offset(Joint::Spine3)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::glb::example;
    use lamogen_motion::RestPose;

    /// Returns the twist of a rotation about Y, in degrees.
    fn twist(turn: DQuat) -> f64 {
        2.0 * turn.y.atan2(turn.w).to_degrees()
    }

    #[test]
    fn the_numbers_of_rotations_do_not_jump() {
        let bones = TrunkBones::of(&example::rotations());
        for pair in bones.rotations.local().windows(2) {
            for (a, b) in pair[0].iter().zip(&pair[1]) {
                assert!(a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>() > 0.0);
            }
        }
    }

    #[test]
    fn spine_and_chest_share_the_twist_of_the_shoulders() {
        let mut local = [DQuat::IDENTITY; JOINTS];
        local[Joint::Spine2.index()] = DQuat::from_rotation_x(0.4);
        local[Joint::Spine3.index()] = DQuat::from_rotation_x(-0.4) * DQuat::from_rotation_y(0.6);
        let rest = RestPose::humanml3d();
        let rotations = Rotations::new(
            rest,
            vec![[0.0; 3]],
            vec![[[0.0, 0.0, 0.0, 1.0]; JOINTS]],
            20.0,
        );
        let (pose, offset) = trunk_of_pose(&rotations, local);
        for joint in [Joint::Spine1, Joint::Spine3] {
            let found = twist(pose[joint.index()]);
            assert!(
                (found - 0.3f64.to_degrees()).abs() < 1e-9,
                "{}",
                joint.name()
            );
        }
        assert_eq!(pose[Joint::Spine2.index()], DQuat::IDENTITY);
        // The upper spine is where it was: in front of the middle spine, by the bend of the middle spine.
        let world = pose[Joint::Spine1.index()] * offset;
        let bone = f64::from(rotations.rest().offset(Joint::Spine3)[1]);
        assert!(world.abs_diff_eq(
            DVec3::new(0.0, bone * 0.4f64.cos(), bone * 0.4f64.sin()),
            1e-9
        ));
    }
}
