//! VRM characters and animations for the judge that plays them.

use std::io::Write;
use std::path::{Path, PathBuf};

use glam::{DMat4, DQuat, DVec3, EulerRot};
use lamogen_files::glb::{self, GlbOptions, split_chunks};
use lamogen_files::vrma::human_bone;
use lamogen_files::{WriteOptions, write};
use lamogen_motion::{JOINTS, Joint, Motion, write_atomically};
use serde_json::{Map, Value, json};

use super::{Result, motions};

/// The files of the judge that plays VRM animations.
pub struct VrmFiles {
    pub animations: Vec<PathBuf>,
    pub characters: Vec<PathBuf>,
    /// A list of all files as JSON, with what the motions are expected to do.
    pub list: PathBuf,
}

/// A character of capsules.
struct VrmCharacter {
    name: &'static str,
    version: VrmVersion,
    /// The size of its legs, trunk and arms in units of those of the judged motions' body.
    sizes: [f64; 3],
    /// Whether it has a bone for the upper chest, which VRM does not require.
    has_upper_chest: bool,
}

#[derive(Clone, Copy, PartialEq)]
enum VrmVersion {
    /// Faces -Z, without any rotation of nodes.
    Zero,
    /// Faces +Z; each bone has axes of its own, and knees and elbows are slightly bent.
    One,
}

const CHARACTERS: [VrmCharacter; 3] = [
    VrmCharacter {
        name: "vrm1",
        version: VrmVersion::One,
        sizes: [1.15, 0.95, 1.05],
        has_upper_chest: true,
    },
    VrmCharacter {
        name: "vrm0",
        version: VrmVersion::Zero,
        sizes: [0.6, 0.7, 0.55],
        has_upper_chest: true,
    },
    VrmCharacter {
        name: "vrm0-without-upper-chest",
        version: VrmVersion::Zero,
        sizes: [1.0; 3],
        has_upper_chest: false,
    },
];

impl VrmFiles {
    /// Writes all characters, and an animation of each motion.
    ///
    /// # Errors
    ///
    /// If a file cannot be written.
    pub fn write(folder: &Path, motions: &[(&str, Motion)]) -> Result<VrmFiles> {
        let (mut animations, mut characters) = (Vec::new(), Vec::new());
        let (mut character_list, mut animation_list) = (Vec::new(), Vec::new());
        for character in &CHARACTERS {
            let path = folder.join(format!("{}.vrm", character.name));
            let bytes = character.file()?;
            write_atomically(&path, |file| file.write_all(&bytes))?;
            character_list.push(json!({
                "file": path,
                "version": match character.version { VrmVersion::Zero => "0", VrmVersion::One => "1" },
            }));
            characters.push(path);
        }
        for (name, motion) in motions {
            let path = folder.join(format!("{name}.vrma"));
            write(&path, motion, &WriteOptions::default())?;
            animation_list.push(expected(&path, motion)?);
            animations.push(path);
        }
        let list = folder.join("vrm.json");
        let content = json!({ "characters": character_list, "animations": animation_list });
        write_atomically(&list, |file| Ok(serde_json::to_writer(file, &content)?))?;
        Ok(VrmFiles {
            animations,
            characters,
            list,
        })
    }
}

