//! glTF as a clip.

use std::path::Path;

use glam::{DMat4, DQuat, DVec3};
use gltf_json::animation::{Animation, Interpolation, Property, Sampler};
use gltf_json::validation::Checked;
use gltf_json::{Index, scene};

use super::GlbError;
use super::container::{Container, Flaw};
use super::curve::Curve;
use super::grid::Grid;
use crate::clip::{Clip, Node};

/// Keyframes in all curves together, and values of a clip: what a motion of half an hour needs.
const MOST_VALUES: u64 = 1 << 24;
/// By which part a size may differ and be the same: exporters that take transforms apart round.
const SAME_SIZE: f64 = 1e-3;

/// Reads the animation of that name, or the first, of a `.glb` or `.gltf` file; beside it, what the others are
/// called.
///
/// All nodes are read, those without a name as `node 7`. The clip starts at the first keyframe. Its frames are the
/// keyframes where these lie on a grid, else 120 a second; curves that are not linear get at least 60 a second.
/// A node's `rest` is turned and scaled as the rest pose has it, so that the sum up to the root is where the node
/// stands.
///
/// # Errors
///
/// If the file cannot be read, is no glTF 2, is damaged or without animation, or needs what is not read here:
/// compressed or sparse keyframes, buffers from a network, nodes below one that changes its size.
pub(crate) fn read(path: &Path, animation: Option<&str>) -> Result<(Clip, Vec<String>), GlbError> {
    let bytes = std::fs::read(path).map_err(|reason| GlbError::Io {
        path: path.to_owned(),
        reason,
    })?;
    read_bytes(&bytes, path, animation)
}

fn read_bytes(
    bytes: &[u8],
    path: &Path,
    animation: Option<&str>,
) -> Result<(Clip, Vec<String>), GlbError> {
    let container = Container::of(bytes, path, animation)?;
    let flawed = |reason| GlbError::Format {
        path: path.to_owned(),
        reason,
    };
    let animations = &container.root.animations;
    let chosen = match animation {
        None => animations
            .first()
            .ok_or_else(|| flawed("expected an animation, found none".into()))?,
        Some(asked) => animations
            .iter()
            .find(|animation| animation.name.as_deref() == Some(asked))
            .ok_or_else(|| GlbError::Animation {
                path: path.to_owned(),
                asked: asked.to_owned(),
                found: animations.iter().filter_map(|a| a.name.clone()).collect(),
            })?,
    };
    let others = animations
        .iter()
        .filter(|animation| !std::ptr::eq(*animation, chosen))
        .map(|animation| animation.name.clone().unwrap_or("without a name".into()))
        .collect();
    Ok((clip(&container, chosen).map_err(flawed)?, others))
}

/// What moves one node.
#[derive(Default)]
struct Tracks {
    translation: Option<Curve<DVec3>>,
    rotation: Option<Curve<DQuat>>,
    scale: Option<DVec3>,
}

