//! The mesh of a character, ready to be drawn: vertices with their bones, and where the bones are in a motion.

use std::collections::HashMap;

use glam::{DMat4, DQuat, DVec3};
use lamogen_files::glb::{Surface, SurfaceImage, SurfaceMaterial, Surfaces};
use lamogen_motion::Motion;

use crate::character::{Character, CharacterAnimation};
use crate::document::GltfDocument;
use crate::error::CharacterError;
use crate::retarget::RetargetOptions;
use crate::skeleton::CharacterSkeleton;

/// The mesh of a character. A vertex is moved by up to four bones.
#[derive(Clone, Debug, PartialEq)]
pub struct CharacterMesh {
    /// The vertices.
    pub vertices: Vec<MeshVertex>,
    /// The vertices of the triangles, three for each.
    pub indices: Vec<u32>,
    /// Which triangles have which material.
    pub groups: Vec<MeshGroup>,
    /// The materials.
    pub materials: Vec<SurfaceMaterial>,
    /// The images of the textures as they are in the file.
    pub images: Vec<SurfaceImage>,
    /// The bones: nodes that move vertices.
    pub bones: Vec<MeshBone>,
    /// The height of the lowest vertex in the rest pose, in metres.
    floor: f64,
}

/// A vertex of a mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshVertex {
    /// The position in the space of the mesh.
    pub position: [f32; 3],
    /// The normal in the space of the mesh.
    pub normal: [f32; 3],
    /// The place on the texture.
    pub texture_coordinates: [f32; 2],
    /// Red, green, blue and opacity from 0 to 1, in linear light, which are multiplied with the colour of the material.
    pub colour: [f32; 4],
    /// The places of the bones in [`CharacterMesh::bones`].
    pub bones: [u16; 4],
    /// The weights of the bones; their sum is 1.
    pub weights: [f32; 4],
}

/// Triangles of one material.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MeshGroup {
    /// The place of the first vertex in [`CharacterMesh::indices`].
    pub start: usize,
    /// The number of vertices there.
    pub count: usize,
    /// The place of the material in [`CharacterMesh::materials`].
    pub material: Option<usize>,
}

/// A node that moves vertices.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshBone {
    /// The name of the node.
    pub name: String,
    /// The matrix from the space of the mesh into that of the bone, in metres of the character, column by column.
    pub bind: [f32; 16],
    /// The place of the node in the skeleton.
    place: usize,
}

/// Where the bones of a mesh are in a motion, in the space of the motion: the character faces as the motion's body does, stands on the
/// ground at height 0, and its legs are as long as those of the motion's body.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshPoses {
    /// Frames per second.
    pub frames_per_second: f32,
    /// The size of the character in the space of the motion: a vertex is at `position + rotation * (scale * bind * vertex)`.
    pub scale: f32,
    /// For every frame a pose of each bone.
    pub frames: Vec<Vec<BonePose>>,
}

/// The pose of a bone at a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BonePose {
    /// The position in metres.
    pub position: [f32; 3],
    /// The rotation: a quaternion `[x, y, z, w]` of length 1.
    pub rotation: [f32; 4],
}

/// The most bones of a mesh.
const MAX_BONES: usize = 4096;

impl CharacterMesh {
    /// Reads the mesh of a character.
    pub(crate) fn read(
        document: &GltfDocument,
        skeleton: &CharacterSkeleton,
    ) -> Result<CharacterMesh, CharacterError> {
        let failed = |reason: String| CharacterError::Format {
            path: document.path().to_owned(),
            reason,
        };
        let Surfaces {
            surfaces,
            materials,
            images,
        } = document.surfaces().map_err(failed)?;
        let matrices = document.inverse_bind_matrices().map_err(failed)?;
        let mut bones = BoneList {
            document,
            skeleton,
            matrices,
            places: { skeleton.nodes.iter().enumerate() }
                .map(|(place, node)| (node.index, place))
                .collect(),
            bones: Vec::new(),
            skins: HashMap::new(),
        };
        let (mut vertices, mut indices, mut groups) = (Vec::new(), Vec::new(), Vec::new());
        for surface in &surfaces {
            let (first, count) = bones.add(surface).map_err(failed)?;
            let (start, offset) = (indices.len(), vertices.len() as u32);
            for (at, position) in surface.positions.iter().enumerate() {
                let joints = surface.joints[at];
                if let Some(joint) = joints.iter().find(|joint| usize::from(**joint) >= count) {
                    return Err(failed(format!(
                        "nodes[{}]: expected joints below {count}, found {joint}",
                        surface.node
                    )));
                }
                vertices.push(MeshVertex {
                    position: *position,
                    normal: surface.normals[at],
                    texture_coordinates: surface.texture_coordinates[at],
                    colour: surface.colours[at],
                    bones: joints.map(|joint| first as u16 + joint),
                    weights: surface.weights[at],
                });
            }
            indices.extend(surface.indices.iter().map(|index| index + offset));
            groups.push(MeshGroup {
                start,
                count: surface.indices.len(),
                material: surface.material,
            });
        }
        if indices.is_empty() {
            return Err(failed("expected a mesh of triangles, found none".into()));
        }
        let mut mesh = CharacterMesh {
            vertices,
            indices,
            groups,
            materials,
            images,
            bones: bones.bones,
            floor: 0.0,
        };
        mesh.floor = mesh.lowest(skeleton);
        Ok(mesh)
    }

