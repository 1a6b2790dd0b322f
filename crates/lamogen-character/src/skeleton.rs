//! The skeleton of a character: its nodes in the rest pose, and which of them are joints.

use std::path::Path;

use glam::{DMat4, DQuat, DVec3};
use lamogen_files::{JointMapping, SkeletonJoints, SkeletonNode, find_joints};
use lamogen_motion::{JOINTS, Joint, LEGS};
use serde_json::Value;

use crate::bind_pose::{RestSkeleton, rest_skeleton};
use crate::bvh::BvhDocument;
use crate::document::GltfDocument;
use crate::error::CharacterError;
use crate::vrm;

/// A node of the file in the rest pose.
#[derive(Clone, Debug)]
pub(crate) struct RestNode {
    /// The index in the file.
    pub(crate) index: usize,
    pub(crate) name: String,
    /// The place of the parent in the skeleton's list, which is before this node's own.
    pub(crate) parent: Option<usize>,
    /// The transform relative to the parent.
    pub(crate) translation: DVec3,
    pub(crate) rotation: DQuat,
    pub(crate) scale: DVec3,
    /// The transform in the world.
    pub(crate) world_position: DVec3,
    pub(crate) world_rotation: DQuat,
    pub(crate) world_scale: f64,
    /// Whether an animation can change its position.
    pub(crate) can_move: bool,
    /// Whether the file stores another rotation relative to the parent than that of the rest pose.
    pub(crate) is_turned: bool,
    /// Whether the file stores another translation relative to the parent than that of the rest pose.
    pub(crate) is_moved: bool,
}

/// The nodes of a character and its joints.
#[derive(Clone, Debug)]
pub(crate) struct CharacterSkeleton {
    /// All nodes of the file, parents before their children.
    pub(crate) nodes: Vec<RestNode>,
    /// The place of each joint in `nodes`; the spine's are in `spine`.
    pub(crate) joints: [Option<usize>; JOINTS],
    /// The place of the node that carries the whole body: the pelvis, or the node above it where legs or spine are not below the pelvis.
    pub(crate) carrier: usize,
    /// The nodes between the pelvis and the neck, and their height in our spine: 1 is that of the first joint of the spine,
    /// 3 that of the third.
    pub(crate) spine: Vec<(usize, f64)>,
    /// The nodes between the uppermost node of the spine and the head, and their height: 3 is that of the third joint of
    /// the spine, 4 that of the neck.
    pub(crate) neck: Vec<(usize, f64)>,
    /// The rotation from our body, which faces +Z, to the character's.
    pub(crate) facing: DQuat,
    /// The naming scheme of the joints.
    pub(crate) scheme: &'static str,
}

/// Scales that differ by less than this part are the same.
const SCALE_TOLERANCE: f64 = 1e-3;

impl CharacterSkeleton {
    /// Reads the skeleton of a file. `root` is the name of the node at or above the character, if there are several.
    ///
    /// The rest pose is that of the nodes, or that in which the mesh was bound if the nodes are stored in another one. That of a VRM
    /// is that of the nodes, as its specification has it.
    pub(crate) fn read(
        document: &GltfDocument,
        mapping: Option<&JointMapping>,
        root: Option<&str>,
    ) -> Result<RestSkeleton, CharacterError> {
        let path = document.path();
        let nodes = read_nodes(document)?;
        let skins = used_skins(document);
        let skinned = skinned_nodes(document, &skins);
        if skinned.is_empty() {
            return Err(CharacterError::Skin {
                path: path.to_owned(),
            });
        }
        let top = match root {
            None => None,
            Some(name) => Some(nodes.iter().position(|node| node.name == name).ok_or_else(
                || CharacterError::Node {
                    path: path.to_owned(),
                    asked: name.to_owned(),
                },
            )?),
        };
        let is_inside = |place: usize| {
            top.is_none_or(|top| ancestors(&nodes, place).any(|ancestor| ancestor == top))
        };
        let from_vrm = match (mapping, root) {
            (None, None) => vrm::joint_nodes(document),
            _ => None,
        };
        let found = match from_vrm {
            Some(by_index) => SkeletonJoints {
                scheme: "VRM",
                nodes: by_index.map(|index| {
                    let index = index?;
                    nodes.iter().position(|node| node.index == index)
                }),
            },
            None => {
                let list = nodes.iter().enumerate().map(|(place, node)| SkeletonNode {
                    // Nodes of other characters keep their places, but not their names.
                    name: if is_inside(place) {
                        node.name.clone()
                    } else {
                        String::new()
                    },
                    parent: node.parent,
                    is_skinned: skinned.contains(&node.index),
                });
                find_joints(&list.collect::<Vec<_>>(), mapping).map_err(|reason| {
                    CharacterError::Skeleton {
                        path: path.to_owned(),
                        reason,
                    }
                })?
            }
        };
        let make = |nodes| CharacterSkeleton::of_nodes(nodes, found.clone(), path);
        match found.scheme {
            "VRM" => Ok((make(nodes)?, None)),
            _ => rest_skeleton(document, &skins, nodes, &found, make),
        }
    }

