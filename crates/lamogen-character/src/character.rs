//! A character: a rigged file that motions are put on.

use std::collections::HashMap;
use std::path::Path;

use glam::{DQuat, DVec3};
use lamogen_files::JointMapping;
use lamogen_motion::{Joint, Motion, RootMotion};

use crate::bind_pose::RestPoseNotice;
use crate::bvh::BvhDocument;
use crate::document::{AnimationData, Channel, GltfDocument};
use crate::error::CharacterError;
use crate::hands::relaxed_fingers;
use crate::retarget::{CharacterPose, RetargetOptions, retarget};
use crate::skeleton::CharacterSkeleton;

/// A rigged character from a `.glb`, `.gltf` or `.vrm` file (0.x and 1.0), or the skeleton of a `.bvh` file.
///
/// ```no_run
/// use lamogen_character::{Character, CharacterOptions, RetargetOptions, SaveOptions};
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// # let motion: lamogen_motion::Motion = todo!();
/// let hero = Character::open("hero.glb", &CharacterOptions::default())?;
/// let jump = hero.animate(&motion, &RetargetOptions::default())?;
/// hero.save("hero_jump.glb", &[jump.named("jump")], &SaveOptions::default())?;
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Debug)]
pub struct Character {
    document: CharacterDocument,
    skeleton: CharacterSkeleton,
    rest_pose_notice: Option<RestPoseNotice>,
}

/// The file of a character.
#[derive(Clone, Debug)]
enum CharacterDocument {
    Gltf(GltfDocument),
    Bvh(BvhDocument),
}

impl CharacterDocument {
    fn path(&self) -> &Path {
        match self {
            CharacterDocument::Gltf(document) => document.path(),
            CharacterDocument::Bvh(document) => document.path(),
        }
    }
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
    /// Where the travel along the ground is. If it is nowhere, the character stays in place, and planted feet slide.
    pub root_motion: RootMotion,
    /// The node above the pelvis that has the travel, if that is where it is.
    pub root: Option<PositionTrack>,
    /// Whether the animation is a loop. Its last frame is then the first one again, moved on by the travel.
    pub is_loop: bool,
    /// The bones that move.
    pub bones: Vec<BoneTrack>,
    /// The pelvis, or the node above it that carries the whole body.
    pub pelvis: PositionTrack,
    /// The nodes that the file stores at other places than those of the rest pose, at which the animation holds them. There are
    /// some only if the rest pose is that in which the mesh was bound.
    pub held: Vec<PositionTrack>,
    /// The copyright notice of the motion.
    pub copyright: Option<String>,
}