    /// Returns the height of the lowest vertex in the rest pose.
    fn lowest(&self, skeleton: &CharacterSkeleton) -> f64 {
        let bones = self.bones.iter().map(|bone| {
            let node = &skeleton.nodes[bone.place];
            let world = DMat4::from_rotation_translation(node.world_rotation, node.world_position);
            world * DMat4::from_cols_array(&bone.bind.map(f64::from))
        });
        let bones: Vec<DMat4> = bones.collect();
        let height = |vertex: &MeshVertex| {
            let position = DVec3::from(vertex.position.map(f64::from));
            let by_bone = vertex.bones.iter().zip(vertex.weights);
            let height = by_bone.map(|(bone, weight)| {
                let height = bones[usize::from(*bone)].transform_point3(position).y;
                f64::from(weight) * height
            });
            height.sum::<f64>()
        };
        let lowest = self
            .vertices
            .iter()
            .map(height)
            .fold(f64::INFINITY, f64::min);
        if lowest.is_finite() { lowest } else { 0.0 }
    }
}

/// The bones of a mesh while it is read.
struct BoneList<'a> {
    document: &'a GltfDocument,
    skeleton: &'a CharacterSkeleton,
    /// The inverse bind matrices of every skin.
    matrices: Vec<Option<Vec<[f64; 16]>>>,
    /// The place of each node of the file in the skeleton.
    places: HashMap<usize, usize>,
    bones: Vec<MeshBone>,
    /// The first bone of each skin and the number of its joints.
    skins: HashMap<usize, (usize, usize)>,
}

impl BoneList<'_> {
    /// Adds the bones of a surface. Returns the place of the first one, and their number.
    fn add(&mut self, surface: &Surface) -> Result<(usize, usize), String> {
        let first = self.bones.len();
        let Some(skin) = surface.skin else {
            // What hangs at a node moves with it.
            let place = self.place(surface.node)?;
            let scale = self.skeleton.nodes[place].scale;
            self.push(place, DMat4::from_scale(scale / scale.x))?;
            return Ok((first, 1));
        };
        if let Some(known) = self.skins.get(&skin) {
            return Ok(*known);
        }
        let joints = self.document.value("skins")[skin]["joints"].as_array();
        let joints = joints.map_or(&[][..], Vec::as_slice);
        for (at, joint) in joints.iter().enumerate() {
            let node = joint.as_u64().map(|node| node as usize);
            let place = self.place(node.unwrap_or(usize::MAX))?;
            let matrices = self.matrices.get(skin).and_then(Option::as_ref);
            let bind = match matrices {
                None => DMat4::IDENTITY,
                Some(matrices) => {
                    let matrix = matrices.get(at).ok_or_else(|| {
                        format!(
                            "skins[{skin}]: expected {} inverse bind matrices, found {}",
                            joints.len(),
                            matrices.len()
                        )
                    })?;
                    DMat4::from_cols_array(matrix)
                }
            };
            self.push(place, bind)?;
        }
        let added = (first, joints.len());
        self.skins.insert(skin, added);
        Ok(added)
    }

    fn place(&self, node: usize) -> Result<usize, String> {
        let place = self.places.get(&node).copied();
        place.ok_or_else(|| format!("expected a node of the file, found nodes[{node}]"))
    }

    fn push(&mut self, place: usize, bind: DMat4) -> Result<(), String> {
        if self.bones.len() == MAX_BONES {
            return Err(format!(
                "expected a mesh of at most {MAX_BONES} bones, found more"
            ));
        }
        let node = &self.skeleton.nodes[place];
        let bind = DMat4::from_scale(DVec3::splat(node.world_scale)) * bind;
        self.bones.push(MeshBone {
            name: node.name.clone(),
            bind: bind.to_cols_array().map(|x| x as f32),
            place,
        });
        Ok(())
    }
}

impl Character {
    /// Reads the mesh of the character.
    ///
    /// # Errors
    ///
    /// If the file is a BVH, which has none, its triangles are damaged or compressed with Draco, or there are more than 400,000
    /// vertices or 4096 bones.
    pub fn mesh(&self) -> Result<CharacterMesh, CharacterError> {
        let document = self.gltf().ok_or_else(|| CharacterError::Format {
            path: self.path().to_owned(),
            reason: "expected a mesh, found a skeleton alone".into(),
        })?;
        CharacterMesh::read(document, self.skeleton())
    }

    /// Returns where the bones of the character's [mesh](Self::mesh) are in a motion.
    ///
    /// # Errors
    ///
    /// The same as for [`animate`](Self::animate).
    pub fn mesh_poses(
        &self,
        mesh: &CharacterMesh,
        motion: &Motion,
        options: &RetargetOptions,
    ) -> Result<MeshPoses, CharacterError> {
        let animation: CharacterAnimation = self.animate(motion, options)?;
        let ratio = self.leg_length() / f64::from(motion.rotations().rest().leg());
        let turn: DQuat = self.skeleton().facing.inverse();
        let frames = self.world_poses(&animation).map(|world| {
            let pose = |bone: &MeshBone| {
                let (position, rotation) = world[bone.place];
                let position = turn * (position - DVec3::Y * mesh.floor) / ratio;
                BonePose {
                    position: position.as_vec3().to_array(),
                    rotation: (turn * rotation).as_quat().normalize().to_array(),
                }
            };
            mesh.bones.iter().map(pose).collect()
        });
        Ok(MeshPoses {
            frames_per_second: animation.frames_per_second,
            scale: (1.0 / ratio) as f32,
            frames: frames.collect(),
        })
    }
}
