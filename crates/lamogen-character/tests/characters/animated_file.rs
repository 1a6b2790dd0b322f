//! Files of characters read back.

use std::path::Path;

use glam::{DMat4, DQuat, DVec3};

/// A file with the positions of its nodes in the world at every keyframe of its last animation.
pub struct AnimatedFile {
    names: Vec<String>,
    /// For each keyframe the position of each node.
    positions: Vec<Vec<DVec3>>,
}

impl AnimatedFile {
    pub fn read(path: &Path) -> AnimatedFile {
        use gltf::animation::util::ReadOutputs;
        let bytes = std::fs::read(path).unwrap();
        let gltf::Gltf { document, blob } = gltf::Gltf::from_slice(&bytes).unwrap();
        let blob = blob.unwrap();
        let animation = document.animations().last().unwrap();
        let mut translations: Vec<Vec<DVec3>> = Vec::new();
        let mut rotations: Vec<Vec<DQuat>> = Vec::new();
        let mut scales = Vec::new();
        for node in document.nodes() {
            let (translation, rotation, scale) = node.transform().decomposed();
            translations.push(vec![DVec3::from(translation.map(f64::from))]);
            rotations.push(vec![DQuat::from_array(rotation.map(f64::from))]);
            scales.push(DVec3::from(scale.map(f64::from)));
        }
        for channel in animation.channels() {
            let node = channel.target().node().index();
            match channel.reader(|_| Some(&*blob)).read_outputs().unwrap() {
                ReadOutputs::Translations(values) => {
                    let values = values.map(|value| DVec3::from(value.map(f64::from)));
                    translations[node] = values.collect();
                }
                ReadOutputs::Rotations(values) => {
                    let values = values.into_f32();
                    let values = values.map(|value| DQuat::from_array(value.map(f64::from)));
                    rotations[node] = values.collect();
                }
                _ => panic!("an animation of lamogen turns and moves nodes"),
            }
        }
        let count = { rotations.iter().map(Vec::len) }
            .chain(translations.iter().map(Vec::len))
            .max()
            .unwrap();
        let local = |frame: usize, node: usize| {
            let [turns, moves] = [rotations[node].len(), translations[node].len()];
            DMat4::from_scale_rotation_translation(
                scales[node],
                rotations[node][frame.min(turns - 1)],
                translations[node][frame.min(moves - 1)],
            )
        };
        let frame = |frame: usize| {
            let mut world = vec![DMat4::IDENTITY; scales.len()];
            let roots = document.default_scene().unwrap().nodes();
            let mut open: Vec<_> = roots.map(|node| (node, DMat4::IDENTITY)).collect();
            while let Some((node, above)) = open.pop() {
                let place = above * local(frame, node.index());
                world[node.index()] = place;
                open.extend(node.children().map(|child| (child, place)));
            }
            world.iter().map(|place| place.w_axis.truncate()).collect()
        };
        AnimatedFile {
            names: { document.nodes() }
                .map(|node| node.name().unwrap_or("").to_owned())
                .collect(),
            positions: (0..count).map(frame).collect(),
        }
    }

    pub fn frames(&self) -> usize {
        self.positions.len()
    }

    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.names.iter().map(String::as_str)
    }

    /// Returns the position of a node at a keyframe.
    pub fn position(&self, frame: usize, name: &str) -> DVec3 {
        let node = self.names.iter().position(|found| found == name);
        self.positions[frame][node.unwrap_or_else(|| panic!("no node {name}"))]
    }
}