/// Returns what players are expected to do with the animation of a motion: at every second frame of the motion, where the
/// file has a keyframe, the place of the hips and the rotation of every bone in the world.
fn expected(path: &Path, motion: &Motion) -> Result<Value> {
    const STEP: usize = 2;
    let rotations = motion.rotations();
    let rate = f64::from(rotations.frames_per_second());
    let frames = (0..rotations.frames()).step_by(STEP).map(|frame| {
        let mut world = [DQuat::IDENTITY; JOINTS];
        let mut bones = Map::new();
        for joint in Joint::ALL {
            let local = DQuat::from_array(rotations.local()[frame][joint.index()].map(f64::from));
            let parent = joint.parent();
            let above = parent.map_or(DQuat::IDENTITY, |parent| world[parent.index()]);
            world[joint.index()] = (above * local).normalize();
            let turn = json!(world[joint.index()].to_array());
            if let Some(bone) = human_bone(joint) {
                bones.insert(bone.to_owned(), turn.clone());
            }
            // The upper chest of a character that has one keeps to its chest.
            if joint == Joint::Spine3 {
                bones.insert("upperChest".into(), turn);
            }
        }
        // The rotations must be those of the motion itself: they bring the bones of the rest pose to where its joints are.
        for joint in Joint::ALL {
            if let Some(parent) = joint.parent() {
                let [from, to] = [parent, joint].map(|joint| vector(motion.position(frame, joint)));
                let rest = vector(rotations.rest().offset(joint));
                let gap = (world[parent.index()] * rest).angle_between(to - from);
                assert!(gap < 0.2f64.to_radians(), "{}: {gap}", joint.name());
            }
        }
        json!({ "time": frame as f64 / rate, "hips": rotations.root()[frame], "rotations": bones })
    });
    let frames: Vec<Value> = frames.collect();
    let document: Value = serde_json::from_slice(split_chunks(&std::fs::read(path)?)?.0)?;
    let hips = &document["extensions"]["VRMC_vrm_animation"]["humanoid"]["humanBones"]["hips"];
    let hips = hips["node"].as_u64().ok_or("expected hips")? as usize;
    Ok(json!({
        "file": path,
        "duration": (rotations.frames() - 1) as f64 / rate,
        "rest_hips_height": document["nodes"][hips]["translation"][1],
        "frames": frames,
    }))
}

impl VrmCharacter {
    /// Returns the bytes of the file: the skinned capsules of a GLB around a body of this size, made a VRM.
    fn file(&self) -> Result<Vec<u8>> {
        let body = Motion::from_joints(vec![motions::t_pose(self.sizes)])?;
        let plain = glb::bytes(
            &body.rotations().into_owned().into(),
            &GlbOptions::default(),
        )?;
        let (json, binary) = split_chunks(&plain)?;
        let mut document: Value = serde_json::from_slice(json)?;
        let mut binary = binary.ok_or("expected a binary chunk")?.to_vec();
        // A character has no animation of its own.
        { document.as_object_mut() }.and_then(|document| document.remove("animations"));
        self.turn_bones(&mut document, &mut binary)?;
        self.add_extension(&mut document);
        Ok(pack(&document, &binary))
    }

    /// Gives the nodes of the joints their rotations in the rest pose, and moves the mesh with them.
    fn turn_bones(&self, document: &mut Value, binary: &mut [u8]) -> Result<()> {
        let facing = match self.version {
            VrmVersion::Zero => DQuat::from_rotation_y(std::f64::consts::PI),
            VrmVersion::One => DQuat::IDENTITY,
        };
        let accessor = document["skins"][0]["inverseBindMatrices"].as_u64();
        let accessor = &mut document["accessors"][accessor.ok_or("expected a skin")? as usize];
        // The bounds are those of the numbers that are replaced.
        for bound in ["min", "max"] {
            { accessor.as_object_mut() }.and_then(|accessor| accessor.remove(bound));
        }
        let view = accessor["bufferView"].as_u64().ok_or("expected a view")?;
        let offset = document["bufferViews"][view as usize]["byteOffset"].as_u64();
        let offset = offset.ok_or("expected an offset")? as usize;
        let mut world = [DMat4::IDENTITY; JOINTS];
        let mut places = [DVec3::ZERO; JOINTS];
        for joint in Joint::ALL {
            let index = joint.index();
            let node = &mut document["nodes"][1 + index];
            let own: [f64; 3] = serde_json::from_value(node["translation"].clone())?;
            let above = joint.parent().map(Joint::index);
            places[index] =
                above.map_or(DVec3::ZERO, |above| places[above]) + DVec3::from_array(own);
            let place = places[index] + self.bend(joint);
            let rotation = match self.version {
                VrmVersion::Zero => DQuat::IDENTITY,
                VrmVersion::One => {
                    let seed = index as f64;
                    DQuat::from_euler(EulerRot::XYZ, seed, 2.0 * seed, 0.7 * seed)
                }
            };
            world[index] = DMat4::from_rotation_translation(rotation, facing * place);
            let above = above.map_or(DMat4::IDENTITY, |above| world[above]);
            let local = above.inverse() * world[index];
            let (_, rotation, translation) = local.to_scale_rotation_translation();
            node["translation"] = json!(translation.to_array());
            if self.version == VrmVersion::One {
                node["rotation"] = json!(rotation.normalize().to_array());
            }
            let bind = world[index].inverse() * DMat4::from_quat(facing);
            let mut numbers = bind.to_cols_array();
            // The specification wants the last row to be exact.
            for (number, exact) in [(3, 0.0), (7, 0.0), (11, 0.0), (15, 1.0)] {
                numbers[number] = exact;
            }
            for (place, number) in numbers.into_iter().enumerate() {
                let start = offset + 64 * index + 4 * place;
                binary[start..start + 4].copy_from_slice(&(number as f32).to_le_bytes());
            }
        }
        Ok(())
    }