    /// Reads the skeleton of a BVH file. The rest pose is the one without rotations if the body stands in it, or else that of the
    /// first frame.
    pub(crate) fn read_bvh(
        document: &BvhDocument,
        mapping: Option<&JointMapping>,
    ) -> Result<CharacterSkeleton, CharacterError> {
        let path = document.path();
        let body_error = |problem: String| CharacterError::Body {
            path: path.to_owned(),
            problem,
        };
        let mut standing = None;
        for in_first_frame in [false, true] {
            let nodes = document.rest_nodes(in_first_frame);
            let list = nodes.iter().map(|node| SkeletonNode {
                name: node.name.clone(),
                parent: node.parent,
                is_skinned: true,
            });
            let found = find_joints(&list.collect::<Vec<_>>(), mapping).map_err(|reason| {
                CharacterError::Skeleton {
                    path: path.to_owned(),
                    reason,
                }
            })?;
            let skeleton = CharacterSkeleton::of_nodes(nodes, found, path);
            match skeleton {
                Ok(skeleton) if skeleton.stands() => {
                    standing = Some(skeleton);
                    break;
                }
                // A pose without left and right side, such as one with all bones along one line, is none to start from.
                Ok(_) => {}
                Err(error) if in_first_frame => return Err(error),
                Err(_) => {}
            }
        }
        let mut skeleton = standing.ok_or_else(|| {
            body_error(
                "expected a body that stands upright in the pose without rotations or in the first frame, found neither"
                    .into(),
            )
        })?;
        skeleton.stand_on_ground();
        let joints = skeleton.joints.iter().flatten().copied();
        let line = skeleton.spine.iter().chain(&skeleton.neck);
        for place in joints.chain(line.map(|(place, _)| *place)) {
            let node = &skeleton.nodes[place];
            if !document.can_turn(node) {
                let name = &node.name;
                return Err(body_error(format!(
                    "expected rotation channels of the joint {name:?}, found none"
                )));
            }
        }
        match &skeleton.nodes[skeleton.carrier] {
            pelvis if pelvis.can_move => Ok(skeleton),
            pelvis => {
                let name = &pelvis.name;
                Err(body_error(format!(
                    "expected three position channels of the pelvis {name:?}, found fewer"
                )))
            }
        }
    }

    /// Makes a skeleton of nodes in the rest pose and of the joints among them.
    fn of_nodes(
        nodes: Vec<RestNode>,
        found: SkeletonJoints,
        path: &Path,
    ) -> Result<CharacterSkeleton, CharacterError> {
        let missing = found.missing_joints();
        if !missing.is_empty() {
            let names: Vec<&str> = missing.into_iter().map(Joint::name).collect();
            return Err(CharacterError::Body {
                path: path.to_owned(),
                problem: format!("expected a whole body, found none of {}", names.join(", ")),
            });
        }
        let is_below = |place, above| ancestors(&nodes, place).any(|node| node == above);
        if let Some((joint, parent)) = found.misplaced_joint(is_below) {
            let [node, above] = [joint, parent]
                .map(|joint| found.node(joint).map_or("", |place| &*nodes[place].name));
            return Err(CharacterError::Body {
                path: path.to_owned(),
                problem: format!(
                    "expected {} ({node:?}) below {} ({above:?}), whose movement it follows, found it elsewhere: bones that follow targets of \
                     inverse kinematics cannot be animated; export the bones that deform the mesh",
                    joint.name(),
                    parent.name()
                ),
            });
        }
        let mut skeleton = CharacterSkeleton {
            nodes,
            joints: found.nodes,
            carrier: 0,
            spine: Vec::new(),
            neck: Vec::new(),
            facing: DQuat::IDENTITY,
            scheme: found.scheme,
        };
        skeleton.find_carrier(path)?;
        skeleton.check_scales(path)?;
        skeleton.find_spine();
        skeleton.find_facing(path)?;
        Ok(skeleton)
    }

