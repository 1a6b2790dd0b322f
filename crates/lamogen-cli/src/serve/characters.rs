//! Characters that clients have sent, on which motions are shown and written.

use std::collections::VecDeque;
use std::hash::{BuildHasher, RandomState};
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use lamogen::FRAMES_PER_SECOND;
use lamogen::character::{
    BonePose, Character, CharacterMesh, CharacterOptions, MeshPoses, MeshVertex, RetargetOptions,
    SaveOptions,
};
use lamogen_server::{Problem, ProblemKind, UploadedFile};
use serde_json::{Value, json};

use super::file_name;
use crate::report::scene_json;
use crate::scene::Scene;

/// The number of characters that are kept.
const KEPT: usize = 4;
/// The bytes of all kept files together, at most, beside the newest one.
const KEPT_BYTES: usize = 64_000_000;

/// The most poses of single nodes in a motion on a character: their memory.
const MOST_POSES: usize = 2_000_000;

/// The characters that were sent last. Those before them are forgotten.
pub struct CharacterStore {
    kept: Mutex<VecDeque<Arc<StoredCharacter>>>,
    /// What makes the names of characters: the same file has the same name as long as the server runs, and nobody can guess that of a file
    /// that he does not have.
    keys: [RandomState; 2],
}

/// A character that a client has sent.
pub struct StoredCharacter {
    id: String,
    character: Character,
    /// The bones of the mesh; `None` if it cannot be drawn.
    bones: Option<CharacterMesh>,
    size: usize,
}

impl CharacterStore {
    /// Makes an empty store.
    pub fn new() -> CharacterStore {
        CharacterStore {
            kept: Mutex::default(),
            keys: [RandomState::new(), RandomState::new()],
        }
    }

    fn lock(&self) -> MutexGuard<'_, VecDeque<Arc<StoredCharacter>>> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Reads a character and keeps it. Returns what a page needs to draw it.
    ///
    /// # Errors
    ///
    /// If the file is not a character in GLB or VRM.
    pub fn add(&self, file: &UploadedFile) -> Result<Value, Problem> {
        let mut name = "character.glb";
        for (key, value) in &file.options {
            if key != "name" {
                let problem = Problem::mismatch(ProblemKind::InvalidRequest, "name", key);
                return Err(problem.at("query"));
            }
            name = Some(file_name(value))
                .filter(|last| !last.is_empty())
                .unwrap_or(name);
        }
        let unreadable = |reason: &dyn std::fmt::Display| {
            Problem::new(ProblemKind::UnreadableFile, reason).at(name)
        };
        if !file.bytes.starts_with(b"glTF") {
            let problem =
                Problem::mismatch(ProblemKind::UnreadableFile, "GLB or VRM", "another format");
            return Err(problem.at(name));
        }
        let id = self
            .keys
            .iter()
            .map(|key| format!("{:016x}", key.hash_one(&file.bytes)));
        let id: String = id.collect();
        let character = Character::from_bytes(
            file.bytes.clone(),
            Path::new(name),
            &CharacterOptions::default(),
        );
        let character = character.map_err(|error| unreadable(&error))?;
        let (bones, mesh, mesh_problem) = match character.mesh() {
            Ok(mut mesh) => {
                let json = mesh_json(&mesh);
                // Poses need the bones alone.
                (mesh.vertices, mesh.indices, mesh.images) = Default::default();
                (Some(mesh), json, Value::Null)
            }
            Err(error) => (None, Value::Null, error.to_string().into()),
        };
        let notices = character.rest_pose_notice().map(ToString::to_string);
        let answer = json!({
            "onto": id,
            "name": name,
            "scheme": character.scheme(),
            "leg_length_m": character.leg_length(),
            "animations": character.animation_names(),
            "notices": notices.into_iter().collect::<Vec<String>>(),
            "mesh": mesh,
            "mesh_problem": mesh_problem,
        });
        let mut kept = self.lock();
        kept.retain(|other| other.id != id);
        while kept.len() >= KEPT || kept.iter().map(|other| other.size).sum::<usize>() > KEPT_BYTES
        {
            kept.pop_front();
        }
        let size = file.bytes.len();
        kept.push_back(Arc::new(StoredCharacter {
            id,
            character,
            bones,
            size,
        }));
        Ok(answer)
    }

    /// Returns a character that is kept.
    ///
    /// # Errors
    ///
    /// If it is not, because it was never sent, or others came after it.
    pub fn find(&self, id: &str) -> Result<Arc<StoredCharacter>, Problem> {
        let mut kept = self.lock();
        let place = kept.iter().position(|character| character.id == id);
        let found = place.and_then(|place| kept.remove(place)).ok_or_else(|| {
            let expected =
                "the name of a character that was sent to /api/v1/character and is still kept";
            Problem::mismatch(ProblemKind::InvalidRequest, expected, format!("{id:?}")).at("onto")
        })?;
        kept.push_back(found.clone());
        Ok(found)
    }
}

impl StoredCharacter {
    /// Checks that the poses of a motion on the character are not too many.
    fn check_length(&self, scene: &Scene) -> Result<(), Problem> {
        let (nodes, frames) = (self.character.node_count(), scene.main().motion.frames());
        match nodes * frames <= MOST_POSES {
            true => Ok(()),
            false => {
                let most = MOST_POSES / nodes;
                let expected =
                    format!("a motion of at most {most} frames on a character of {nodes} nodes");
                let problem = Problem::mismatch(
                    ProblemKind::InvalidRequest,
                    expected,
                    format!("{frames} frames"),
                );
                Err(problem.at("onto"))
            }
        }
    }