fn clip(container: &Container, animation: &Animation) -> Result<Clip, Flaw> {
    let nodes = &container.root.nodes;
    let mut tracks = tracks(container, animation)?;
    let curves = tracks.iter().flat_map(|tracks| {
        let translation = tracks.translation.as_ref().map(shape);
        [translation, tracks.rotation.as_ref().map(shape)]
    });
    let curves: Vec<(&[f64], Interpolation)> = curves.flatten().collect();
    let grid = Grid::of(&curves);
    if (grid.frames as u64).saturating_mul(curves.len() as u64) > MOST_VALUES {
        let (frames, curves) = (grid.frames, curves.len());
        return Err(format!(
            "expected a motion of at most {MOST_VALUES} values, found {frames} frames of {curves} curves"
        ));
    }

    let order = parents_first(nodes)?;
    let mut place_in_clip = vec![0; nodes.len()];
    let mut clip = Clip {
        nodes: Vec::with_capacity(nodes.len()),
        frames: grid.frames,
        seconds_per_frame: grid.step,
    };
    let mut poses: Vec<(DVec3, DQuat, DVec3)> = Vec::with_capacity(nodes.len());
    for (index, parent) in order {
        let (shift, turn, own) = transform(&nodes[index])
            .ok_or_else(|| format!("nodes[{index}]: expected a finite transform, found none"))?;
        let parent = parent.map(|parent| place_in_clip[parent]);
        place_in_clip[index] = clip.nodes.len();
        let (above, frame, size) = match parent {
            None => (DVec3::ZERO, DQuat::IDENTITY, DVec3::ONE),
            Some(parent) => poses[parent],
        };
        let Tracks {
            translation,
            rotation,
            scale,
        } = std::mem::take(&mut tracks[index]);
        let scale = scale.unwrap_or(own);
        let rest = frame * (size * shift);
        poses.push((above + rest, frame * turn, size * scale));
        let name = nodes[index].name.clone();
        clip.nodes.push(Node {
            name: name.unwrap_or_else(|| format!("node {index}")),
            parent,
            rest,
            translations: translation.map_or(vec![shift], |curve| grid.sampled(&curve)),
            rotations: rotation.map_or(vec![turn], |curve| grid.sampled(&curve)),
            scale,
        });
    }
    Ok(clip)
}

fn shape<T>(curve: &Curve<T>) -> (&[f64], Interpolation) {
    (&curve.times, curve.interpolation)
}

/// The curves of an animation, a place for each node.
fn tracks(container: &Container, animation: &Animation) -> Result<Vec<Tracks>, Flaw> {
    let nodes = &container.root.nodes;
    let mut tracks: Vec<Tracks> = nodes.iter().map(|_| Tracks::default()).collect();
    let mut room = MOST_VALUES;
    for (index, channel) in animation.channels.iter().enumerate() {
        let at = |flaw: Flaw| format!("channel {index}: {flaw}");
        let sampler = animation.samplers.get(channel.sampler.value());
        let sampler = sampler.ok_or_else(|| at("expected a sampler, found none".into()))?;
        let node = channel.target.node.value();
        if node >= nodes.len() {
            return Err(at(format!("expected a node, found the index {node}")));
        }
        let count = container
            .count(sampler.input)
            .max(container.count(sampler.output));
        room = room.checked_sub(count).ok_or_else(|| {
            at(format!(
                "expected at most {MOST_VALUES} keyframes, found more"
            ))
        })?;
        match channel.target.path {
            Checked::Valid(Property::Translation) => {
                tracks[node].translation =
                    Some(curve(container, sampler, DVec3::from_array).map_err(at)?);
            }
            Checked::Valid(Property::Rotation) => {
                let mut turns = curve(container, sampler, DQuat::from_array).map_err(at)?;
                normalize(&mut turns).map_err(at)?;
                tracks[node].rotation = Some(turns);
            }
            Checked::Valid(Property::Scale) => {
                let sizes = curve(container, sampler, DVec3::from_array).map_err(at)?;
                let first = sizes.key(0);
                let changes = |size: DVec3| {
                    (size - first).abs().max_element() > SAME_SIZE * first.abs().max_element()
                };
                let carries = nodes[node].children.as_ref().is_some_and(|c| !c.is_empty());
                tracks[node].scale = Some(first);
                if carries && sizes.keys().any(changes) {
                    let name = nodes[node].name.as_deref().unwrap_or("without a name");
                    return Err(at(format!(
                        "expected nodes that keep their size, found that of node {node} ({name}) to change"
                    )));
                }
            }
            // Shapes of faces and the like: no node moves.
            Checked::Valid(Property::MorphTargetWeights) => {}
            Checked::Invalid => {
                return Err(at("expected a known target path, found another".into()));
            }
        }
    }
    Ok(tracks)
}

