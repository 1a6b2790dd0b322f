//! A character: a rigged file that motions are put on.

use std::path::Path;

use glam::{DQuat, DVec3};
use lamogen_files::JointMapping;
use lamogen_motion::{Joint, Motion};

use crate::document::{AnimationData, Channel, GltfDocument};
use crate::error::CharacterError;
use crate::hands::relaxed_fingers;
use crate::retarget::{CharacterPose, RetargetOptions, Retargeter};
use crate::skeleton::CharacterSkeleton;

/// A rigged character from a `.glb`, `.gltf` or `.vrm` file (0.x and 1.0).
///
/// ```no_run
/// use lamogen_character::{Character, CharacterOptions, RetargetOptions, SaveOptions};
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// # let motion: lamogen_motion::Motion = todo!();
/// let hero = Character::open("hero.glb", &CharacterOptions::default())?;
/// let jump = hero.animate(&motion, &RetargetOptions::default());
/// hero.save("hero_jump.glb", &[jump.named("jump")], &SaveOptions::default())?;
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Debug)]
pub struct Character {
    document: GltfDocument,
    skeleton: CharacterSkeleton,
}

/// Options of reading a character.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CharacterOptions {
    /// The node of each joint, if the skeleton's names are not known ones.
    pub mapping: Option<JointMapping>,
    /// The name of the node at or above the skeleton, if the file has several characters.
    pub root: Option<String>,
}

/// Options of writing a character.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SaveOptions {
    /// Whether the animations of the file are dropped.
    pub replace_animations: bool,
}

/// A motion on a character: the rotations of its bones, relative to their parents.
#[derive(Clone, Debug, PartialEq)]
pub struct CharacterAnimation {
    /// The name of the animation.
    pub name: String,
    /// Keyframes per second.
    pub frames_per_second: f32,
    /// The bones that move.
    pub bones: Vec<BoneTrack>,
    /// The name of the node of the pelvis.
    pub pelvis: String,
    /// The position of the pelvis relative to its parent at every frame, in the units of the parent.
    pub pelvis_positions: Vec<[f32; 3]>,
    /// The copyright notice of the motion.
    pub copyright: Option<String>,
    /// The index of the pelvis' node in the file.
    pelvis_node: usize,
}

/// The rotations of one bone.
#[derive(Clone, Debug, PartialEq)]
pub struct BoneTrack {
    /// The name of the bone's node in the file.
    pub name: String,
    /// The index of the bone's node in the file.
    pub node: usize,
    /// The rotation relative to the parent at every frame: quaternions `[x, y, z, w]` of length 1. Of the two quaternions of
    /// a rotation, the one nearer to that of the frame before.
    pub rotations: Vec<[f32; 4]>,
}

impl CharacterAnimation {
    /// Returns the animation with another name.
    pub fn named(self, name: impl Into<String>) -> Self {
        CharacterAnimation {
            name: name.into(),
            ..self
        }
    }

    /// Returns the number of keyframes.
    pub fn frames(&self) -> usize {
        self.pelvis_positions.len()
    }
}

impl Character {
    /// Reads a character.
    ///
    /// # Errors
    ///
    /// If the file cannot be read, is not glTF 2.0, has no skin or no known skeleton, or a joint is mirrored or scaled
    /// differently along its axes.
    pub fn open(
        path: impl AsRef<Path>,
        options: &CharacterOptions,
    ) -> Result<Character, CharacterError> {
        let path = path.as_ref();
        let bytes = std::fs::read(path).map_err(|reason| CharacterError::Io {
            path: path.to_owned(),
            reason,
        })?;
        if let Some(problem) = lamogen_io::placeholder(&bytes) {
            return Err(CharacterError::Format {
                path: path.to_owned(),
                reason: problem.to_owned(),
            });
        }
        let document = GltfDocument::parse(bytes, path)?;
        let (mapping, root) = (options.mapping.as_ref(), options.root.as_deref());
        let skeleton = CharacterSkeleton::read(&document, mapping, root)?;
        Ok(Character { document, skeleton })
    }

    /// Returns the naming scheme of the skeleton: `VRM`, another known scheme, or `mapping file`.
    pub fn scheme(&self) -> &str {
        self.skeleton.scheme
    }

    /// Returns the name of the node of each joint that was found.
    pub fn joint_names(&self) -> impl Iterator<Item = (Joint, &str)> {
        Joint::ALL.into_iter().filter_map(|joint| {
            let place = self.skeleton.joint(joint)?;
            Some((joint, &*self.skeleton.nodes[place].name))
        })
    }

    /// Returns the names of the nodes of the spine, from the lowest to the highest.
    pub fn spine_names(&self) -> impl Iterator<Item = &str> {
        let spine = self.skeleton.spine.iter();
        spine.map(|(place, _)| &*self.skeleton.nodes[*place].name)
    }

    /// Returns the length of the character's legs from hip to ankle, in metres.
    pub fn leg_length(&self) -> f64 {
        self.skeleton.leg_length()
    }

    /// Returns the names of the animations in the file.
    pub fn animation_names(&self) -> Vec<String> {
        self.document.animation_names()
    }

