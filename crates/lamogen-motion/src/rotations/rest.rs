//! The rest pose of a body: a T-pose with its bone lengths.

use glam::{DMat3, DQuat, DVec3};

use super::fit::fit_rotation;
use crate::motion::Motion;
use crate::precise::{points, vector};
use crate::quality::BoneDrift;
use crate::skeleton::{JOINTS, Joint};

/// The skeleton without any rotation: a T-pose that faces +Z with Y up and the left arm along +X, with the bone
/// lengths of a body.
///
/// Limbs and spine are straight. The children of the pelvis and of the upper spine are where the motion has them: they
/// move together, and a single rotation of their parent reaches all of them only from their true positions.
#[derive(Clone, Debug, PartialEq)]
pub struct RestPose {
    pub(super) offsets: [[f32; 3]; JOINTS],
}

/// A joint with three children that move together.
pub(super) struct BranchJoint {
    pub(super) joint: Joint,
    /// The child on the left side.
    pub(super) left: Joint,
    /// The child on the right side.
    pub(super) right: Joint,
    /// The child on the spine.
    pub(super) upper: Joint,
}

/// The pelvis and the upper spine.
pub(super) const BRANCH_JOINTS: [BranchJoint; 2] = [
    BranchJoint {
        joint: Joint::Pelvis,
        left: Joint::LeftHip,
        right: Joint::RightHip,
        upper: Joint::Spine1,
    },
    BranchJoint {
        joint: Joint::Spine3,
        left: Joint::LeftCollar,
        right: Joint::RightCollar,
        upper: Joint::Neck,
    },
];

impl BranchJoint {
    /// Returns the left, right and upper child.
    pub(super) fn children(&self) -> [Joint; 3] {
        [self.left, self.right, self.upper]
    }
}

/// Length in metres up to which a bone has no direction.
pub(super) const MIN_BONE_LENGTH: f64 = 1e-6;
/// The number of rounds in which the offsets of a branch joint's children and the joint's rotations are fitted to each
/// other.
const FIT_ROUNDS: usize = 3;
/// Length of a leg from hip to ankle, in metres, of the adult body whose limb ends [`RestPose::tips`] scales.
const ADULT_LEG: f64 = 0.82;

/// The offsets of [`RestPose::humanml3d`] in tenths of a millimetre.
const HUMANML3D_OFFSETS: [[i16; 3]; JOINTS] = [
    [0, 0, 0],
    [543, -863, -152],
    [-663, -863, -152],
    [33, 1307, -152],
    [0, -3936, 0],
    [0, -3902, 0],
    [0, 1432, 0],
    [0, -4324, 0],
    [0, -4256, 0],
    [0, 574, 0],
    [0, -641, 1282],
    [0, -668, 1336],
    [-67, 2168, -329],
    [661, 1160, -329],
    [-777, 1160, -329],
    [0, 1030, 0],
    [1316, 0, 0],
    [-1230, 0, 0],
    [2568, 0, 0],
    [-2631, 0, 0],
    [2660, 0, 0],
    [-2699, 0, 0],
];

impl RestPose {
    /// Returns the T-pose of a motion's body. Every bone has its median length over the frames.
    pub fn of(motion: &Motion) -> RestPose {
        let poses: Vec<[DVec3; JOINTS]> = motion.joints().iter().map(points).collect();
        let lengths = BoneDrift::of(motion).lengths.map(f64::from);
        let mut offsets = Joint::ALL.map(|joint| direction(joint) * lengths[joint.index()]);
        for branch in &BRANCH_JOINTS {
            if let Some(child_offsets) = child_offsets(&poses, branch, &lengths) {
                for (joint, offset) in branch.children().into_iter().zip(child_offsets) {
                    offsets[joint.index()] = offset;
                }
            }
        }
        RestPose {
            offsets: offsets.map(|offset| offset.as_vec3().to_array()),
        }
    }

    /// Returns the body that all motions of HumanML3D have, to a tenth of a millimetre. It was measured as by
    /// [`RestPose::of`] on the sample that comes with the data set's code, and it is not quite symmetric.
    pub fn humanml3d() -> RestPose {
        RestPose {
            offsets: HUMANML3D_OFFSETS.map(|offset| offset.map(|x| f32::from(x) / 1e4)),
        }
    }

    /// Returns the length of a leg from hip to ankle, in metres, as the average of both legs.
    pub fn leg(&self) -> f32 {
        let legs = [
            Joint::LeftKnee,
            Joint::LeftAnkle,
            Joint::RightKnee,
            Joint::RightAnkle,
        ];
        let lengths = legs.map(|joint| vector(self.offset(joint)).length());
        (lengths.iter().sum::<f64>() / 2.0) as f32
    }

    /// Returns the axis about which an elbow or knee bends in the T-pose: elbows bend forward with the palms facing down,
    /// knees backward. `None` for all other joints, which may turn about any axis.
    pub fn hinge(joint: Joint) -> Option<[f32; 3]> {
        match joint {
            Joint::LeftElbow => Some([0.0, -1.0, 0.0]),
            Joint::RightElbow => Some([0.0, 1.0, 0.0]),
            Joint::LeftKnee | Joint::RightKnee => Some([1.0, 0.0, 0.0]),
            _ => None,
        }
    }

