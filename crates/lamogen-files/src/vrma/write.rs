//! Writing of VRM animations.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::Path;

use glam::DVec3;
use lamogen_motion::{JOINTS, Joint, RestPose, Rotations, write_atomically};
use serde_json::{Value, json};

use super::bones::human_bone;
use super::spine::TrunkBones;
use super::{EXTENSION, MIDDLE_SPINE};
use crate::glb::{BufferBuilder, BufferViewTarget, GlbError, SkeletonFile, node_index};

/// Options for writing a VRM animation.
#[derive(Clone, Debug, PartialEq)]
pub struct VrmaOptions {
    /// The name of the animation, which players list.
    pub name: String,
    /// The terms under which the motion may be used: the field `asset.copyright` of glTF.
    pub copyright: Option<String>,
    /// Notes on the motion, such as its text and seed: the `extras` of the root node.
    pub notes: BTreeMap<String, String>,
}

impl Default for VrmaOptions {
    fn default() -> Self {
        VrmaOptions {
            name: "motion".into(),
            copyright: None,
            notes: BTreeMap::new(),
        }
    }
}

/// The size up to which the components of a quaternion are rounding errors.
const ROUNDING: f32 = 1e-6;

/// Writes rotations as a VRM animation with the content of [`bytes()`].
///
/// # Errors
///
/// The same as for [`bytes()`]; and if the file cannot be written. In this case, no incomplete file is left.
pub fn write(
    path: impl AsRef<Path>,
    rotations: &Rotations,
    options: &VrmaOptions,
) -> Result<(), GlbError> {
    let path = path.as_ref();
    let bytes = bytes(rotations, options)?;
    write_atomically(path, |file| file.write_all(&bytes)).map_err(|reason| GlbError::Io {
        path: path.to_owned(),
        reason,
    })
}

/// Returns the bytes of a VRM animation with a keyframe at every frame.
///
/// # Errors
///
/// If a number of the motion is not finite, or the file would be larger than the 4 GiB that the format GLB allows.
pub fn bytes(rotations: &Rotations, options: &VrmaOptions) -> Result<Vec<u8>, GlbError> {
    let mut buffer = BufferBuilder::default();
    let TrunkBones {
        rotations: bones,
        chest_offsets,
    } = TrunkBones::of(rotations);
    let file = SkeletonFile {
        rotations: &bones,
        root_path: None,
        name: &options.name,
        copyright: options.copyright.as_deref(),
        notes: &options.notes,
        node_name: |joint| human_bone(joint).unwrap_or("middleSpine"),
        pelvis_height: standing_height(rotations),
    };
    let mut document = file.document();
    // The rotations of joints without children are those of their parents, up to rounding, unless the motion knows better.
    let has_channel = |joint: Joint, turns: &[[f32; 4]]| {
        let is_turned = |turn: &[f32; 4]| turn[..3].iter().any(|x| x.abs() > ROUNDING);
        let is_parent = joint.children().next().is_some() && human_bone(joint).is_some();
        is_parent || turns.iter().any(is_turned)
    };
    let mut animation = file.animation(&mut buffer, has_channel);
    add_chest_joint(&mut document, &mut animation, &chest_offsets, &mut buffer);
    document["animations"] = json!([animation]);
    let human_bones = Joint::ALL.into_iter().filter_map(|joint| {
        let node = json!({ "node": node_index(joint) });
        Some((human_bone(joint)?.to_owned(), node))
    });
    document["extensionsUsed"] = json!([EXTENSION]);
    document["extensions"][EXTENSION] = json!({
        "specVersion": "1.0",
        "humanoid": { "humanBones": Value::Object(human_bones.collect()) },
        "extras": { MIDDLE_SPINE: { "node": node_index(Joint::Spine2) } },
    });
    buffer.into_glb(document)
}

/// Puts the chest below a node that moves it to where the upper spine is. A human bone itself must not be moved.
fn add_chest_joint(
    document: &mut Value,
    animation: &mut Value,
    offsets: &[[f32; 3]],
    buffer: &mut BufferBuilder,
) {
    let [middle, chest] = [Joint::Spine2, Joint::Spine3].map(node_index);
    let nodes = document["nodes"].as_array_mut().expect("the skeleton");
    let added = nodes.len();
    let rest = std::mem::replace(&mut nodes[chest]["translation"], json!([0.0, 0.0, 0.0]));
    nodes.push(json!({ "name": "chestJoint", "translation": rest, "children": [chest] }));
    nodes[middle]["children"] = json!([added]);
    let input = animation["samplers"][0]["input"].clone();
    let output = buffer.push_floats(offsets, BufferViewTarget::Other);
    let samplers = animation["samplers"].as_array_mut().expect("a list");
    let sampler = samplers.len();
    samplers.push(json!({ "input": input, "output": output, "interpolation": "LINEAR" }));
    let channels = animation["channels"].as_array_mut().expect("a list");
    let target = json!({ "node": added, "path": "translation" });
    channels.push(json!({ "sampler": sampler, "target": target }));
}

/// The heights in metres at which the balls of the feet may be while a body stands: on the ground, as motions of HumanML3D
/// have it, or as high as soles and markers lift them.
const BALL_HEIGHTS: std::ops::RangeInclusive<f64> = -0.05..=0.1;

/// Returns the height of the pelvis above the origin in the rest pose that stands on the ground of the motion.
///
/// A motion whose feet are never near the height 0 does not show its ground, which is then taken to be at 0.
fn standing_height(rotations: &Rotations) -> f64 {
    let balls = [Joint::LeftFoot, Joint::RightFoot];
    let lowest = |pose: [f64; 2]| pose[0].min(pose[1]);
    let poses = rotations.joints();
    let heights = poses
        .iter()
        .map(|pose| lowest(balls.map(|ball| f64::from(pose[ball.index()][1]))));
    let mut heights: Vec<f64> = heights.collect();
    // The lowest fiftieth of the frames may be mistakes.
    let rank = heights.len() / 50;
    let ground = *heights.select_nth_unstable_by(rank, f64::total_cmp).1;
    let ground = match BALL_HEIGHTS.contains(&ground) {
        true => ground,
        false => 0.0,
    };
    let rest = rest_positions(rotations.rest());
    ground - lowest(balls.map(|ball| rest[ball.index()].y))
}

/// Returns the positions of the joints in the rest pose, with the pelvis at the origin.
fn rest_positions(rest: &RestPose) -> [DVec3; JOINTS] {
    let mut positions = [DVec3::ZERO; JOINTS];
    for joint in Joint::ALL {
        if let Some(parent) = joint.parent() {
            let offset = DVec3::from(rest.offset(joint).map(f64::from));
            positions[joint.index()] = positions[parent.index()] + offset;
        }
    }
    positions
}
