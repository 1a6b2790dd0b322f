//! The curves that animate each node of a glTF file.

use glam::{DQuat, DVec3};
use gltf_json::animation::{Animation, Interpolation, Property, Sampler};
use gltf_json::validation::Checked;

use super::MAX_VALUES;
use crate::glb::container::{FormatProblem, GltfFile};
use crate::glb::curve::KeyframeCurve;

/// The animation of one node.
#[derive(Default)]
pub(super) struct NodeTracks {
    pub(super) translation: Option<KeyframeCurve<DVec3>>,
    pub(super) rotation: Option<KeyframeCurve<DQuat>>,
    pub(super) scale: Option<KeyframeCurve<DVec3>>,
}

/// Reads the curves of an animation. The result has one entry for each node of the file.
pub(super) fn node_tracks(
    file: &GltfFile<'_>,
    animation: &Animation,
) -> Result<Vec<NodeTracks>, FormatProblem> {
    let nodes = &file.root.nodes;
    let mut tracks: Vec<NodeTracks> = nodes.iter().map(|_| NodeTracks::default()).collect();
    let mut remaining = MAX_VALUES;
    for (index, channel) in animation.channels.iter().enumerate() {
        let in_channel = |problem: FormatProblem| format!("channel {index}: {problem}");
        let sampler = animation.samplers.get(channel.sampler.value());
        let sampler = sampler.ok_or_else(|| in_channel("expected a sampler, found none".into()))?;
        let node = channel.target.node.value();
        if node >= nodes.len() {
            return Err(in_channel(format!(
                "expected a node, found the index {node}"
            )));
        }
        let count = file.count(sampler.input).max(file.count(sampler.output));
        remaining = remaining.checked_sub(count).ok_or_else(|| {
            in_channel(format!(
                "expected at most {MAX_VALUES} keyframes, found more"
            ))
        })?;
        match channel.target.path {
            Checked::Valid(Property::Translation) => {
                tracks[node].translation =
                    Some(read_curve(file, sampler, DVec3::from_array).map_err(in_channel)?);
            }
            Checked::Valid(Property::Rotation) => {
                let mut rotations =
                    read_curve(file, sampler, DQuat::from_array).map_err(in_channel)?;
                normalize_rotations(&mut rotations).map_err(in_channel)?;
                tracks[node].rotation = Some(rotations);
            }
            Checked::Valid(Property::Scale) => {
                let sizes = read_curve(file, sampler, DVec3::from_array).map_err(in_channel)?;
                tracks[node].scale = Some(sizes);
            }
            // Weights of morph targets, such as shapes of a face, move no node.
            Checked::Valid(Property::MorphTargetWeights) => {}
            Checked::Invalid => {
                return Err(in_channel(
                    "expected a known target path, found another".into(),
                ));
            }
        }
    }
    Ok(tracks)
}

/// Reads the keyframes of a sampler. `to_value` converts the numbers of each row to a value.
fn read_curve<const N: usize, T>(
    file: &GltfFile<'_>,
    sampler: &Sampler,
    to_value: impl Fn([f64; N]) -> T,
) -> Result<KeyframeCurve<T>, FormatProblem> {
    let Checked::Valid(interpolation) = sampler.interpolation else {
        return Err("expected a known interpolation, found another".into());
    };
    let times: Vec<f64> = file.floats::<1>(sampler.input)?.into_flattened();
    if let Some(key) = times.windows(2).position(|pair| pair[1] < pair[0]) {
        let (before, after) = (times[key], times[key + 1]);
        return Err(format!(
            "expected ascending times, found {after} after {before}"
        ));
    }
    let values = file.floats::<N>(sampler.output)?;
    let values: Vec<T> = values.into_iter().map(to_value).collect();
    let expected = match interpolation {
        Interpolation::CubicSpline => 3 * times.len(),
        _ => times.len(),
    };
    if values.len() != expected {
        let found = values.len();
        return Err(format!("expected {expected} values, found {found}"));
    }
    Ok(KeyframeCurve {
        times,
        values,
        interpolation,
    })
}

/// Normalises the rotations of a curve to length 1. The tangents of a spline are not rotations and stay as they are.
fn normalize_rotations(curve: &mut KeyframeCurve<DQuat>) -> Result<(), FormatProblem> {
    let (first, step) = match curve.interpolation {
        Interpolation::CubicSpline => (1, 3),
        _ => (0, 1),
    };
    for rotation in curve.values.iter_mut().skip(first).step_by(step) {
        let length = rotation.length();
        if !(length.is_finite() && length > 1e-6) {
            return Err(format!("expected rotations of length 1, found {length}"));
        }
        *rotation = rotation.normalize();
    }
    Ok(())
}