fn curve<const N: usize, T>(
    container: &Container,
    sampler: &Sampler,
    value: impl Fn([f64; N]) -> T,
) -> Result<Curve<T>, Flaw> {
    let Checked::Valid(interpolation) = sampler.interpolation else {
        return Err("expected a known interpolation, found another".into());
    };
    let times: Vec<f64> = container.floats::<1>(sampler.input)?.into_flattened();
    if let Some(key) = times.windows(2).position(|pair| pair[1] < pair[0]) {
        let (before, after) = (times[key], times[key + 1]);
        return Err(format!(
            "expected ascending times, found {after} after {before}"
        ));
    }
    let values = container.floats::<N>(sampler.output)?;
    let values: Vec<T> = values.into_iter().map(value).collect();
    let expected = match interpolation {
        Interpolation::CubicSpline => 3 * times.len(),
        _ => times.len(),
    };
    if values.len() != expected {
        let found = values.len();
        return Err(format!("expected {expected} values, found {found}"));
    }
    Ok(Curve {
        times,
        values,
        interpolation,
    })
}

/// Makes the rotations of a curve unit ones; the tangents of a spline are none.
fn normalize(curve: &mut Curve<DQuat>) -> Result<(), Flaw> {
    let (first, step) = match curve.interpolation {
        Interpolation::CubicSpline => (1, 3),
        _ => (0, 1),
    };
    for turn in curve.values.iter_mut().skip(first).step_by(step) {
        let length = turn.length();
        if !(length.is_finite() && length > 1e-6) {
            return Err(format!("expected rotations of length 1, found {length}"));
        }
        *turn = turn.normalize();
    }
    Ok(())
}