    /// Returns the position of a joint relative to its parent, in metres; the pelvis is at the origin.
    pub fn offset(&self, joint: Joint) -> [f32; 3] {
        self.offsets[joint.index()]
    }

    /// Returns the ends of the limbs relative to the joints without children, in metres: crown of the head, fingertips
    /// and tips of the toes. Motions do not contain them; they are those of an adult body, scaled by leg length.
    pub fn tips(&self) -> [(Joint, [f32; 3]); 5] {
        let length = |joint: Joint| vector(self.offset(joint)).length();
        let leg = [Joint::LeftKnee, Joint::LeftAnkle].map(length);
        let scale = (leg.iter().sum::<f64>() / ADULT_LEG) as f32;
        [
            (Joint::Head, [0.0, 0.18, 0.0]),
            (Joint::LeftWrist, [0.17, 0.0, 0.0]),
            (Joint::RightWrist, [-0.17, 0.0, 0.0]),
            (Joint::LeftFoot, [0.0, 0.0, 0.07]),
            (Joint::RightFoot, [0.0, 0.0, 0.07]),
        ]
        .map(|(joint, tip)| (joint, tip.map(|x| x * scale)))
    }
}

/// Returns the direction of the bone that ends in a joint in the T-pose. The directions of the children of branch
/// joints are used only for motions from which [`child_offsets`] cannot be measured.
pub(super) fn direction(joint: Joint) -> DVec3 {
    use Joint::*;
    match joint {
        Pelvis => DVec3::ZERO,
        LeftHip => DVec3::new(0.8, -0.6, 0.0),
        RightHip => DVec3::new(-0.8, -0.6, 0.0),
        Spine1 | Spine2 | Spine3 | Neck | Head => DVec3::Y,
        LeftKnee | RightKnee | LeftAnkle | RightAnkle => DVec3::NEG_Y,
        // From the ankle down to the ball.
        LeftFoot | RightFoot => DVec3::new(0.0, -0.447_213_6, 0.894_427_2),
        LeftCollar => DVec3::new(0.6, 0.8, 0.0),
        RightCollar => DVec3::new(-0.6, 0.8, 0.0),
        LeftShoulder | LeftElbow | LeftWrist => DVec3::X,
        RightShoulder | RightElbow | RightWrist => DVec3::NEG_X,
    }
}

/// Returns the offsets of the three children of a branch joint in the T-pose: the left and right child lie along X, and
/// the child on the spine in the plane of X and Y. `None` if the left and the right child coincide at every frame.
fn child_offsets(
    poses: &[[DVec3; JOINTS]],
    branch: &BranchJoint,
    lengths: &[f64; JOINTS],
) -> Option<[DVec3; 3]> {
    let children = branch.children();
    let relative = |pose: &[DVec3; JOINTS]| {
        children.map(|child| pose[child.index()] - pose[branch.joint.index()])
    };
    let lengths = children.map(|child| lengths[child.index()]);
    let (mut sum, mut frames) = ([DVec3::ZERO; 3], 0);
    for pose in poses {
        let positions = relative(pose);
        if let Some(frame) = branch_frame(positions) {
            for (sum, position) in sum.iter_mut().zip(positions) {
                *sum += frame.transpose() * position;
            }
            frames += 1;
        }
    }
    if frames == 0 {
        return None;
    }
    // The mean of vectors in different directions is too short, so each sum gets the length of its bone.
    let with_lengths =
        |sum: [DVec3; 3]| std::array::from_fn(|i| sum[i].normalize_or_zero() * lengths[i]);
    let mut offsets = with_lengths(sum);
    for _ in 0..FIT_ROUNDS {
        let mut sum = [DVec3::ZERO; 3];
        let mut turn = DQuat::IDENTITY;
        for pose in poses {
            let positions = relative(pose);
            turn = fit_rotation(&offsets, &positions, turn);
            for (sum, position) in sum.iter_mut().zip(positions) {
                *sum += turn.inverse() * position;
            }
        }
        offsets = with_lengths(sum);
    }
    let frame = branch_frame(offsets)?;
    Some(offsets.map(|offset| frame.transpose() * offset))
}

/// Returns the coordinate frame in which X points from the right child to the left one, and Y towards the child on the
/// spine. `None` if the left and the right child coincide.
fn branch_frame([left, right, upper]: [DVec3; 3]) -> Option<DMat3> {
    let x = (left - right).try_normalize()?;
    let middle = (left + right) / 2.0;
    // If the three children are on one line, the line is above or below the branch joint; if the branch joint is on
    // the line too, any direction orthogonal to the line will do.
    let ups = [upper - middle, upper, -middle].map(|up| up - up.dot(x) * x);
    let up = ups.into_iter().find(|up| up.length() > MIN_BONE_LENGTH);
    let y = up.unwrap_or(x.any_orthogonal_vector()).normalize();
    Some(DMat3::from_cols(x, y, x.cross(y)))
}
