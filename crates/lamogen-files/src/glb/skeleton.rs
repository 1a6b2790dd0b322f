//! The parts of a glTF file that hold the skeleton of a motion and its animation.

use std::collections::BTreeMap;

use lamogen_motion::{Joint, Rotations};
use serde_json::{Value, json};

use super::buffer::{BufferBuilder, BufferViewTarget};

/// The index of the root node, which is the parent of the pelvis. The joints follow in their own order.
pub(super) const ROOT: usize = 0;
/// Returns the index of the node of a joint.
pub(crate) const fn node_index(joint: Joint) -> usize {
    ROOT + 1 + joint.index()
}

/// The content of a glTF file with a skeleton and one animation.
pub(crate) struct SkeletonFile<'a> {
    pub(crate) rotations: &'a Rotations,
    /// The positions of the root node, if it travels.
    pub(crate) root_path: Option<&'a [[f32; 3]]>,
    /// The name of the animation and of the scene.
    pub(crate) name: &'a str,
    pub(crate) copyright: Option<&'a str>,
    /// The `extras` of the root node.
    pub(crate) notes: &'a BTreeMap<String, String>,
    /// The names of the nodes.
    pub(crate) node_name: fn(Joint) -> &'static str,
    /// The height of the pelvis above the origin in the rest pose, in metres.
    pub(crate) pelvis_height: f64,
}

impl SkeletonFile<'_> {
    /// Returns a document with the joints as nodes, in the T-pose below one root.
    pub(crate) fn document(&self) -> Value {
        let mut nodes = vec![json!({ "name": "lamogen", "children": [node_index(Joint::Pelvis)] })];
        if !self.notes.is_empty() {
            nodes[ROOT]["extras"] = json!(self.notes);
        }
        for joint in Joint::ALL {
            let position = match joint {
                Joint::Pelvis => [0.0, self.pelvis_height as f32, 0.0],
                _ => self.rotations.rest().offset(joint),
            };
            let children: Vec<usize> = joint.children().map(node_index).collect();
            let mut entry = json!({ "name": (self.node_name)(joint), "translation": position });
            if !children.is_empty() {
                entry["children"] = json!(children);
            }
            nodes.push(entry);
        }
        let mut asset = json!({
            "version": "2.0",
            "generator": concat!("lamogen ", env!("CARGO_PKG_VERSION")),
        });
        if let Some(copyright) = self.copyright {
            asset["copyright"] = json!(copyright);
        }
        json!({
            "asset": asset,
            "scene": 0,
            "scenes": [{ "name": self.name, "nodes": [ROOT] }],
            "nodes": nodes,
        })
    }

    /// Returns the animation, with a keyframe at every frame: the translation of the pelvis, that of the root if it travels, and
    /// the rotations of those joints for which `has_channel` returns true. It gets the joint and its rotations at all frames.
    pub(crate) fn animation(
        &self,
        buffer: &mut BufferBuilder,
        has_channel: impl Fn(Joint, &[[f32; 4]]) -> bool,
    ) -> Value {
        let rotations = self.rotations;
        let rate = f64::from(rotations.frames_per_second());
        let times: Vec<[f32; 1]> = (0..rotations.frames())
            .map(|frame| [(frame as f64 / rate) as f32])
            .collect();
        let input = buffer.push_floats(&times, BufferViewTarget::Other);
        let (mut samplers, mut channels) = (Vec::new(), Vec::new());
        let mut channel = |output: usize, node: usize, path: &str| {
            channels.push(json!({
                "sampler": samplers.len(),
                "target": { "node": node, "path": path },
            }));
            samplers.push(json!({ "input": input, "output": output, "interpolation": "LINEAR" }));
        };
        let translations = buffer.push_floats(rotations.root(), BufferViewTarget::Other);
        channel(translations, node_index(Joint::Pelvis), "translation");
        if let Some(path) = self.root_path {
            let path = buffer.push_floats(path, BufferViewTarget::Other);
            channel(path, ROOT, "translation");
        }
        for joint in Joint::ALL {
            let turns = rotations.local().iter().map(|pose| pose[joint.index()]);
            let turns: Vec<[f32; 4]> = turns.collect();
            if has_channel(joint, &turns) {
                let turns = buffer.push_floats(&turns, BufferViewTarget::Other);
                channel(turns, node_index(joint), "rotation");
            }
        }
        json!({ "name": self.name, "channels": channels, "samplers": samplers })
    }
}
