//! Finding the joints of a VRM animation.

use lamogen_motion::{JOINTS, Joint};
use serde_json::Value;

use super::MIDDLE_SPINE;
use super::bones::{REQUIRED, human_bone};
use crate::schemes::JointNodes;

/// The name of the scheme by which the joints of a VRM animation are found.
pub(crate) const SCHEME: &str = "VRM animation";

/// The versions of the extension that are read. Drafts of the specification have the same human bones, and older programs
/// write them.
const VERSIONS: [&str; 2] = ["1.0", "1.0-draft"];

/// Returns the node of each joint in a file of `nodes` nodes, by the human bones of its extension.
///
/// The joints of the spine are spine, chest and upper chest, if these are all there, or spine, middle spine and chest, if a
/// file of lamogen names the middle spine. Otherwise they have no nodes and are what lies between hips and neck.
///
/// # Errors
///
/// If the version is unknown, a required bone is missing, two bones have the same node, or a node is not in the file.
/// The text of the error does not name the file.
pub(crate) fn human_joints(extension: &Value, nodes: usize) -> Result<JointNodes, String> {
    let version = &extension["specVersion"];
    if !VERSIONS.iter().any(|known| version == *known) {
        return Err(format!(
            "specVersion: expected \"1.0\", found {}",
            described(version)
        ));
    }
    let bones = match &extension["humanoid"]["humanBones"] {
        Value::Object(bones) => bones,
        found => {
            return Err(format!(
                "humanoid.humanBones: expected the bones of a body, found {}",
                described(found)
            ));
        }
    };
    let mut bone_of_node: Vec<Option<&str>> = vec![None; nodes];
    let mut joints: JointNodes = [None; JOINTS];
    let mut upper_chest = None;
    for (bone, entry) in bones {
        let found = &entry["node"];
        let node = found.as_u64().and_then(|node| usize::try_from(node).ok());
        let slot = node.and_then(|node| bone_of_node.get_mut(node));
        let slot = slot.ok_or_else(|| {
            format!(
                "humanBones.{bone}.node: expected the index of one of {nodes} nodes, found {}",
                described(found)
            )
        })?;
        if let Some(other) = slot.replace(bone) {
            return Err(format!(
                "humanBones.{bone}.node: expected a node of its own, found {found}, which is that of {other}"
            ));
        }
        let is_bone = |joint: &Joint| human_bone(*joint) == Some(bone);
        if let Some(joint) = Joint::ALL.into_iter().find(is_bone) {
            joints[joint.index()] = node;
        } else if bone == "upperChest" {
            upper_chest = node;
        }
    }
    let is_missing = |bone: &&str| !bones.contains_key(*bone);
    let missing: Vec<&str> = REQUIRED.into_iter().filter(is_missing).collect();
    if !missing.is_empty() {
        return Err(format!(
            "humanBones: expected all bones that a human body needs, found none for {}",
            missing.join(", ")
        ));
    }
    let [spine, chest] = [Joint::Spine1, Joint::Spine3].map(|joint| joints[joint.index()]);
    let middle = extension["extras"][MIDDLE_SPINE]["node"].as_u64();
    let middle = middle.and_then(|node| usize::try_from(node).ok());
    let middle = middle.filter(|node| bone_of_node.get(*node) == Some(&None));
    let trunk = match (upper_chest, middle) {
        (Some(_), _) => [spine, chest, upper_chest],
        (None, Some(_)) => [spine, middle, chest],
        (None, None) => [None; 3],
    };
    let is_whole = trunk.iter().all(Option::is_some);
    for (joint, node) in [Joint::Spine1, Joint::Spine2, Joint::Spine3]
        .into_iter()
        .zip(trunk)
    {
        joints[joint.index()] = node.filter(|_| is_whole);
    }
    Ok(joints)
}

/// Describes a value for an error message.
fn described(value: &Value) -> String {
    match value {
        Value::Null => "none".into(),
        Value::Object(_) => "an object".into(),
        Value::Array(_) => "a list".into(),
        value => value.to_string().chars().take(60).collect(),
    }
}