    /// Puts a motion on the character.
    ///
    /// Limbs point where those of the motion point. Spine, neck, head, hands and feet turn as those of the motion do relative to
    /// their rest pose. The pelvis moves by the ratio of leg lengths, along the direction in which the character faces.
    pub fn animate(&self, motion: &Motion, options: &RetargetOptions) -> CharacterAnimation {
        let retargeter = Retargeter::new(&self.skeleton, motion, options);
        let poses = retargeter.poses(motion, options);
        let nodes = &self.skeleton.nodes;
        let mut places: Vec<usize> = retargeter.driven_places().collect();
        places.sort_unstable();
        let track = |place: usize, rotations: Vec<[f32; 4]>| BoneTrack {
            name: nodes[place].name.clone(),
            node: nodes[place].index,
            rotations,
        };
        let mut bones: Vec<BoneTrack> = { places.into_iter() }
            .map(|place| track(place, self.local_rotations(place, &poses)))
            .collect();
        if options.relax_hands {
            for (place, rotation) in relaxed_fingers(&self.skeleton) {
                let rotation = rotation.as_quat().normalize().to_array();
                bones.push(track(place, vec![rotation; poses.len()]));
            }
        }
        let pelvis = self.skeleton.joint(Joint::Pelvis).expect("a pelvis");
        let pelvis_positions = poses.iter().map(|pose| {
            let place = pose.positions[pelvis];
            let local = match nodes[pelvis].parent {
                None => place,
                Some(parent) => {
                    let relative = place - pose.positions[parent];
                    pose.rotations[parent].inverse() * relative / nodes[parent].world_scale
                }
            };
            local.as_vec3().to_array()
        });
        CharacterAnimation {
            name: "motion".to_owned(),
            frames_per_second: options.frames_per_second,
            bones,
            pelvis: nodes[pelvis].name.clone(),
            pelvis_node: nodes[pelvis].index,
            pelvis_positions: pelvis_positions.collect(),
            copyright: motion.copyright().map(str::to_owned),
        }
    }

    /// Returns the rotations of a node relative to its parent.
    fn local_rotations(&self, place: usize, poses: &[CharacterPose]) -> Vec<[f32; 4]> {
        let parent = self.skeleton.nodes[place].parent;
        let mut last = DQuat::IDENTITY;
        let local = poses.iter().map(|pose| {
            let above = parent.map_or(DQuat::IDENTITY, |parent| pose.rotations[parent]);
            let turn = (above.inverse() * pose.rotations[place]).normalize();
            last = if turn.dot(last) < 0.0 { -turn } else { turn };
            last.as_quat().normalize().to_array()
        });
        local.collect()
    }

    /// Writes the file of the character with further animations. All else in it stays as it is. The file is written whole or
    /// not at all.
    ///
    /// # Errors
    ///
    /// If the name ends as another kind of file does than the character's own (`.gltf`, or `.glb` and `.vrm`), a `.gltf` with
    /// files beside it is written to another folder, or the file cannot be written.
    pub fn save(
        &self,
        path: impl AsRef<Path>,
        animations: &[CharacterAnimation],
        options: &SaveOptions,
    ) -> Result<(), CharacterError> {
        let animations: Vec<AnimationData> = animations.iter().map(animation_data).collect();
        self.document
            .write(path.as_ref(), &animations, options.replace_animations)
    }

    /// Returns the positions of the joints in the world at every frame of an animation of this character, in metres.
    pub fn joint_positions(&self, animation: &CharacterAnimation) -> Vec<Vec<(Joint, [f64; 3])>> {
        let nodes = &self.skeleton.nodes;
        (0..animation.frames())
            .map(|frame| {
                let mut world: Vec<(DVec3, DQuat)> = Vec::with_capacity(nodes.len());
                for node in nodes {
                    let track = animation.bones.iter().find(|bone| bone.node == node.index);
                    let rotation = track.map_or(node.rotation, |track| {
                        DQuat::from_array(track.rotations[frame].map(f64::from))
                    });
                    let translation = match node.index == animation.pelvis_node {
                        true => DVec3::from(animation.pelvis_positions[frame].map(f64::from)),
                        false => node.translation,
                    };
                    world.push(match node.parent {
                        None => (translation, rotation),
                        Some(parent) => {
                            let (at, turn) = world[parent];
                            let scale = nodes[parent].world_scale;
                            (at + turn * (scale * translation), turn * rotation)
                        }
                    });
                }
                let joints = Joint::ALL.into_iter().filter_map(|joint| {
                    let place = self.skeleton.joint(joint)?;
                    Some((joint, world[place].0.to_array()))
                });
                joints.collect()
            })
            .collect()
    }
}

/// Converts an animation to what is written.
fn animation_data(animation: &CharacterAnimation) -> AnimationData {
    let rate = animation.frames_per_second;
    let rotations =
        { animation.bones.iter() }.map(|bone| Channel::Rotation(bone.node, bone.rotations.clone()));
    let translation =
        Channel::Translation(animation.pelvis_node, animation.pelvis_positions.clone());
    AnimationData {
        name: animation.name.clone(),
        copyright: animation.copyright.clone(),
        times: (0..animation.frames())
            .map(|frame| frame as f32 / rate)
            .collect(),
        channels: std::iter::once(translation).chain(rotations).collect(),
    }
}
