//! Poses of a body: forward kinematics of a single one, with its gradient, and the poses that a motion has on a body.

use glam::{DQuat, DVec3};
use lamogen_motion::{JOINTS, Joint, Motion, RestPose, Rotations};

/// The joints that have children, so that their rotation moves other joints: all but head, wrists and feet.
pub(crate) const PARENT_JOINTS: [Joint; 17] = [
    Joint::Pelvis,
    Joint::LeftHip,
    Joint::RightHip,
    Joint::Spine1,
    Joint::LeftKnee,
    Joint::RightKnee,
    Joint::Spine2,
    Joint::LeftAnkle,
    Joint::RightAnkle,
    Joint::Spine3,
    Joint::Neck,
    Joint::LeftCollar,
    Joint::RightCollar,
    Joint::LeftShoulder,
    Joint::RightShoulder,
    Joint::LeftElbow,
    Joint::RightElbow,
];

/// The index of the parent of every joint; the pelvis is its own parent.
pub(crate) const PARENTS: [usize; JOINTS] = {
    let mut parents = [0; JOINTS];
    let mut joint = 1;
    while joint < JOINTS {
        parents[joint] = match Joint::ALL[joint].parent() {
            Some(parent) => parent.index(),
            None => 0,
        };
        joint += 1;
    }
    parents
};

/// The offset of every joint from its parent in the rest pose, in metres.
#[derive(Clone, Debug)]
pub(crate) struct BoneOffsets(pub(crate) [DVec3; JOINTS]);

impl BoneOffsets {
    pub(crate) fn of(rest: &RestPose) -> BoneOffsets {
        BoneOffsets(Joint::ALL.map(|joint| DVec3::from(rest.offset(joint).map(f64::from))))
    }
}

/// The position and the rotation of every joint in the world.
#[derive(Clone, Debug)]
pub(crate) struct Pose {
    pub(crate) positions: [DVec3; JOINTS],
    pub(crate) global: [DQuat; JOINTS],
}

impl Pose {
    /// Computes the pose of a root position and local rotations, whose quaternions have length 1.
    pub(crate) fn of(offsets: &BoneOffsets, root: DVec3, local: &[DQuat; JOINTS]) -> Pose {
        let mut pose = Pose {
            positions: [root; JOINTS],
            global: *local,
        };
        for joint in 1..JOINTS {
            let parent = PARENTS[joint];
            let turn = pose.global[parent];
            pose.positions[joint] = pose.positions[parent] + turn * offsets.0[joint];
            pose.global[joint] = turn * local[joint];
        }
        pose
    }

    /// Pulls a gradient back: from the gradient with respect to the positions, computes the gradients with respect to the
    /// root and to a small turn of every joint in its own frame. The turn is a rotation vector that is applied before the
    /// joint's rotation.
    pub(crate) fn pull_back(&self, gradient: &[DVec3; JOINTS]) -> (DVec3, [DVec3; JOINTS]) {
        // For each joint, the sum of the gradients of the joint and of all joints below it, and of their moments about the
        // joint.
        let mut force = *gradient;
        let mut moment = [DVec3::ZERO; JOINTS];
        for joint in (1..JOINTS).rev() {
            let parent = PARENTS[joint];
            let lever = self.positions[joint] - self.positions[parent];
            let (own_force, own_moment) = (force[joint], moment[joint]);
            force[parent] += own_force;
            moment[parent] += own_moment + lever.cross(own_force);
        }
        let turns = std::array::from_fn(|joint| self.global[joint].inverse() * moment[joint]);
        (force[0], turns)
    }
}

/// Converts the gradient with respect to a small turn in the joint's own frame to the gradient with respect to the four
/// numbers of the joint's quaternion, which has length 1. The result is orthogonal to the quaternion.
pub(crate) fn quaternion_gradient(rotation: DQuat, turn: DVec3) -> [f64; 4] {
    let product = rotation * DQuat::from_xyzw(turn.x, turn.y, turn.z, 0.0);
    product.to_array().map(|x| 2.0 * x)
}

/// Returns the rotations of a motion on a body. Bones keep their directions and get the body's lengths.
pub(crate) fn rotations_on(motion: &Motion, rest: &RestPose) -> Rotations {
    let rotations = Rotations::of(motion);
    // Without legs there is no scale for the root's path.
    match rotations.rest().leg() > 0.0 {
        true => rotations.on(rest),
        false => Rotations::on_body(motion, rest),
    }
}

/// Returns the joint positions of a body's rotations in 64 bits.
pub(crate) fn positions(rotations: &Rotations) -> Vec<[DVec3; JOINTS]> {
    let poses = rotations.joints().into_iter();
    poses
        .map(|pose| pose.map(|point| DVec3::from(point.map(f64::from))))
        .collect()
}
