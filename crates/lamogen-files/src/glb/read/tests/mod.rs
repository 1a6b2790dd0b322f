//! Tests of the glTF reader.

mod errors;
mod other_programs;
mod round_trip;

use super::*;
use crate::clip::Clip;
use crate::glb::{GlbOptions, example, write};
use glam::DVec3;
use lamogen_motion::{JOINTS, Joint};
use serde_json::{Value as Json, json};

/// Returns the largest distance in metres between the expected joints and the nodes of a clip with their names.
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

fn write_and_read(options: &GlbOptions) -> Clip {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("motion.glb");
    write(&path, &example::rotations().into(), options).unwrap();
    read_file(&path, None).unwrap().0
}

/// Returns a glTF document with one animation of the given keyframes, whose bytes are embedded in a data URI.
fn document(nodes: Json, times: &[f32], curves: &[(usize, &str, &str, &[f32])]) -> Json {
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

/// Reads an animation of a file, as [`crate::read()`] does.
fn read_file(
    path: &Path,
    animation: Option<&str>,
) -> Result<(Clip, Vec<String>, Option<String>), GlbError> {
    let bytes = std::fs::read(path).unwrap();
    let motion = read(&bytes, path, path.parent(), animation)?;
    Ok((motion.clip, motion.other_animations, motion.copyright))
}

fn read_json(json: &Json) -> Result<Clip, GlbError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("other.gltf");
    std::fs::write(&path, json.to_string()).unwrap();
    read_file(&path, None).map(|(clip, ..)| clip)
}

fn two_nodes() -> Json {
    // The style of Blender: an armature that rotates Z up to Y up and has another scale, and a bone below it.
    let half = std::f32::consts::FRAC_1_SQRT_2;
    json!([
        { "name": "Hips", "translation": [0.0, 0.0, 100.0] },
        {
            "name": "Armature", "children": [0],
            "rotation": [-half, 0.0, 0.0, half], "scale": [0.01, 0.01, 0.01],
        },
    ])
}