    /// Returns the file of the character with the main motion of a scene as one more animation.
    ///
    /// # Errors
    ///
    /// If the motion cannot be put on the character.
    pub fn file(&self, scene: &Scene) -> Result<Vec<u8>, Problem> {
        self.check_length(scene)?;
        let character = &self.character;
        { character.animate(&scene.main().motion, &RetargetOptions::default()) }
            .and_then(|animation| {
                character.bytes(&[animation.named(&scene.title)], &SaveOptions::default())
            })
            .map_err(|error| Problem::new(ProblemKind::GenerationFailed, error).at("onto"))
    }

    /// Returns the JSON of a scene, with the poses of the character's bones beside every motion.
    ///
    /// # Errors
    ///
    /// If a motion cannot be put on the character.
    pub fn json(&self, scene: &Scene) -> Result<Value, Problem> {
        self.check_length(scene)?;
        let mut whole = scene_json(scene);
        whole["onto"] = self.id.as_str().into();
        let Some(mesh) = &self.bones else {
            return Ok(whole);
        };
        let options = RetargetOptions {
            frames_per_second: FRAMES_PER_SECOND,
            ..RetargetOptions::default()
        };
        let motions = whole["motions"].as_array_mut();
        for (json, motion) in motions.into_iter().flatten().zip(&scene.motions) {
            let poses = self.character.mesh_poses(mesh, &motion.motion, &options);
            let poses = poses
                .map_err(|error| Problem::new(ProblemKind::GenerationFailed, error).at("onto"))?;
            json["character"] = poses_json(&poses);
        }
        Ok(whole)
    }
}

/// Returns the JSON of a mesh. Vertices are 40 bytes each, little-endian: the position as three 32-bit floats; the normal as three signed
/// bytes of 127ths, and a byte that is zero; the place on the texture as two 32-bit floats; four bones of 16 bits; four weights of
/// 255ths; red, green and blue in sRGB, and opacity, as four 255ths.
fn mesh_json(mesh: &CharacterMesh) -> Value {
    let mut vertices = Vec::with_capacity(40 * mesh.vertices.len());
    for vertex in &mesh.vertices {
        let MeshVertex {
            position,
            normal,
            texture_coordinates,
            colour: [red, green, blue, opacity],
            bones,
            weights,
        } = vertex;
        vertices.extend(position.iter().flat_map(|x| x.to_le_bytes()));
        let length = normal.iter().map(|x| x * x).sum::<f32>().sqrt().max(1e-9);
        vertices.extend(
            normal
                .iter()
                .map(|x| (127.0 * x / length).round() as i8 as u8),
        );
        vertices.push(0);
        vertices.extend(texture_coordinates.iter().flat_map(|x| x.to_le_bytes()));
        vertices.extend(bones.iter().flat_map(|bone| bone.to_le_bytes()));
        vertices.extend(weights.iter().map(|weight| (255.0 * weight).round() as u8));
        let colour = [red, green, blue].map(|light| light.powf(1.0 / 2.2));
        let colour = colour.iter().chain([opacity]);
        vertices.extend(colour.map(|x| (255.0 * x).round() as u8));
    }
    let indices: Vec<u8> = mesh
        .indices
        .iter()
        .flat_map(|index| index.to_le_bytes())
        .collect();
    let binds = mesh.bones.iter().flat_map(|bone| bone.bind);
    let binds: Vec<u8> = binds.flat_map(f32::to_le_bytes).collect();
    let groups = mesh.groups.iter().map(
        |group| json!({ "start": group.start, "count": group.count, "material": group.material }),
    );
    let materials = mesh.materials.iter().map(|material| {
        json!({
            "colour": material.colour,
            "image": material.image,
            "cutoff": material.cutoff,
            "translucent": material.is_translucent,
        })
    });
    let images = mesh
        .images
        .iter()
        .map(|image| json!({ "type": image.media_type, "bytes": STANDARD.encode(&image.bytes) }));
    json!({
        "vertex_count": mesh.vertices.len(),
        "triangle_count": mesh.indices.len() / 3,
        "bones": mesh.bones.iter().map(|bone| bone.name.as_str()).collect::<Vec<&str>>(),
        "vertices": STANDARD.encode(vertices),
        "indices": STANDARD.encode(indices),
        "binds": STANDARD.encode(binds),
        "groups": groups.collect::<Vec<Value>>(),
        "materials": materials.collect::<Vec<Value>>(),
        "images": images.collect::<Vec<Value>>(),
    })
}

/// Returns the JSON of poses: frames × bones × 7 floats of 32 bits, which are the position and the rotation as a quaternion.
fn poses_json(poses: &MeshPoses) -> Value {
    let numbers = poses.frames.iter().flatten().flat_map(|pose| {
        let BonePose { position, rotation } = pose;
        position.iter().chain(rotation).copied()
    });
    let bytes: Vec<u8> = numbers.flat_map(f32::to_le_bytes).collect();
    json!({
        "frames": poses.frames.len(),
        "frames_per_second": poses.frames_per_second,
        "scale": poses.scale,
        "poses": STANDARD.encode(bytes),
    })
}
