//! The human bones of VRM.

use lamogen_motion::Joint;

/// The bones that a humanoid of VRM 1.0 must have.
pub(super) const REQUIRED: [&str; 15] = [
    "hips",
    "spine",
    "head",
    "leftUpperLeg",
    "leftLowerLeg",
    "leftFoot",
    "rightUpperLeg",
    "rightLowerLeg",
    "rightFoot",
    "leftUpperArm",
    "leftLowerArm",
    "leftHand",
    "rightUpperArm",
    "rightLowerArm",
    "rightHand",
];

/// Returns the human bone of VRM 1.0 that begins at a joint; `None` for the middle spine.
///
/// VRM requires only the bone `spine` between hips and neck. Characters have a chest besides, but often no upper chest, so the
/// trunk of a motion is written as spine and chest: the lower and the upper spine.
pub const fn human_bone(joint: Joint) -> Option<&'static str> {
    Some(match joint {
        Joint::Pelvis => "hips",
        Joint::LeftHip => "leftUpperLeg",
        Joint::RightHip => "rightUpperLeg",
        Joint::Spine1 => "spine",
        Joint::LeftKnee => "leftLowerLeg",
        Joint::RightKnee => "rightLowerLeg",
        Joint::Spine2 => return None,
        Joint::LeftAnkle => "leftFoot",
        Joint::RightAnkle => "rightFoot",
        Joint::Spine3 => "chest",
        Joint::LeftFoot => "leftToes",
        Joint::RightFoot => "rightToes",
        Joint::Neck => "neck",
        Joint::LeftCollar => "leftShoulder",
        Joint::RightCollar => "rightShoulder",
        Joint::Head => "head",
        Joint::LeftShoulder => "leftUpperArm",
        Joint::RightShoulder => "rightUpperArm",
        Joint::LeftElbow => "leftLowerArm",
        Joint::RightElbow => "rightLowerArm",
        Joint::LeftWrist => "leftHand",
        Joint::RightWrist => "rightHand",
    })
}