    /// Returns how far a joint is from where it is on a body with straight limbs, in metres.
    fn bend(&self, joint: Joint) -> DVec3 {
        match joint {
            _ if self.version == VrmVersion::Zero => DVec3::ZERO,
            Joint::LeftKnee | Joint::RightKnee => DVec3::new(0.0, 0.0, 0.02),
            Joint::LeftElbow | Joint::RightElbow => DVec3::new(0.0, 0.0, -0.01),
            _ => DVec3::ZERO,
        }
    }

    /// Adds the extension that makes a glTF a VRM.
    fn add_extension(&self, document: &mut Value) {
        let joints = Joint::ALL.into_iter();
        let joints = joints.filter(|joint| self.has_upper_chest || *joint != Joint::Spine3);
        let bone = |joint: Joint| match joint {
            Joint::Spine2 => "chest",
            Joint::Spine3 => "upperChest",
            joint => human_bone(joint).expect("a bone at every other joint"),
        };
        let bones = joints.map(|joint| (bone(joint), 1 + joint.index()));
        let (name, extension) = match self.version {
            VrmVersion::Zero => {
                let bones: Vec<Value> = bones
                    .map(|(bone, node)| json!({ "bone": bone, "node": node, "useDefaultValues": true }))
                    .collect();
                // The usual one; three-vrm complains of others.
                let degree_map = json!({
                    "curve": [0, 0, 0, 1, 1, 1, 1, 0], "xRange": 90, "yRange": 10,
                });
                let extension = json!({
                    "exporterVersion": "lamogen",
                    "specVersion": "0.0",
                    "meta": { "title": self.name, "author": "lamogen", "licenseName": "CC0" },
                    "humanoid": { "humanBones": bones },
                    "firstPerson": {
                        "lookAtTypeName": "Bone",
                        "lookAtHorizontalInner": degree_map,
                        "lookAtHorizontalOuter": degree_map,
                        "lookAtVerticalDown": degree_map,
                        "lookAtVerticalUp": degree_map,
                    },
                    "blendShapeMaster": { "blendShapeGroups": [] },
                    "secondaryAnimation": { "boneGroups": [], "colliderGroups": [] },
                    "materialProperties": [],
                });
                ("VRM", extension)
            }
            VrmVersion::One => {
                let bones: Map<String, Value> = bones
                    .map(|(bone, node)| (bone.to_owned(), json!({ "node": node })))
                    .collect();
                let extension = json!({
                    "specVersion": "1.0",
                    "meta": {
                        "name": self.name,
                        "authors": ["lamogen"],
                        "licenseUrl": "https://vrm.dev/licenses/1.0/",
                    },
                    "humanoid": { "humanBones": bones },
                });
                ("VRMC_vrm", extension)
            }
        };
        document["extensionsUsed"] = json!([name]);
        document["extensions"] = json!({ name: extension });
    }
}

/// Packs a document and a binary chunk as GLB.
fn pack(document: &Value, binary: &[u8]) -> Vec<u8> {
    let mut json = document.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let length = |bytes: usize| (bytes as u32).to_le_bytes();
    let mut file = b"glTF\x02\0\0\0".to_vec();
    file.extend(length(12 + 8 + json.len() + 8 + binary.len()));
    for (kind, chunk) in [(b"JSON", &json[..]), (b"BIN\0", binary)] {
        file.extend(length(chunk.len()));
        file.extend(kind);
        file.extend(chunk);
    }
    file
}

fn vector(point: [f32; 3]) -> DVec3 {
    DVec3::from(point.map(f64::from))
}
