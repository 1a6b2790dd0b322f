//! The humanoid maps of VRM 0.x and VRM 1.0.

use lamogen_motion::{JOINTS, Joint};
use serde_json::Value;

use crate::document::GltfDocument;

/// The bones of VRM that are joints of ours. The spine is found between the pelvis and the head.
const BONES: [(&str, Joint); 19] = [
    ("hips", Joint::Pelvis),
    ("neck", Joint::Neck),
    ("head", Joint::Head),
    ("leftUpperLeg", Joint::LeftHip),
    ("leftLowerLeg", Joint::LeftKnee),
    ("leftFoot", Joint::LeftAnkle),
    ("leftToes", Joint::LeftFoot),
    ("rightUpperLeg", Joint::RightHip),
    ("rightLowerLeg", Joint::RightKnee),
    ("rightFoot", Joint::RightAnkle),
    ("rightToes", Joint::RightFoot),
    ("leftShoulder", Joint::LeftCollar),
    ("leftUpperArm", Joint::LeftShoulder),
    ("leftLowerArm", Joint::LeftElbow),
    ("leftHand", Joint::LeftWrist),
    ("rightShoulder", Joint::RightCollar),
    ("rightUpperArm", Joint::RightShoulder),
    ("rightLowerArm", Joint::RightElbow),
    ("rightHand", Joint::RightWrist),
];

/// Returns the index of each joint's node in the file, if the file is a VRM.
pub(crate) fn joint_nodes(document: &GltfDocument) -> Option<[Option<usize>; JOINTS]> {
    let extensions = document.value("extensions");
    let node = |bone: &str| -> Option<usize> {
        let one = &extensions["VRMC_vrm"]["humanoid"]["humanBones"][bone]["node"];
        let zero = || {
            let bones = extensions["VRM"]["humanoid"]["humanBones"].as_array()?;
            let found = bones.iter().find(|entry| entry["bone"] == *bone)?;
            found["node"].as_u64()
        };
        one.as_u64().or_else(zero).map(|node| node as usize)
    };
    let has_map = [("VRMC_vrm"), ("VRM")]
        .iter()
        .any(|name| extensions[*name]["humanoid"]["humanBones"] != Value::Null);
    let mut nodes = [None; JOINTS];
    for (bone, joint) in BONES {
        nodes[joint.index()] = node(bone);
    }
    has_map.then_some(nodes)
}
