//! Writing rotations as binary glTF.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::Path;

use lamogen_motion::{JOINTS, Joint, Keyframes, Rotations, write_atomically};
use serde_json::{Value, json};

use super::GlbError;
use super::body::{BodySide, body_capsules, t_pose_on_ground};
use super::buffer::{BufferBuilder, BufferViewTarget};
use super::skeleton::{ROOT, SkeletonFile, node_index};

/// Options for writing a GLB file.
#[derive(Clone, Debug, PartialEq)]
pub struct GlbOptions {
    /// The name of the animation, which players list.
    pub name: String,
    /// Whether the skeleton has a body of capsules. Without a body, viewers that draw only surfaces show nothing, and
    /// Blender creates empties instead of an armature.
    pub body: bool,
    /// The terms under which the motion may be used: the field `asset.copyright` of glTF.
    pub copyright: Option<String>,
    /// Notes on the motion, such as its text and seed: the `extras` of the root node, which Blender shows as custom
    /// properties and three.js as `userData`.
    pub notes: BTreeMap<String, String>,
}

impl Default for GlbOptions {
    fn default() -> Self {
        GlbOptions {
            name: "motion".into(),
            body: true,
            copyright: None,
            notes: BTreeMap::new(),
        }
    }
}

/// The rotation of a joint that does not turn.
const STILL: [f32; 4] = [0.0, 0.0, 0.0, 1.0];

/// Writes keyframes as a GLB file with the content of [`bytes()`].
///
/// # Errors
///
/// The same as for [`bytes()`]; and if the file cannot be written. In this case, no incomplete file is left.
pub fn write(
    path: impl AsRef<Path>,
    keyframes: &Keyframes,
    options: &GlbOptions,
) -> Result<(), GlbError> {
    let path = path.as_ref();
    let bytes = bytes(keyframes, options)?;
    write_atomically(path, |file| file.write_all(&bytes)).map_err(|reason| GlbError::Io {
        path: path.to_owned(),
        reason,
    })
}

/// Returns the bytes of a GLB file with the skeleton, its animation with a keyframe at every frame, and a body. If the root
/// travels, the node above the pelvis is moved.
///
/// # Errors
///
/// If a number of the motion is not finite, or the file would be larger than the 4 GiB that the format GLB allows.
pub fn bytes(keyframes: &Keyframes, options: &GlbOptions) -> Result<Vec<u8>, GlbError> {
    let rotations = &keyframes.rotations;
    let mut buffer = BufferBuilder::default();
    let file = SkeletonFile {
        rotations,
        root_path: keyframes.root_path.as_deref(),
        name: &options.name,
        copyright: options.copyright.as_deref(),
        notes: &options.notes,
        node_name: Joint::name,
        pelvis_height: t_pose_on_ground(rotations.rest())[Joint::Pelvis.index()].y,
    };
    let mut document = file.document();
    let turns_at_all = |_, turns: &[[f32; 4]]| turns.iter().any(|turn| *turn != STILL);
    document["animations"] = json!([file.animation(&mut buffer, turns_at_all)]);
    if options.body {
        add_body(&mut document, rotations, &mut buffer);
    }
    buffer.into_glb(document)
}