    /// Lifts the body of a BVH onto the ground, unless it stands there. Most files have the hips at the origin in the pose without
    /// rotations, because the position of every frame replaces that.
    fn stand_on_ground(&mut self) {
        /// The heights of the ball of a foot and of an ankle above the ground in units of the leg.
        const HEIGHTS: [f64; 2] = [0.02, 0.1];
        /// The part of the leg up to which a foot may be above or below its place.
        const TOLERANCE: f64 = 0.15;
        let leg = self.leg_length();
        let feet = [
            (Joint::LeftFoot, HEIGHTS[0]),
            (Joint::RightFoot, HEIGHTS[0]),
            (Joint::LeftAnkle, HEIGHTS[1]),
            (Joint::RightAnkle, HEIGHTS[1]),
        ];
        let lifts = feet.into_iter().filter_map(|(joint, height)| {
            let place = self.rest_position(joint)?;
            Some(height * leg - place.y)
        });
        let lift = lifts.fold(f64::NEG_INFINITY, f64::max);
        let Some(pelvis) = self.joint(Joint::Pelvis) else {
            return;
        };
        if lift.abs() <= TOLERANCE * leg {
            return;
        }
        let lift = DVec3::new(0.0, lift, 0.0);
        let is_below: Vec<bool> = (0..self.nodes.len())
            .map(|place| self.ancestors(place).any(|above| above == pelvis))
            .collect();
        for (node, is_below) in self.nodes.iter_mut().zip(is_below) {
            if is_below {
                node.world_position += lift;
            }
        }
        if let Some(parent) = self.nodes[pelvis].parent {
            let above = &self.nodes[parent];
            let local = above.world_rotation.inverse() * lift / above.world_scale;
            self.nodes[pelvis].translation += local;
        }
    }

    /// Returns whether the body stands upright in the rest pose: whether its head is above its pelvis, and this above its
    /// ankles.
    pub(crate) fn stands(&self) -> bool {
        let at = |joint| self.rest_position(joint);
        let head = at(Joint::Head).or(at(Joint::Neck));
        let ankles = [at(Joint::LeftAnkle), at(Joint::RightAnkle)];
        let (Some(head), Some(pelvis), [Some(left), Some(right)]) =
            (head, at(Joint::Pelvis), ankles)
        else {
            return false;
        };
        /// The least cosine between the vertical and the parts of a body that stands.
        const UPRIGHT: f64 = 0.8;
        let legs = (pelvis - left.midpoint(right)).normalize_or_zero();
        let trunk = (head - pelvis).normalize_or_zero();
        legs.y > UPRIGHT && trunk.y > UPRIGHT
    }

    /// Returns the place of a joint's node.
    pub(crate) fn joint(&self, joint: Joint) -> Option<usize> {
        self.joints[joint.index()]
    }

    /// Returns the position of a joint in the rest pose.
    pub(crate) fn rest_position(&self, joint: Joint) -> Option<DVec3> {
        Some(self.nodes[self.joint(joint)?].world_position)
    }