/// Every node with its parent, parents before their children.
fn parents_first(nodes: &[scene::Node]) -> Result<Vec<(usize, Option<usize>)>, Flaw> {
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

/// A node's translation, rotation and scale; `None` if one is not finite.
fn transform(node: &scene::Node) -> Option<(DVec3, DQuat, DVec3)> {
    let vector = |values: [f32; 3]| DVec3::from(values.map(f64::from));
    let (scale, turn, shift) = match node.matrix {
        Some(matrix) => {
            let matrix = DMat4::from_cols_array(&matrix.map(f64::from));
            // Only a matrix that keeps a volume can be taken apart.
            let volume = matrix.determinant();
            if !(volume.is_finite() && volume != 0.0) {
                return None;
            }
            matrix.to_scale_rotation_translation()
        }
        None => (
            vector(node.scale.unwrap_or([1.0; 3])),
            match node.rotation {
                None => DQuat::IDENTITY,
                Some(turn) => DQuat::from_array(turn.0.map(f64::from)),
            },
            vector(node.translation.unwrap_or([0.0; 3])),
        ),
    };
    let length = turn.length();
    let is_turn = length.is_finite() && length > 1e-6;
    (is_turn && shift.is_finite() && scale.is_finite()).then(|| (shift, turn.normalize(), scale))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::glb::body::standing;
    use crate::glb::{self, GlbOptions, example, write};
    use lamogen_motion::{JOINTS, Joint};
    use serde_json::{Value as Json, json};

    /// The largest distance in metres between a clip's nodes of the joints' names and joints.
    fn largest_gap(clip: &Clip, expected: &[[[f32; 3]; JOINTS]]) -> f64 {
        let place = Joint::ALL.map(|joint| {
            let mut nodes = clip.nodes.iter();
            nodes
                .position(|node| node.name == joint.name())
                .expect("every joint")
        });
        let mut largest: f64 = 0.0;
        for (frame, pose) in expected.iter().enumerate() {
            let found = clip.positions(frame as f64 * clip.seconds_per_frame);
            for joint in Joint::ALL {
                let expected = DVec3::from(pose[joint.index()].map(f64::from));
                largest = largest.max(found[place[joint.index()]].distance(expected));
            }
        }
        largest
    }

    fn written(options: &GlbOptions) -> Clip {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("motion.glb");
        write(&path, &example::rotations(), options).unwrap();
        read(&path, None).unwrap().0
    }

    #[test]
    fn what_is_written_reads_back_to_a_tenth_of_a_millimetre() {
        for body in [true, false] {
            let clip = written(&GlbOptions {
                body,
                ..GlbOptions::default()
            });
            assert_eq!(clip.frames, 40);
            assert!((clip.seconds_per_frame - 0.05).abs() < 1e-7);
            let gap = largest_gap(&clip, &example::rotations().joints());
            assert!(gap < 1e-4, "{gap}");
        }
    }

    #[test]
    fn a_long_motion_keeps_its_frames() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("long.glb");
        let rotations = lamogen_motion::Rotations::of(&example::motion(12_000));
        write(&path, &rotations, &GlbOptions::default()).unwrap();
        let (clip, _) = read(&path, None).unwrap();
        assert_eq!(clip.frames, 12_000);
        let gap = largest_gap(&clip, &rotations.joints());
        assert!(gap < 1e-4, "{gap}");
    }

    #[test]
    fn the_rest_pose_is_the_t_pose_on_the_ground() {
        let clip = written(&GlbOptions::default());
        let rest = example::rotations().rest().clone();
        for node in &clip.nodes {
            match Joint::from_name(&node.name) {
                Some(Joint::Pelvis) => assert!(node.rest.distance(standing(&rest)[0]) < 1e-6),
                Some(joint) => {
                    let offset = DVec3::from(rest.offset(joint).map(f64::from));
                    assert!(node.rest.distance(offset) < 1e-6);
                }
                None => assert_eq!(node.rest, DVec3::ZERO),
            }
        }
    }

    /// A hip on a moving root, with keyframes of ours; the bytes go into a data URI.
    fn foreign(nodes: Json, times: &[f32], curves: &[(usize, &str, &str, &[f32])]) -> Json {
        use base64::Engine;
        let mut bytes: Vec<u8> = times.iter().flat_map(|x| x.to_le_bytes()).collect();
        let mut views = vec![json!({ "buffer": 0, "byteLength": bytes.len() })];
        let mut accessors = vec![json!({
            "bufferView": 0, "componentType": 5126, "type": "SCALAR", "count": times.len()
        })];
        let (mut channels, mut samplers) = (Vec::new(), Vec::new());
        for &(node, path, interpolation, values) in curves {
            let (kind, width) = match path {
                "rotation" => ("VEC4", 4),
                _ => ("VEC3", 3),
            };
            views.push(json!({
                "buffer": 0, "byteOffset": bytes.len(), "byteLength": 4 * values.len()
            }));
            bytes.extend(values.iter().flat_map(|x| x.to_le_bytes()));
            accessors.push(json!({
                "bufferView": views.len() - 1, "componentType": 5126, "type": kind,
                "count": values.len() / width
            }));
            channels.push(json!({
                "sampler": samplers.len(), "target": { "node": node, "path": path }
            }));
            samplers.push(json!({
                "input": 0, "output": accessors.len() - 1, "interpolation": interpolation
            }));
        }
        let data = base64::engine::general_purpose::STANDARD.encode(&bytes);
        json!({
            "asset": { "version": "2.0" },
            "nodes": nodes,
            "animations": [{ "name": "idle", "channels": channels, "samplers": samplers }],
            "accessors": accessors,
            "bufferViews": views,
            "buffers": [{
                "byteLength": bytes.len(),
                "uri": format!("data:application/octet-stream;base64,{data}"),
            }],
        })
    }

    fn read_json(json: &Json) -> Result<Clip, GlbError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("foreign.gltf");
        std::fs::write(&path, json.to_string()).unwrap();
        read(&path, None).map(|(clip, _)| clip)
    }

    fn two_nodes() -> Json {
        // Blender's way: an armature that turns Z up to Y up and has another size, a bone below it.
        let half = std::f32::consts::FRAC_1_SQRT_2;
        json!([
            { "name": "Hips", "translation": [0.0, 0.0, 100.0] },
            {
                "name": "Armature", "children": [0],
                "rotation": [-half, 0.0, 0.0, half], "scale": [0.01, 0.01, 0.01],
            },
        ])
    }

    #[test]
    fn an_armature_with_turn_and_size_stands_upright() {
        let way = [0.0, 0.0, 100.0, 0.0, 50.0, 100.0];
        let curves: [(usize, &str, &str, &[f32]); 1] = [(0, "translation", "LINEAR", &way)];
        let clip = read_json(&foreign(two_nodes(), &[0.0, 0.5], &curves)).unwrap();
        let names: Vec<&str> = clip.nodes.iter().map(|node| &*node.name).collect();
        assert_eq!(names, ["Armature", "Hips"]);
        assert!(clip.nodes[1].rest.distance(DVec3::Y) < 1e-6);
        assert_eq!((clip.frames, clip.seconds_per_frame), (2, 0.5));
        let hips = clip.positions(0.25)[1];
        assert!(hips.distance(DVec3::new(0.0, 1.0, -0.25)) < 1e-6, "{hips}");
    }

    #[test]
    fn a_matrix_is_as_good_as_its_parts() {
        let mut nodes = two_nodes();
        let parts = nodes[1].as_object_mut().unwrap();
        parts.remove("rotation");
        parts.remove("scale");
        parts.insert(
            "matrix".into(),
            json!([
                0.01, 0.0, 0.0, 0.0, 0.0, 0.0, -0.01, 0.0, 0.0, 0.01, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0
            ]),
        );
        let way = [0.0; 3];
        let curves: [(usize, &str, &str, &[f32]); 1] = [(0, "translation", "LINEAR", &way)];
        let clip = read_json(&foreign(nodes, &[0.0], &curves)).unwrap();
        assert!(clip.nodes[1].rest.distance(DVec3::Y) < 1e-6);
        assert_eq!(clip.frames, 1);
    }

    #[test]
    fn keyframes_beside_a_grid_and_curves_are_followed_finely() {
        // x = t² as a spline, between keyframes that share no grid; the clip starts at the first of them.
        let times = [0.1f32, 0.337, 1.0];
        let spline: Vec<f32> = times
            .iter()
            .flat_map(|t| [2.0 * t, 0.0, 0.0, t * t, 0.0, 0.0, 2.0 * t, 0.0, 0.0])
            .collect();
        let curves: [(usize, &str, &str, &[f32]); 1] = [(1, "translation", "CUBICSPLINE", &spline)];
        let clip = read_json(&foreign(two_nodes(), &times, &curves)).unwrap();
        for seconds in [0.0, 0.2, 0.4321, 0.9] {
            let (x, time) = (clip.positions(seconds)[0].x, seconds + 0.1);
            assert!((x - time * time).abs() < 1e-4, "{seconds}: {x}");
        }
    }

    #[test]
    fn a_step_is_one_fine_frame_wide() {
        let way = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0];
        let curves: [(usize, &str, &str, &[f32]); 1] = [(1, "translation", "STEP", &way)];
        let clip = read_json(&foreign(two_nodes(), &[0.0, 2.0], &curves)).unwrap();
        assert_eq!(clip.positions(1.98)[0].x, 0.0);
        assert_eq!(clip.positions(2.0)[0].x, 1.0);
    }

    #[test]
    fn buffers_may_lie_beside_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("motion.gltf");
        let bytes = glb::bytes(&example::rotations(), &GlbOptions::default()).unwrap();
        let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
        let mut json: Json = serde_json::from_slice(&bytes[20..20 + length]).unwrap();
        json["buffers"][0]["uri"] = json!("the%20numbers.bin");
        std::fs::write(&path, json.to_string()).unwrap();
        let error = read(&path, None).err().unwrap().to_string();
        assert!(error.contains("the numbers.bin"), "{error}");
        std::fs::write(folder.path().join("the numbers.bin"), &bytes[28 + length..]).unwrap();
        let (clip, _) = read(&path, None).unwrap();
        assert!(largest_gap(&clip, &example::rotations().joints()) < 1e-4);
        // A folder, like a device or a pipe, is no file to read from; and nothing above the file is read at all.
        for (uri, part) in [
            (".", "not a regular file"),
            ("..", "beside this one or in a folder below"),
            ("a/../../secret.bin", "beside this one or in a folder below"),
            ("%2e%2e/secret.bin", "beside this one or in a folder below"),
            ("/etc/passwd", "beside this one or in a folder below"),
        ] {
            json["buffers"][0]["uri"] = json!(uri);
            std::fs::write(&path, json.to_string()).unwrap();
            let error = read(&path, None).err().unwrap().to_string();
            assert!(error.contains(part), "{error}");
        }
    }

    #[test]
    fn what_moves_no_node_cannot_be_wrong() {
        let way = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0];
        let curves: [(usize, &str, &str, &[f32]); 1] = [(1, "translation", "LINEAR", &way)];
        let whole = foreign(two_nodes(), &[0.0, 2.0], &curves);
        let expected = read_json(&whole).unwrap().positions(1.0);
        let with = |change: &dyn Fn(&mut Json)| {
            let mut changed = whole.clone();
            change(&mut changed);
            let clip = read_json(&changed).map_err(|error| error.to_string());
            clip.map(|clip| clip.positions(1.0))
        };
        let push = |json: &mut Json, list: &str, value: Json| {
            if !json[list].is_array() {
                json[list] = json!([]);
            }
            json[list].as_array_mut().unwrap().push(value);
        };
        type Change<'a> = dyn Fn(&mut Json) + 'a;
        let changes: [(&str, &Change<'_>); 7] = [
            ("a channel without a node", &|json| {
                let channel = json!({ "sampler": 0, "target": { "path": "translation" } });
                push(&mut json["animations"][0], "channels", channel);
            }),
            ("weights of shapes", &|json| {
                let channel = json!({ "sampler": 99, "target": { "node": 0, "path": "weights" } });
                push(&mut json["animations"][0], "channels", channel);
            }),
            ("extras of any type", &|json| {
                json["nodes"][0]["extras"] = json!([1, "x", null]);
                json["animations"][0]["extras"] = json!(3);
                json["extras"] = json!("text");
            }),
            ("a broken animation beside", &|json| {
                push(
                    json,
                    "animations",
                    json!({ "name": "broken", "channels": 7 }),
                );
            }),
            ("compressed meshes", &|json| {
                json["extensionsRequired"] = json!(["KHR_draco_mesh_compression"]);
                json["meshes"] = json!([{ "primitives": [{ "extensions": { "KHR_draco_mesh_compression": 1 } }] }]);
                push(
                    json,
                    "accessors",
                    json!({ "componentType": 1, "count": 0, "type": "BENT" }),
                );
                push(json, "bufferViews", json!({ "buffer": 77 }));
            }),
            ("pictures and skins", &|json| {
                json["images"] = json!([{ "uri": 5 }]);
                json["skins"] = json!([{ "joints": "all" }]);
                json["nodes"][0]["skin"] = json!(12);
            }),
            ("other buffers", &|json| {
                push(
                    json,
                    "buffers",
                    json!({ "byteLength": 10, "uri": "https://example.org/a.bin" }),
                );
            }),
        ];
        for (name, change) in changes {
            assert_eq!(with(change).as_ref(), Ok(&expected), "{name}");
        }
    }

    #[test]
    fn sparse_keyframes_are_read() {
        use base64::Engine;
        // Four keyframes of a way; two of them stand apart from the rest, with indices of one byte.
        let times = [0.0, 1.0, 2.0, 3.0];
        let way = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 2.0, 0.0, 0.0, 3.0, 0.0, 0.0];
        let curves: [(usize, &str, &str, &[f32]); 1] = [(1, "translation", "LINEAR", &way)];
        let mut json = foreign(two_nodes(), &times, &curves);
        let output = json["animations"][0]["samplers"][0]["output"]
            .as_u64()
            .unwrap() as usize;
        let mut bytes = vec![1u8, 3, 0, 0];
        for number in [7.0f32, 0.0, 0.0, 9.0, 0.0, 0.0] {
            bytes.extend(number.to_le_bytes());
        }
        let data = base64::engine::general_purpose::STANDARD.encode(&bytes);
        let uri = format!("data:application/octet-stream;base64,{data}");
        let buffer = json["buffers"].as_array().unwrap().len();
        json["buffers"]
            .as_array_mut()
            .unwrap()
            .push(json!({ "byteLength": bytes.len(), "uri": uri }));
        let views = json["bufferViews"].as_array_mut().unwrap();
        let first = views.len();
        views.push(json!({ "buffer": buffer, "byteLength": 2 }));
        views.push(json!({ "buffer": buffer, "byteOffset": 4, "byteLength": 24 }));
        let sparse = json!({
            "count": 2,
            "indices": { "bufferView": first, "componentType": 5121 },
            "values": { "bufferView": first + 1 },
        });
        json["accessors"][output]["sparse"] = sparse;
        let at = |json: &Json, second: f64| {
            let clip = read_json(json).map_err(|error| error.to_string());
            clip.map(|clip| clip.positions(second)[0].x)
        };
        for (second, expected) in [(0.0, 0.0), (1.0, 7.0), (2.0, 2.0), (3.0, 9.0)] {
            assert_eq!(at(&json, second), Ok(expected));
        }
        // What is not said at all is zero.
        json["accessors"][output]
            .as_object_mut()
            .unwrap()
            .remove("bufferView");
        for (second, expected) in [(0.0, 0.0), (1.0, 7.0), (2.0, 0.0), (3.0, 9.0)] {
            assert_eq!(at(&json, second), Ok(expected));
        }
        json["accessors"][output]["sparse"]["count"] = json!(40);
        assert!(at(&json, 0.0).unwrap_err().contains("sparse"));
    }

    #[test]
    fn animations_are_chosen_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("motion.glb");
        let options = GlbOptions {
            name: "jump".into(),
            ..GlbOptions::default()
        };
        write(&path, &example::rotations(), &options).unwrap();
        assert!(read(&path, Some("jump")).is_ok());
        let error = read(&path, Some("walk")).err().unwrap().to_string();
        assert!(
            error.contains("\"walk\"") && error.contains("\"jump\""),
            "{error}"
        );
    }

    #[test]
    fn animations_that_are_not_read_are_named() {
        let way: &[f32] = &[0.0; 6];
        let curves = [(0, "translation", "LINEAR", way)];
        let mut json = foreign(two_nodes(), &[0.0, 0.5], &curves);
        let mut second = json["animations"][0].clone();
        second["name"] = "walk".into();
        let mut third = second.clone();
        third.as_object_mut().unwrap().remove("name");
        json["animations"]
            .as_array_mut()
            .unwrap()
            .extend([second, third]);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("several.gltf");
        std::fs::write(&path, json.to_string()).unwrap();
        assert_eq!(read(&path, None).unwrap().1, ["walk", "without a name"]);
        assert_eq!(
            read(&path, Some("walk")).unwrap().1,
            ["idle", "without a name"]
        );
    }

    #[test]
    fn what_cannot_be_read_says_why() {
        let way: &[f32] = &[0.0; 6];
        let fine = foreign(
            two_nodes(),
            &[0.0, 0.5],
            &[(0, "translation", "LINEAR", way)],
        );
        assert!(read_json(&fine).is_ok());
        let cases: [(&str, Json, &str); 15] = [
            ("/asset/version", json!("1.0"), "version 1.0"),
            ("/nodes/0/children", json!([1]), "below itself"),
            ("/nodes/1/children", json!([0, 0]), "one parent"),
            ("/nodes/1/children", json!([7]), "out of bounds"),
            ("/nodes/1/scale", json!([1e39, 1.0, 1.0]), "nodes[1]"),
            ("/animations", json!([]), "expected an animation"),
            ("/accessors/0/count", json!(3), "accessor 0"),
            ("/accessors/1/count", json!(u64::MAX), "at most"),
            ("/accessors/1/type", json!("VEC4"), "3 numbers a row"),
            (
                "/accessors/1/sparse",
                json!({ "count": 1,
                "indices": { "bufferView": 0, "componentType": 5121 },
                "values": { "bufferView": 0 } }),
                "sparse",
            ),
            ("/bufferViews/1/byteLength", json!(20), "found 20 bytes"),
            ("/bufferViews/1/byteOffset", json!(1u64 << 60), "accessor 1"),
            ("/buffers/0/byteLength", json!(1u64 << 40), "at most"),
            (
                "/buffers/0/uri",
                json!("https://example.org/a.bin"),
                "https://example.org",
            ),
            (
                "/extensionsRequired",
                json!(["EXT_meshopt_compression"]),
                "EXT_meshopt_compression",
            ),
        ];
        for (place, value, expected) in cases {
            let mut json = fine.clone();
            let (parent, key) = place.rsplit_once('/').unwrap();
            let parent = json.pointer_mut(parent).unwrap();
            match key.parse::<usize>() {
                Ok(index) => parent[index] = value,
                Err(_) => parent[key] = value,
            }
            let message = match read_json(&json) {
                Ok(_) => panic!("{place} was accepted"),
                Err(error) => error.to_string(),
            };
            assert!(
                message.contains("foreign.gltf") && message.contains(expected),
                "{place}: {message}"
            );
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.glb");
        for (bytes, expected) in [
            (&b"Kaydara FBX Binary  "[..], "something else"),
            (b"", "something else"),
            (b"glTF\x01\0\0\0\x10\0\0\0", "version 2"),
            (b"glTF\x02\0\0\0\x0c\0\0\0", "JSON chunk"),
            (b"glTF\x02\0\0\0\xff\xff\xff\xff", "cut short"),
            (b"{}", "its JSON"),
        ] {
            std::fs::write(&path, bytes).unwrap();
            let message = read(&path, None).err().unwrap().to_string();
            assert!(
                message.contains("x.glb") && message.contains(expected),
                "{message}"
            );
        }
        let error = read(&folder.path().join("none.glb"), None).err().unwrap();
        assert!(matches!(error, GlbError::Io { .. }));
    }

    #[test]
    fn sizes_that_change_are_refused_where_they_carry_something() {
        let sizes: &[f32] = &[1.0, 1.0, 1.0, 2.0, 2.0, 2.0];
        let on = |node| {
            foreign(
                two_nodes(),
                &[0.0, 0.5],
                &[(node, "scale", "LINEAR", sizes)],
            )
        };
        assert!(read_json(&on(0)).is_ok());
        // What exporters leave of a size that stays.
        let sizes: &[f32] = &[0.01, 0.01, 0.01, 0.0100001, 0.01, 0.0099999];
        let steady = [(1, "scale", "LINEAR", sizes)];
        let clip = read_json(&foreign(two_nodes(), &[0.0, 0.5], &steady)).unwrap();
        assert!(clip.positions(0.5)[1].distance(DVec3::Y) < 1e-3);
        let message = read_json(&on(1)).err().unwrap().to_string();
        assert!(message.contains("Armature"), "{message}");
    }

    #[test]
    fn damaged_files_never_panic_or_grow() {
        let rotations = lamogen_motion::Rotations::of(&example::motion(3));
        let options = GlbOptions {
            body: false,
            ..GlbOptions::default()
        };
        let whole = glb::bytes(&rotations, &options).unwrap();
        let attempt = |bytes: &[u8]| {
            if let Ok((clip, _)) = read_bytes(bytes, Path::new("damaged.glb"), None) {
                let end = clip.frames as f64 * clip.seconds_per_frame;
                assert_eq!(clip.positions(end).len(), clip.nodes.len());
            }
        };
        for place in (0..whole.len()).step_by(3) {
            for value in [0, b'-', b'9', b'"', 0x7f, 0xff] {
                let mut damaged = whole.clone();
                damaged[place] = value;
                attempt(&damaged);
            }
        }
        for end in (0..whole.len()).step_by(7) {
            attempt(&whole[..end]);
        }
    }
}