/// Adds the capsules of the body as one mesh with three materials, bound to the joints.
fn add_body(document: &mut Value, rotations: &Rotations, buffer: &mut BufferBuilder) {
    let capsules = body_capsules(rotations.rest());
    let mut primitives = Vec::new();
    for (material, side) in BodySide::ALL.into_iter().enumerate() {
        let (mut positions, mut normals, mut joints) = (Vec::new(), Vec::new(), Vec::new());
        let mut indices = Vec::new();
        for part in capsules.iter().filter(|part| part.side == side) {
            let mesh = part.capsule.mesh();
            let first = positions.len() as u16;
            indices.extend(mesh.triangles.as_flattened().iter().map(|i| first + i));
            joints.extend(
                mesh.positions
                    .iter()
                    .map(|_| [part.joint.index() as u8, 0, 0, 0]),
            );
            positions.extend(mesh.positions);
            normals.extend(mesh.normals);
        }
        let weights = vec![[1.0, 0.0, 0.0, 0.0]; positions.len()];
        primitives.push(json!({
            "attributes": {
                "POSITION": buffer.push_floats(&positions, BufferViewTarget::Vertices),
                "NORMAL": buffer.push_floats(&normals, BufferViewTarget::Vertices),
                "JOINTS_0": buffer.push_bytes(&joints, BufferViewTarget::Vertices),
                "WEIGHTS_0": buffer.push_floats(&weights, BufferViewTarget::Vertices),
            },
            "indices": buffer.push_shorts(&indices, BufferViewTarget::Indices),
            "material": material,
        }));
    }
    let inverse: [[f32; 16]; JOINTS] = t_pose_on_ground(rotations.rest()).map(|position| {
        let [x, y, z] = (-position).as_vec3().to_array();
        [
            1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, x, y, z, 1.0,
        ]
    });
    document["materials"] = BodySide::ALL.iter().map(|&side| material(side)).collect();
    document["meshes"] = json!([{ "name": "body", "primitives": primitives }]);
    document["skins"] = json!([{
        "name": "skeleton",
        "skeleton": node_index(Joint::Pelvis),
        "joints": Joint::ALL.map(node_index),
        "inverseBindMatrices": buffer.push_floats(&inverse, BufferViewTarget::Other),
    }]);
    // A skinned mesh moves only with its joints, so its node is a child of the scene and not of the root node.
    let nodes = document["nodes"].as_array_mut().expect("the skeleton");
    nodes.push(json!({ "name": "body", "mesh": 0, "skin": 0 }));
    document["scenes"][0]["nodes"] = json!([ROOT, nodes.len() - 1]);
}