    /// Returns a node and the nodes above it.
    pub(crate) fn ancestors(&self, place: usize) -> impl Iterator<Item = usize> + '_ {
        ancestors(&self.nodes, place)
    }

    /// Checks that the joints and what is above them have a scale that rotations commute with.
    fn check_scales(&self, path: &Path) -> Result<(), CharacterError> {
        for place in self.joints.iter().flatten() {
            for place in self.ancestors(*place) {
                let RestNode { scale, name, .. } = &self.nodes[place];
                let is_uniform = (scale.max_element() - scale.min_element())
                    <= SCALE_TOLERANCE * scale.max_element();
                if !(scale.min_element() > 0.0 && is_uniform) {
                    return Err(CharacterError::Scale {
                        path: path.to_owned(),
                        node: name.clone(),
                        found: scale.to_array(),
                    });
                }
            }
        }
        Ok(())
    }

    /// Finds the node that carries the whole body.
    fn find_carrier(&mut self, path: &Path) -> Result<(), CharacterError> {
        self.carrier = carrier(&self.nodes, &self.joints).ok_or_else(|| CharacterError::Body {
            path: path.to_owned(),
            problem: "expected legs and trunk below one node, at or above the pelvis, found none"
                .into(),
        })?;
        Ok(())
    }

    /// Finds the nodes of the spine and of the neck.
    fn find_spine(&mut self) {
        let pelvis = self.joint(Joint::Pelvis);
        let top = self.joint(Joint::Head).or(self.joint(Joint::Neck));
        let above: Vec<usize> = { top.into_iter() }
            .flat_map(|top| self.ancestors(top).skip(1))
            .take_while(|place| Some(*place) != pelvis)
            .collect();
        let is_below =
            |place: usize, ancestor: usize| self.ancestors(place).any(|above| above == ancestor);
        let [left, right] =
            [Joint::LeftShoulder, Joint::RightShoulder].map(|joint| self.joint(joint));
        // What both arms hang from is the spine; what is above it is the neck.
        let carries_arms = |place: usize| {
            [left, right]
                .into_iter()
                .flatten()
                .any(|arm| is_below(arm, place))
        };
        let (spine, neck): (Vec<usize>, Vec<usize>) = above
            .into_iter()
            .rev()
            .partition(|place| carries_arms(*place));
        let count = spine.len() as f64;
        self.spine = { spine.into_iter().enumerate() }
            .map(|(place, node)| (node, 3.0 * (place + 1) as f64 / count))
            .collect();
        let count = neck.len() as f64;
        self.neck = { neck.into_iter().enumerate() }
            .map(|(place, node)| (node, 3.0 + (place + 1) as f64 / count))
            .collect();
    }

    /// Finds the direction in which the character faces: from its right to its left side is our +X.
    fn find_facing(&mut self, path: &Path) -> Result<(), CharacterError> {
        let side = |left, right| Some(self.rest_position(left)? - self.rest_position(right)?);
        let sides = [
            side(Joint::LeftHip, Joint::RightHip),
            side(Joint::LeftShoulder, Joint::RightShoulder),
        ];
        let across: DVec3 = sides.into_iter().flatten().sum();
        let flat = DVec3::new(across.x, 0.0, across.z);
        let leg = self.leg_length();
        if !(leg.is_finite() && leg > 0.0 && flat.length() > 1e-3 * leg) {
            return Err(CharacterError::Body {
                path: path.to_owned(),
                problem: "expected legs with a length and a left and a right side, found none"
                    .into(),
            });
        }
        self.facing = DQuat::from_rotation_y((-flat.z).atan2(flat.x));
        Ok(())
    }

    /// Returns the length of a leg from hip to ankle, as the average of both legs.
    pub(crate) fn leg_length(&self) -> f64 {
        let length = |joints: [Joint; 3]| {
            let [hip, knee, ankle] = joints.map(|joint| self.rest_position(joint));
            Some(hip?.distance(knee?) + knee?.distance(ankle?))
        };
        LEGS.into_iter().filter_map(length).sum::<f64>() / 2.0
    }
}

/// Returns the node that carries the whole body: the lowest one at or above the pelvis that legs and head are below. Some rigs have
/// the legs beside the hips.
pub(crate) fn carrier(nodes: &[RestNode], joints: &[Option<usize>; JOINTS]) -> Option<usize> {
    let joint = |joint: Joint| joints[joint.index()];
    let top = joint(Joint::Head).or(joint(Joint::Neck));
    let ends = [joint(Joint::LeftHip), joint(Joint::RightHip), top];
    ancestors(nodes, joint(Joint::Pelvis)?).find(|place| {
        let mut ends = ends.into_iter().flatten();
        ends.all(|end| ancestors(nodes, end).any(|above| above == *place))
    })
}

/// Returns a node and the nodes above it.
pub(crate) fn ancestors(nodes: &[RestNode], place: usize) -> impl Iterator<Item = usize> + '_ {
    std::iter::successors(Some(place), |place| nodes[*place].parent)
}

/// Returns the indices of the skins that meshes use.
fn used_skins(document: &GltfDocument) -> Vec<usize> {
    let nodes = document.value("nodes").as_array();
    let is_used = |skin: &usize| {
        nodes
            .into_iter()
            .flatten()
            .any(|node| node["skin"].as_u64() == Some(*skin as u64) && node["mesh"].is_u64())
    };
    let count = document.value("skins").as_array().map_or(0, Vec::len);
    (0..count).filter(is_used).collect()
}

