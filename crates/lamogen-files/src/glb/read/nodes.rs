//! The node tree of a glTF file and the transforms of its nodes.

use glam::{DMat4, DQuat, DVec3};
use gltf_json::{Index, scene};

use crate::glb::container::FormatProblem;

/// Returns the index of every node and of its parent, in an order in which parents come before their children.
pub(super) fn parents_first(
    nodes: &[scene::Node],
) -> Result<Vec<(usize, Option<usize>)>, FormatProblem> {
    let children = |node: usize| nodes[node].children.iter().flatten().map(Index::value);
    let mut parents: Vec<Option<usize>> = vec![None; nodes.len()];
    for node in 0..nodes.len() {
        for child in children(node) {
            let parent = parents.get_mut(child).ok_or_else(|| {
                format!("nodes[{node}]: expected a child, found the index {child}")
            })?;
            if let Some(other) = parent.replace(node) {
                return Err(format!(
                    "nodes[{child}]: expected one parent, found nodes {other} and {node}"
                ));
            }
        }
    }
    let mut order = Vec::with_capacity(nodes.len());
    let roots = (0..nodes.len())
        .rev()
        .filter(|&node| parents[node].is_none());
    let mut waiting: Vec<usize> = roots.collect();
    while let Some(node) = waiting.pop() {
        order.push((node, parents[node]));
        let first = waiting.len();
        waiting.extend(children(node));
        waiting[first..].reverse();
    }
    match order.len() == nodes.len() {
        true => Ok(order),
        false => Err("expected a tree of nodes, found one below itself".into()),
    }
}

/// Returns the translation, rotation and scale of a node, or `None` if one of them is not finite.
pub(super) fn node_transform(node: &scene::Node) -> Option<(DVec3, DQuat, DVec3)> {
    let vector = |values: [f32; 3]| DVec3::from(values.map(f64::from));
    let (scale, rotation, translation) = match node.matrix {
        Some(matrix) => {
            let matrix = DMat4::from_cols_array(&matrix.map(f64::from));
            // A singular matrix cannot be decomposed.
            let determinant = matrix.determinant();
            if !(determinant.is_finite() && determinant != 0.0) {
                return None;
            }
            matrix.to_scale_rotation_translation()
        }
        None => (
            vector(node.scale.unwrap_or([1.0; 3])),
            match node.rotation {
                None => DQuat::IDENTITY,
                Some(rotation) => DQuat::from_array(rotation.0.map(f64::from)),
            },
            vector(node.translation.unwrap_or([0.0; 3])),
        ),
    };
    let length = rotation.length();
    let is_rotation = length.is_finite() && length > 1e-6;
    (is_rotation && translation.is_finite() && scale.is_finite())
        .then(|| (translation, rotation.normalize(), scale))
}
