//! A skeleton animation as a file holds it, whatever its skeleton.
#![allow(dead_code)]

use glam::{DQuat, DVec3};

/// Named nodes that move, each seen from its parent.
pub(crate) struct Clip {
    /// Parents stand before their children.
    pub(crate) nodes: Vec<Node>,
    pub(crate) frames: usize,
    pub(crate) seconds_per_frame: f64,
}

/// One node of a clip. What does not change over time has one entry, else one for every frame.
pub(crate) struct Node {
    pub(crate) name: String,
    pub(crate) parent: Option<usize>,
    /// Where the node is in the rest pose, seen from its parent.
    pub(crate) rest: DVec3,
    pub(crate) translations: Vec<DVec3>,
    pub(crate) rotations: Vec<DQuat>,
    pub(crate) scale: DVec3,
}

impl Clip {
    /// Where all nodes are after some seconds, in the file's units.
    pub(crate) fn positions(&self, seconds: f64) -> Vec<DVec3> {
        let frame = (seconds / self.seconds_per_frame).clamp(0.0, (self.frames - 1) as f64);
        let (first, part) = (frame.floor() as usize, frame.fract());
        let mut places: Vec<(DVec3, DQuat, DVec3)> = Vec::with_capacity(self.nodes.len());
        for node in &self.nodes {
            let (here, next) = (
                first.min(node.translations.len() - 1),
                (first + 1).min(node.translations.len() - 1),
            );
            let shift = node.translations[here].lerp(node.translations[next], part);
            let (here, next) = (
                first.min(node.rotations.len() - 1),
                (first + 1).min(node.rotations.len() - 1),
            );
            let turn = node.rotations[here].slerp(node.rotations[next], part);
            places.push(match node.parent.map(|parent| places[parent]) {
                None => (shift, turn, node.scale),
                Some((place, frame, scale)) => (
                    place + frame * (scale * shift),
                    frame * turn,
                    scale * node.scale,
                ),
            });
        }
        places.into_iter().map(|(place, ..)| place).collect()
    }
}