/// Returns the indices of the nodes that skins use.
fn skinned_nodes(document: &GltfDocument, skins: &[usize]) -> Vec<usize> {
    let skins = skins.iter().map(|skin| &document.value("skins")[*skin]);
    let joints = skins.flat_map(|skin| skin["joints"].as_array().into_iter().flatten());
    joints
        .filter_map(|joint| Some(joint.as_u64()? as usize))
        .collect()
}

/// Reads all nodes in an order in which parents come before their children.
fn read_nodes(document: &GltfDocument) -> Result<Vec<RestNode>, CharacterError> {
    let format_error = |reason: String| CharacterError::Format {
        path: document.path().to_owned(),
        reason,
    };
    let empty = Vec::new();
    let list = document.value("nodes").as_array().unwrap_or(&empty);
    let mut parents: Vec<Option<usize>> = vec![None; list.len()];
    for (index, node) in list.iter().enumerate() {
        for child in node["children"].as_array().into_iter().flatten() {
            let child = child.as_u64().map(|child| child as usize);
            let slot = child.and_then(|child| parents.get_mut(child));
            match slot {
                Some(slot @ None) => *slot = Some(index),
                _ => {
                    return Err(format_error(format!(
                        "nodes[{index}].children: expected nodes that no other node has, found {child:?}"
                    )));
                }
            }
        }
    }
    let mut places: Vec<Option<usize>> = vec![None; list.len()];
    let mut nodes: Vec<RestNode> = Vec::with_capacity(list.len());
    // Roots first, and then the children of what is there.
    let mut open: Vec<usize> = (0..list.len())
        .filter(|index| parents[*index].is_none())
        .collect();
    open.reverse();
    while let Some(index) = open.pop() {
        let node = &list[index];
        let (translation, rotation, scale) = local_transform(node)
            .map_err(|reason| format_error(format!("nodes[{index}]: {reason}")))?;
        let parent = parents[index].and_then(|parent| places[parent]);
        let (world_position, world_rotation, world_scale) = match parent
            .map(|parent| &nodes[parent])
        {
            None => (translation, rotation, scale.x),
            Some(parent) => (
                parent.world_position + parent.world_rotation * (parent.world_scale * translation),
                parent.world_rotation * rotation,
                parent.world_scale * scale.x,
            ),
        };
        places[index] = Some(nodes.len());
        nodes.push(RestNode {
            index,
            name: node["name"]
                .as_str()
                .map_or_else(|| format!("node {index}"), str::to_owned),
            parent,
            translation,
            rotation,
            scale,
            world_position,
            world_rotation,
            world_scale,
            can_move: true,
            is_turned: false,
            is_moved: false,
        });
        let children = node["children"].as_array().into_iter().flatten();
        let children: Vec<usize> = children
            .filter_map(|child| Some(child.as_u64()? as usize))
            .collect();
        open.extend(children.into_iter().rev());
    }
    match nodes.len() == list.len() {
        true => Ok(nodes),
        false => Err(format_error(
            "expected nodes in trees, found a circle of nodes".into(),
        )),
    }
}

/// Returns the translation, rotation and scale of a node.
fn local_transform(node: &Value) -> Result<(DVec3, DQuat, DVec3), String> {
    fn numbers<const N: usize>(node: &Value, name: &str) -> Result<Option<[f64; N]>, String> {
        match &node[name] {
            Value::Null => Ok(None),
            value => serde_json::from_value::<Vec<f64>>(value.clone())
                .ok()
                .and_then(|numbers| numbers.try_into().ok())
                .map(Some)
                .ok_or_else(|| format!("{name}: expected {N} numbers, found {value}")),
        }
    }
    if let Some(matrix) = numbers::<16>(node, "matrix")? {
        let (scale, rotation, translation) =
            DMat4::from_cols_array(&matrix).to_scale_rotation_translation();
        return Ok((translation, rotation, scale));
    }
    let translation = numbers(node, "translation")?.unwrap_or_default();
    let rotation = numbers(node, "rotation")?.unwrap_or([0.0, 0.0, 0.0, 1.0]);
    let scale = numbers(node, "scale")?.unwrap_or([1.0; 3]);
    let rotation = DQuat::from_array(rotation);
    let length = rotation.length();
    if length <= 1e-6 || !length.is_finite() {
        return Err(
            "rotation: expected a quaternion of length 1, found one without a length".into(),
        );
    }
    Ok((translation.into(), rotation.normalize(), scale.into()))
}
