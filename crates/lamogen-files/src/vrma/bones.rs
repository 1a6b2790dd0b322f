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

/// Returns the human bone of VRM 1.0 that begins at a joint.
pub const fn human_bone(joint: Joint) -> &'static str {
    match joint {
        Joint::Pelvis => "hips",
        Joint::LeftHip => "leftUpperLeg",
        Joint::RightHip => "rightUpperLeg",
        Joint::Spine1 => "spine",
        Joint::LeftKnee => "leftLowerLeg",
        Joint::RightKnee => "rightLowerLeg",
        Joint::Spine2 => "chest",
        Joint::LeftAnkle => "leftFoot",
        Joint::RightAnkle => "rightFoot",
        Joint::Spine3 => "upperChest",
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
    }
}
