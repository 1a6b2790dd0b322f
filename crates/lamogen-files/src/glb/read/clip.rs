//! Conversion of the nodes and curves of a glTF file to a clip.

use glam::{DQuat, DVec3};
use gltf_json::animation::{Animation, Interpolation};

use super::MAX_VALUES;
use super::nodes::{node_transform, parents_first};
use super::tracks::{NodeTracks, node_tracks};
use crate::clip::{Clip, Node};
use crate::glb::container::{FormatProblem, GltfFile};
use crate::glb::curve::KeyframeCurve;
use crate::glb::grid::FrameTimes;

/// Builds the clip of an animation: samples its curves at the frames of a common grid. Returns also the index in the clip of
/// each node of the file.
pub(super) fn build_clip(
    file: &GltfFile<'_>,
    animation: &Animation,
) -> Result<(Clip, Vec<usize>), FormatProblem> {
    let nodes = &file.root.nodes;
    let mut tracks = node_tracks(file, animation)?;
    let curves = tracks.iter().flat_map(|tracks| {
        let translation = tracks.translation.as_ref().map(curve_times);
        let scale = tracks.scale.as_ref().map(curve_times);
        [
            translation,
            tracks.rotation.as_ref().map(curve_times),
            scale,
        ]
    });
    let curves: Vec<(&[f64], Interpolation)> = curves.flatten().collect();
    let grid = FrameTimes::of_curves(&curves);
    if (grid.frames as u64).saturating_mul(curves.len() as u64) > MAX_VALUES {
        let (frames, curves) = (grid.frames, curves.len());
        return Err(format!(
            "expected a motion of at most {MAX_VALUES} values, found {frames} frames of {curves} curves"
        ));
    }

    let order = parents_first(nodes)?;
    let mut clip_index = vec![0; nodes.len()];
    let mut clip = Clip {
        nodes: Vec::with_capacity(nodes.len()),
        frames: grid.frames,
        seconds_per_frame: grid.step,
    };
    // The world position, rotation and scale of each node of the clip in the rest pose.
    let mut rest_poses: Vec<(DVec3, DQuat, DVec3)> = Vec::with_capacity(nodes.len());
    for (index, parent) in order {
        let (rest_translation, rest_rotation, rest_scale) = node_transform(&nodes[index])
            .ok_or_else(|| format!("nodes[{index}]: expected a finite transform, found none"))?;
        let parent = parent.map(|parent| clip_index[parent]);
        clip_index[index] = clip.nodes.len();
        let (parent_position, parent_rotation, parent_scale) = match parent {
            None => (DVec3::ZERO, DQuat::IDENTITY, DVec3::ONE),
            Some(parent) => rest_poses[parent],
        };
        let NodeTracks {
            translation,
            rotation,
            scale,
        } = std::mem::take(&mut tracks[index]);
        let scales = scale.map_or(vec![rest_scale], |curve| grid.sample(&curve));
        let rest = parent_rotation * (parent_scale * rest_translation);
        rest_poses.push((
            parent_position + rest,
            parent_rotation * rest_rotation,
            parent_scale * scales[0],
        ));
        let name = nodes[index].name.clone();
        clip.nodes.push(Node {
            name: name.unwrap_or_else(|| format!("node {index}")),
            parent,
            rest,
            translations: translation.map_or(vec![rest_translation], |curve| grid.sample(&curve)),
            rotations: rotation.map_or(vec![rest_rotation], |curve| grid.sample(&curve)),
            scales,
        });
    }
    Ok((clip, clip_index))
}

/// Returns the times of the keyframes of a curve, and its interpolation.
fn curve_times<T>(curve: &KeyframeCurve<T>) -> (&[f64], Interpolation) {
    (&curve.times, curve.interpolation)
}