/// The positions of one node.
#[derive(Clone, Debug, PartialEq)]
pub struct PositionTrack {
    /// The name of the node in the file.
    pub name: String,
    /// The index of the node in the file.
    pub node: usize,
    /// The position relative to the parent at every frame, in the units of the parent.
    pub positions: Vec<[f32; 3]>,
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
        self.pelvis.positions.len()
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
        let (mapping, root) = (options.mapping.as_ref(), options.root.as_deref());
        if has_extension(path, "bvh") {
            if let Some(root) = root {
                return Err(CharacterError::Node {
                    path: path.to_owned(),
                    asked: root.to_owned(),
                });
            }
            let document = BvhDocument::parse(&bytes, mapping, path)?;
            let skeleton = CharacterSkeleton::read_bvh(&document, mapping)?;
            return Ok(Character {
                document: CharacterDocument::Bvh(document),
                skeleton,
                rest_pose_notice: None,
            });
        }
        Character::of_document(GltfDocument::parse(bytes, path, path.parent())?, options)
    }

    /// Reads a character from the bytes of a `.glb`, `.vrm` or `.gltf` file that somebody else may have made. `name` is used only in error
    /// messages. No other file is read: buffers must be in the file.
    ///
    /// # Errors
    ///
    /// The same as for [`open`](Self::open), and if the file has more than 8 MB of JSON or 10,000 nodes, or its skins more than 50,000 joints.
    pub fn from_bytes(
        bytes: Vec<u8>,
        name: impl AsRef<Path>,
        options: &CharacterOptions,
    ) -> Result<Character, CharacterError> {
        GltfDocument::check_json_size(&bytes, name.as_ref())?;
        let document = GltfDocument::parse(bytes, name.as_ref(), None)?;
        document.check_size()?;
        Character::of_document(document, options)
    }

    fn of_document(
        document: GltfDocument,
        options: &CharacterOptions,
    ) -> Result<Character, CharacterError> {
        let (mapping, root) = (options.mapping.as_ref(), options.root.as_deref());
        let (skeleton, rest_pose_notice) = CharacterSkeleton::read(&document, mapping, root)?;
        Ok(Character {
            document: CharacterDocument::Gltf(document),
            skeleton,
            rest_pose_notice,
        })
    }

    /// Returns what is to be said about the rest pose; `None` if it is simply that of the nodes.
    pub fn rest_pose_notice(&self) -> Option<&RestPoseNotice> {
        self.rest_pose_notice.as_ref()
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

    /// Returns the number of nodes of the file.
    pub fn node_count(&self) -> usize {
        self.skeleton.nodes.len()
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
        match &self.document {
            CharacterDocument::Gltf(document) => document.animation_names(),
            CharacterDocument::Bvh(_) => Vec::new(),
        }
    }

    /// Returns whether the character is the skeleton of a BVH file.
    pub fn is_bvh(&self) -> bool {
        matches!(self.document, CharacterDocument::Bvh(_))
    }

    /// Puts a motion on the character.
    ///
    /// Limbs point where those of the motion point. Spine, neck, head, hands and feet turn as those of the motion do relative to
    /// their rest pose. The pelvis moves by the ratio of leg lengths, along the direction in which the character faces.
    ///
    /// The travel of the motion goes where [`Motion::root_motion`] says; a root node is the parent of the pelvis. The animation of a
    /// loop ends with the frame that closes it, and its frame rate is changed so little that a cycle is a whole number of frames.
    ///
    /// # Errors
    ///
    /// If the travel shall go into a root node, and the pelvis has no parent.
    pub fn animate(
        &self,
        motion: &Motion,
        options: &RetargetOptions,
    ) -> Result<CharacterAnimation, CharacterError> {
        let retargeted = retarget(&self.skeleton, motion, options);
        let (retargeter, poses) = (&retargeted.retargeter, &retargeted.poses);
        let nodes = &self.skeleton.nodes;
        let mut places: Vec<usize> = retargeter.driven_places().collect();
        places.sort_unstable();
        let track = |place: usize, rotations: Vec<[f32; 4]>| BoneTrack {
            name: nodes[place].name.clone(),
            node: nodes[place].index,
            rotations,
        };
        let mut bones: Vec<BoneTrack> = { places.into_iter() }
            .map(|place| track(place, self.local_rotations(place, poses)))
            .collect();
        if options.relax_hands {
            for (place, rotation) in relaxed_fingers(&self.skeleton) {
                let rotation = rotation.as_quat().normalize().to_array();
                bones.push(track(place, vec![rotation; poses.len()]));
            }
        }
        let pelvis = self.skeleton.carrier;
        for (place, node) in nodes.iter().enumerate().filter(|(_, node)| node.is_turned) {
            if bones.iter().all(|bone| bone.node != node.index) {
                let rotation = node.rotation.as_quat().normalize().to_array();
                bones.push(track(place, vec![rotation; poses.len()]));
            }
        }
        let root_motion = motion.root_motion();
        let root = self.root_node(root_motion)?;
        let path = match root_motion {
            RootMotion::Hips => vec![DVec3::ZERO; poses.len()],
            _ => retargeted.ground_path(self.skeleton.joint(Joint::Pelvis).expect("a pelvis")),
        };
        let start = match root_motion {
            RootMotion::None => path[0],
            _ => DVec3::ZERO,
        };
        let pelvis_positions = poses.iter().zip(&path).map(|(pose, path)| {
            let place = pose.positions[pelvis] - *path + start;
            let local = match nodes[pelvis].parent {
                None => place,
                Some(parent) => {
                    let relative = place - pose.positions[parent];
                    pose.rotations[parent].inverse() * relative / nodes[parent].world_scale
                }
            };
            local.as_vec3().to_array()
        });
        let position_track = |place: usize, positions: Vec<[f32; 3]>| PositionTrack {
            name: nodes[place].name.clone(),
            node: nodes[place].index,
            positions,
        };
        let root = root.map(|place| {
            let node = &nodes[place];
            let positions = path.iter().map(|path| {
                let moved = match node.parent {
                    None => *path,
                    Some(parent) => {
                        let parent = &nodes[parent];
                        parent.world_rotation.inverse() * *path / parent.world_scale
                    }
                };
                (node.translation + moved).as_vec3().to_array()
            });
            position_track(place, positions.collect())
        });
        let moved = { 0..nodes.len() }.filter(|place| *place != pelvis && nodes[*place].is_moved);
        let held = moved.map(|place| {
            let position = nodes[place].translation.as_vec3().to_array();
            position_track(place, vec![position; poses.len()])
        });
        let held = held.collect();
        Ok(CharacterAnimation {
            name: "motion".to_owned(),
            frames_per_second: retargeted.frames_per_second,
            root_motion,
            root,
            is_loop: motion.loop_travel().is_some(),
            bones,
            pelvis: position_track(pelvis, pelvis_positions.collect()),
            held,
            copyright: motion.copyright().map(str::to_owned),
        })
    }

    /// Checks that the travel of a motion can go where it shall go, as [`animate`](Self::animate) does.
    ///
    /// # Errors
    ///
    /// If it shall go into a root node, and the pelvis has no parent that can move.
    pub fn check_root_motion(&self, root_motion: RootMotion) -> Result<(), CharacterError> {
        self.root_node(root_motion).map(drop)
    }

    /// Returns the place of the node that takes the travel; `None` if no node above the pelvis shall have it.
    fn root_node(&self, root_motion: RootMotion) -> Result<Option<usize>, CharacterError> {
        if root_motion != RootMotion::Root {
            return Ok(None);
        }
        let nodes = &self.skeleton.nodes;
        let pelvis = self.skeleton.carrier;
        match nodes[pelvis].parent {
            Some(parent) if nodes[parent].can_move => Ok(Some(parent)),
            _ => Err(CharacterError::Root {
                path: self.document.path().to_owned(),
                pelvis: nodes[pelvis].name.clone(),
            }),
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
    /// A BVH has a single motion, so that of the character's file is replaced, and there must be one animation.
    ///
    /// # Errors
    ///
    /// If the name ends as another kind of file does than the character's own (`.gltf`, `.glb` and `.vrm`, or `.bvh`), a `.gltf`
    /// with files beside it is written to another folder, a BVH shall have another number of animations than one, or the file
    /// cannot be written.
    pub fn save(
        &self,
        path: impl AsRef<Path>,
        animations: &[CharacterAnimation],
        options: &SaveOptions,
    ) -> Result<(), CharacterError> {
        let path = path.as_ref();
        match (&self.document, animations) {
            (CharacterDocument::Gltf(document), _) => {
                let animations: Vec<AnimationData> =
                    animations.iter().map(animation_data).collect();
                document.write(path, &animations, options.replace_animations)
            }
            (CharacterDocument::Bvh(document), [animation]) => {
                document.write(path, &self.skeleton.nodes, animation)
            }
            (CharacterDocument::Bvh(_), _) => Err(CharacterError::Animations {
                path: path.to_owned(),
                found: animations.len(),
            }),
        }
    }

    /// Returns the file of a glTF character with further animations, as [`save`](Self::save) writes it.
    ///
    /// # Errors
    ///
    /// If the character is a BVH, its file refers to others, or the file would be larger than 4 GiB.
    pub fn bytes(
        &self,
        animations: &[CharacterAnimation],
        options: &SaveOptions,
    ) -> Result<Vec<u8>, CharacterError> {
        let document = self.gltf().ok_or_else(|| CharacterError::Format {
            path: self.path().to_owned(),
            reason: "expected a glTF file, found a BVH".into(),
        })?;
        let animations: Vec<AnimationData> = animations.iter().map(animation_data).collect();
        document.bytes(&animations, options.replace_animations)
    }

    /// Returns the positions of the joints in the world at every frame of an animation of this character, in metres.
    pub fn joint_positions(&self, animation: &CharacterAnimation) -> Vec<Vec<(Joint, [f64; 3])>> {
        let frames = self.world_poses(animation).map(|world| {
            let joints = Joint::ALL.into_iter().filter_map(|joint| {
                let place = self.skeleton.joint(joint)?;
                Some((joint, world[place].0.to_array()))
            });
            joints.collect()
        });
        frames.collect()
    }

    /// Returns the position and rotation of every node in the world, in the order of the skeleton, at every frame of an animation of this
    /// character.
    pub(crate) fn world_poses<'a>(
        &'a self,
        animation: &'a CharacterAnimation,
    ) -> impl Iterator<Item = Vec<(DVec3, DQuat)>> + 'a {
        let nodes = &self.skeleton.nodes;
        let bones: HashMap<usize, &BoneTrack> = { animation.bones.iter() }
            .map(|track| (track.node, track))
            .collect();
        let moved: HashMap<usize, &PositionTrack> = { animation.root.iter() }
            .chain([&animation.pelvis])
            .map(|track| (track.node, track))
            .collect();
        (0..animation.frames()).map(move |frame| {
            let mut world: Vec<(DVec3, DQuat)> = Vec::with_capacity(nodes.len());
            for node in nodes {
                let rotation = bones.get(&node.index).map_or(node.rotation, |track| {
                    DQuat::from_array(track.rotations[frame].map(f64::from))
                });
                let translation = moved.get(&node.index).map_or(node.translation, |track| {
                    DVec3::from(track.positions[frame].map(f64::from))
                });
                world.push(match node.parent {
                    None => (translation, rotation),
                    Some(parent) => {
                        let (at, turn) = world[parent];
                        let scale = nodes[parent].world_scale;
                        (at + turn * (scale * translation), turn * rotation)
                    }
                });
            }
            world
        })
    }

    /// Returns the file of a glTF character; `None` for a BVH.
    pub(crate) fn gltf(&self) -> Option<&GltfDocument> {
        match &self.document {
            CharacterDocument::Gltf(document) => Some(document),
            CharacterDocument::Bvh(_) => None,
        }
    }

    /// Returns the path of the file, or its name.
    pub(crate) fn path(&self) -> &Path {
        self.document.path()
    }

    pub(crate) fn skeleton(&self) -> &CharacterSkeleton {
        &self.skeleton
    }
}

/// Returns whether the name of a file ends in an extension, in upper or lower case.
pub(crate) fn has_extension(path: &Path, extension: &str) -> bool {
    path.extension()
        .is_some_and(|found| found.eq_ignore_ascii_case(extension))
}

/// Converts an animation to what is written.
fn animation_data(animation: &CharacterAnimation) -> AnimationData {
    let rate = animation.frames_per_second;
    let rotations =
        { animation.bones.iter() }.map(|bone| Channel::Rotation(bone.node, bone.rotations.clone()));
    let moved = { animation.root.iter() }
        .chain([&animation.pelvis])
        .chain(&animation.held);
    let translations = moved.map(|track| Channel::Translation(track.node, track.positions.clone()));
    AnimationData {
        name: animation.name.clone(),
        copyright: animation.copyright.clone(),
        notes: animation.root_motion.note().map(str::to_owned),
        times: (0..animation.frames())
            .map(|frame| frame as f32 / rate)
            .collect(),
        channels: translations.chain(rotations).collect(),
    }
}