/// Returns the material of one side of the body.
fn material(side: BodySide) -> Value {
    // The colours of glTF are linear, not sRGB.
    let linear = |value: u8| match f64::from(value) / 255.0 {
        low if low <= 0.04045 => low / 12.92,
        high => ((high + 0.055) / 1.055).powf(2.4),
    };
    let [red, green, blue] = side.colour().map(linear);
    json!({
        "name": side.name(),
        "pbrMetallicRoughness": {
            "baseColorFactor": [red, green, blue, 1.0],
            "metallicFactor": 0.0,
            "roughnessFactor": 0.8,
        },
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::glb::example;
    use glam::{DQuat, DVec3, Mat4, Quat, Vec3};
    use gltf::animation::Property;

    fn file(options: &GlbOptions) -> gltf::Gltf {
        let bytes = bytes(&example::rotations().into(), options).unwrap();
        gltf::Gltf::from_slice(&bytes).unwrap()
    }

    #[test]
    fn a_file_is_a_header_and_two_chunks_at_multiples_of_four() {
        let bytes = bytes(&example::rotations().into(), &GlbOptions::default()).unwrap();
        let word =
            |place: usize| u32::from_le_bytes(bytes[place..place + 4].try_into().unwrap()) as usize;
        assert_eq!(
            (&bytes[..4], word(4), word(8)),
            (&b"glTF"[..], 2, bytes.len())
        );
        let (json, start) = (word(12), 20 + word(12));
        assert_eq!(&bytes[16..20], b"JSON");
        assert_eq!(&bytes[start + 4..start + 8], b"BIN\0");
        assert_eq!(start + 8 + word(start), bytes.len());
        assert_eq!((json % 4, word(start) % 4), (0, 0));
        let document: Value = serde_json::from_slice(&bytes[20..start]).unwrap();
        for view in document["bufferViews"].as_array().unwrap() {
            assert_eq!(view["byteOffset"].as_u64().unwrap() % 4, 0);
        }
        for accessor in document["accessors"].as_array().unwrap() {
            assert_eq!(
                accessor["componentType"] == 5126,
                accessor.get("min").is_some()
            );
        }
    }

    #[test]
    fn nodes_are_the_joints_in_a_t_pose_on_the_ground() {
        let rest = example::rotations().rest().clone();
        let gltf = file(&GlbOptions::default());
        let roots: Vec<&str> = gltf
            .scenes()
            .next()
            .unwrap()
            .nodes()
            .map(|n| n.name().unwrap())
            .collect();
        assert_eq!(roots, ["lamogen", "body"]);
        assert_eq!(gltf.nodes().len(), JOINTS + 2);
        for parent in gltf.nodes() {
            for child in parent.children() {
                let joint = Joint::from_name(child.name().unwrap()).unwrap();
                let expected = joint.parent().map_or("lamogen", Joint::name);
                assert_eq!(parent.name(), Some(expected));
                let (shift, turn, scale) = child.transform().decomposed();
                assert_eq!((turn, scale), ([0.0, 0.0, 0.0, 1.0], [1.0; 3]));
                match joint {
                    Joint::Pelvis => assert_eq!([shift[0], shift[2]], [0.0, 0.0]),
                    _ => assert_eq!(shift, rest.offset(joint)),
                }
            }
        }
    }

    #[test]
    fn the_body_is_bound_to_the_t_pose() {
        let gltf = file(&GlbOptions::default());
        let bytes = gltf.blob.as_ref().unwrap();
        let data = |_: gltf::Buffer| Some(&bytes[..]);
        let skin = gltf.skins().next().unwrap();
        let joints: Vec<&str> = skin.joints().map(|node| node.name().unwrap()).collect();
        assert_eq!(joints, Joint::ALL.map(Joint::name));
        let place = t_pose_on_ground(example::rotations().rest());
        let inverse = skin.reader(data).read_inverse_bind_matrices().unwrap();
        for (joint, inverse) in Joint::ALL.into_iter().zip(inverse) {
            let bind = Mat4::from_translation(place[joint.index()].as_vec3());
            let still = bind * Mat4::from_cols_array_2d(&inverse);
            assert!(still.abs_diff_eq(Mat4::IDENTITY, 1e-6), "{}", joint.name());
        }

        let mut vertices = 0;
        let mesh = gltf.meshes().next().unwrap();
        let mut lowest = f32::INFINITY;
        for (primitive, side) in mesh.primitives().zip(BodySide::ALL) {
            assert_eq!(primitive.material().name(), Some(side.name()));
            let reader = primitive.reader(data);
            let positions: Vec<[f32; 3]> = reader.read_positions().unwrap().collect();
            let indices: Vec<u32> = reader.read_indices().unwrap().into_u32().collect();
            assert_eq!(indices.iter().max(), Some(&(positions.len() as u32 - 1)));
            assert_eq!(indices.len() % 3, 0);
            for weights in reader.read_weights(0).unwrap().into_f32() {
                assert_eq!(weights, [1.0, 0.0, 0.0, 0.0]);
            }
            let bound = reader.read_joints(0).unwrap().into_u16();
            for (position, [joint, ..]) in positions.iter().zip(bound) {
                let joint = Joint::ALL[usize::from(joint)];
                // No capsule reaches further than its bone and its radius.
                let gap = Vec3::from(*position).distance(place[joint.index()].as_vec3());
                assert!(gap < 0.62, "{}: {gap}", joint.name());
                lowest = lowest.min(position[1]);
            }
            for normal in reader.read_normals().unwrap() {
                assert!((Vec3::from(normal).length() - 1.0).abs() < 1e-5);
            }
            vertices += positions.len();
        }
        assert!((0.0..0.02).contains(&lowest), "{lowest}");
        assert!(vertices < 4000, "{vertices}");
    }

    #[test]
    fn the_animation_has_a_keyframe_a_frame_and_moves_the_joints_as_the_motion_does() {
        let rotations = example::rotations();
        let gltf = file(&GlbOptions {
            name: "a jump".into(),
            ..GlbOptions::default()
        });
        let bytes = gltf.blob.as_ref().unwrap();
        let animation = gltf.animations().next().unwrap();
        assert_eq!(animation.name(), Some("a jump"));
        let mut turns = vec![[DQuat::IDENTITY; JOINTS]; rotations.frames()];
        let mut way = Vec::new();
        for channel in animation.channels() {
            let joint = Joint::from_name(channel.target().node().name().unwrap()).unwrap();
            let reader = channel.reader(|_| Some(&bytes[..]));
            let times: Vec<f32> = reader.read_inputs().unwrap().collect();
            let expected: Vec<f32> = (0..40).map(|frame| frame as f32 / 20.0).collect();
            assert_eq!(times, expected);
            match reader.read_outputs().unwrap() {
                gltf::animation::util::ReadOutputs::Translations(values) => {
                    assert_eq!(joint, Joint::Pelvis);
                    way.extend(values);
                }
                gltf::animation::util::ReadOutputs::Rotations(values) => {
                    let mut last: Option<Quat> = None;
                    for (pose, value) in turns.iter_mut().zip(values.into_f32()) {
                        let turn = Quat::from_array(value);
                        assert!((turn.length() - 1.0).abs() < 1e-6);
                        assert!(last.is_none_or(|last| last.dot(turn) >= 0.0));
                        last = Some(turn);
                        pose[joint.index()] = turn.as_dquat();
                    }
                }
                _ => panic!("{:?}", channel.target().property()),
            }
        }
        assert_eq!(way, rotations.root());
        for (frame, pose) in rotations.joints().iter().enumerate() {
            let mut global = [(DVec3::ZERO, DQuat::IDENTITY); JOINTS];
            for joint in Joint::ALL {
                let (place, turn) = match joint.parent() {
                    None => (DVec3::from(way[frame].map(f64::from)), DQuat::IDENTITY),
                    Some(parent) => {
                        let (place, turn) = global[parent.index()];
                        let offset = DVec3::from(rotations.rest().offset(joint).map(f64::from));
                        (place + turn * offset, turn)
                    }
                };
                global[joint.index()] = (place, turn * turns[frame][joint.index()]);
                let expected = DVec3::from(pose[joint.index()].map(f64::from));
                assert!(place.distance(expected) < 1e-5, "{frame} {}", joint.name());
            }
        }
    }

    #[test]
    fn joints_that_never_turn_have_no_channel() {
        let motion = lamogen_motion::Motion::from_joints(vec![example::motion(1).joints()[0]; 5]);
        let rotations = Rotations::of(&motion.unwrap());
        let bytes = bytes(&rotations.clone().into(), &GlbOptions::default()).unwrap();
        let gltf = gltf::Gltf::from_slice(&bytes).unwrap();
        let turns = |joint: Joint| {
            let turn = rotations.local()[0][joint.index()];
            turn != [0.0, 0.0, 0.0, 1.0]
        };
        for joint in Joint::ALL {
            let mut channels = gltf.animations().next().unwrap().channels();
            let has_channel = channels.any(|channel| {
                let target = channel.target();
                target.node().name() == Some(joint.name())
                    && target.property() == Property::Rotation
            });
            assert_eq!(has_channel, turns(joint), "{}", joint.name());
        }
    }

    #[test]
    fn options_are_kept() {
        let options = GlbOptions {
            body: false,
            copyright: Some("CC-BY-NC-4.0".into()),
            notes: BTreeMap::from([("text".into(), "a person \"jumps\" ☃".into())]),
            ..GlbOptions::default()
        };
        let bytes = bytes(&example::rotations().into(), &options).unwrap();
        let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
        let document: Value = serde_json::from_slice(&bytes[20..20 + length]).unwrap();
        assert_eq!(document["asset"]["copyright"], "CC-BY-NC-4.0");
        assert_eq!(
            document["nodes"][0]["extras"]["text"],
            "a person \"jumps\" ☃"
        );
        assert_eq!(document.get("meshes"), None);
        assert_eq!(document.get("skins"), None);
    }

    #[test]
    fn the_error_names_a_folder_that_does_not_exist() {
        let error = write(
            "no/such/a.glb",
            &example::rotations().into(),
            &GlbOptions::default(),
        );
        assert!(error.unwrap_err().to_string().contains("no/such/a.glb"));
    }
}
