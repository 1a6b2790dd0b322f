//! Forward kinematics of one pose, with its gradient.

use glam::{DQuat, DVec3};
use lamogen_motion::{JOINTS, Joint, RestPose};

/// Joints whose rotation moves another joint: all but head, wrists and feet.
pub(crate) const DRIVEN: [Joint; 17] = [
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

/// Index of the parent of every joint; the pelvis stands as its own.
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

/// The bones of a body: where every joint is seen from its parent, in metres.
#[derive(Clone, Debug)]
pub(crate) struct Bones(pub(crate) [DVec3; JOINTS]);

impl Bones {
    pub(crate) fn of(rest: &RestPose) -> Bones {
        Bones(Joint::ALL.map(|joint| DVec3::from(rest.offset(joint).map(f64::from))))
    }
}

/// Where every joint is, and what it has turned to in the world.
#[derive(Clone, Debug)]
pub(crate) struct Pose {
    pub(crate) positions: [DVec3; JOINTS],
    pub(crate) global: [DQuat; JOINTS],
}

impl Pose {
    /// The pose of a root and local rotations, which have length 1.
    pub(crate) fn of(bones: &Bones, root: DVec3, local: &[DQuat; JOINTS]) -> Pose {
        let mut pose = Pose {
            positions: [root; JOINTS],
            global: *local,
        };
        for joint in 1..JOINTS {
            let parent = PARENTS[joint];
            let turn = pose.global[parent];
            pose.positions[joint] = pose.positions[parent] + turn * bones.0[joint];
            pose.global[joint] = turn * local[joint];
        }
        pose
    }

    /// What a gradient with respect to the positions is with respect to the root, and to a small turn of every joint in its own
    /// frame (a rotation vector, applied before the joint's rotation).
    pub(crate) fn pull(&self, gradient: &[DVec3; JOINTS]) -> (DVec3, [DVec3; JOINTS]) {
        // Sums over a joint and all below it: of gradients, and of their moments about the joint.
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

/// The gradient with respect to the four numbers of a quaternion of length 1, of one with respect to a small turn in the joint's
/// own frame. It is upright on the quaternion.
pub(crate) fn of_quaternion(rotation: DQuat, turn: DVec3) -> [f64; 4] {
    let product = rotation * DQuat::from_xyzw(turn.x, turn.y, turn.z, 0.0);
    product.to_array().map(|x| 2.0 * x)
}
