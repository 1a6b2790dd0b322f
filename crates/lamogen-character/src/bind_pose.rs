//! The bind pose of a skin, which is the rest pose of files whose nodes are stored in another pose.

use std::fmt;

use glam::{DMat4, DQuat, DVec3};
use lamogen_files::SkeletonJoints;
use lamogen_motion::Joint;

use crate::document::GltfDocument;
use crate::skeleton::{CharacterSkeleton, RestNode, ancestors, carrier};

/// A notice about the rest pose of a character, in words.
#[derive(Clone, Debug, PartialEq)]
pub enum RestPoseNotice {
    /// The nodes are stored in another pose than that in which the mesh was bound, so the rest pose is the bind pose.
    BindPose {
        /// The name of the node that is turned most relative to its parent.
        node: String,
        /// The angle by which it is turned, in degrees.
        degrees: f64,
    },
    /// The nodes are stored in another pose than that in which the mesh was bound, but a body does not stand in the bind pose, so
    /// the rest pose is that of the nodes.
    NodesKept {
        /// The name of the node that is turned most relative to its parent.
        node: String,
        /// The angle by which it is turned, in degrees.
        degrees: f64,
    },
    /// The bind pose cannot be read, so the rest pose is that of the nodes.
    Unreadable {
        /// What is wrong with the file.
        reason: String,
    },
}

impl fmt::Display for RestPoseNotice {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            RestPoseNotice::BindPose { node, degrees } => write!(
                formatter,
                "its nodes are stored in a pose ({node:?} is turned by {degrees:.0}°), so the rest pose is that in which its mesh was bound"
            ),
            RestPoseNotice::NodesKept { node, degrees } => write!(
                formatter,
                "its nodes are stored in another pose than its mesh was bound in ({node:?} is turned by {degrees:.0}°), but no body stands in that one, so the rest pose is that of the nodes"
            ),
            RestPoseNotice::Unreadable { reason } => write!(
                formatter,
                "the pose in which its mesh was bound cannot be read, so the rest pose is that of the nodes: {reason}"
            ),
        }
    }
}

/// Nodes whose rotations relative to their parents differ by more than this from the bind pose are posed, in degrees.
const POSED_DEGREES: f64 = 2.0;
/// Nodes that are farther than this from their place relative to their parents in the bind pose are posed, in units of the leg.
const POSED_DISTANCE: f64 = 0.03;
/// Values of the file and of the bind pose that differ by less than this are the same: angles in radians, distances as
/// part of the whole. Matrices have 32 bits.
const SAME: f64 = 3e-4;

/// The position and rotation of a joint in the bind pose. The body as a whole is where the node that carries it is in the file.
#[derive(Clone, Copy, Debug)]
struct BoundJoint {
    position: DVec3,
    rotation: DQuat,
}

/// A skeleton in its rest pose, and what is to be said about it.
pub(crate) type RestSkeleton = (CharacterSkeleton, Option<RestPoseNotice>);

/// Chooses the rest pose: that of the nodes, or, where they are stored in another one, that in which the mesh was bound.
///
/// `skins` has the indices of the skins that are used, and `make` makes a skeleton of nodes.
pub(crate) fn rest_skeleton<E>(
    document: &GltfDocument,
    skins: &[usize],
    nodes: Vec<RestNode>,
    joints: &SkeletonJoints,
    make: impl Fn(Vec<RestNode>) -> Result<CharacterSkeleton, E>,
) -> Result<RestSkeleton, E> {
    let matrices = match document.inverse_bind_matrices() {
        Ok(matrices) => matrices,
        Err(reason) => {
            return Ok((make(nodes)?, Some(RestPoseNotice::Unreadable { reason })));
        }
    };
    let bound = bound_matrices(document, skins, &matrices, &nodes);
    let pose = carrier(&nodes, &joints.nodes)
        .and_then(|carrier| BindPose::new(&nodes, carrier, bound, document));
    let Some(pose) = pose else {
        return Ok((make(nodes)?, None));
    };
    let Some((node, degrees)) = pose.posed_node(joints) else {
        return Ok((make(nodes)?, None));
    };
    let node = nodes[node].name.clone();
    for (rotation, translation) in pose.placements() {
        let skeleton = make(pose.posed_nodes(rotation, translation));
        if let Ok(skeleton) = skeleton
            && skeleton.stands()
        {
            return Ok((skeleton, Some(RestPoseNotice::BindPose { node, degrees })));
        }
    }
    let notice = RestPoseNotice::NodesKept { node, degrees };
    Ok((make(nodes)?, Some(notice)))
}

/// Returns the matrix of each node in the space in which the mesh was bound; `None` for nodes that no skin uses.
///
/// The matrices of the skin that has the most joints determine the space. Those of others, which may have been bound in another
/// one, are brought into it by a joint that both have.
fn bound_matrices(
    document: &GltfDocument,
    skins: &[usize],
    matrices: &[Option<Vec<[f64; 16]>>],
    nodes: &[RestNode],
) -> Vec<Option<DMat4>> {
    let place = |index: usize| nodes.iter().position(|node| node.index == index);
    let mut skins: Vec<Vec<(usize, DMat4)>> = { skins.iter() }
        .filter_map(|skin| {
            let joints = document.value("skins")[*skin]["joints"].as_array()?;
            let matrices = matrices.get(*skin)?.as_ref()?;
            let joints = { joints.iter().zip(matrices) }.filter_map(|(joint, matrix)| {
                let place = place(joint.as_u64()? as usize)?;
                let bound = DMat4::from_cols_array(matrix).inverse();
                let is_regular = bound.is_finite() && bound.determinant() > 0.0;
                is_regular.then_some((place, bound))
            });
            Some(joints.collect())
        })
        .collect();
    skins.sort_by_key(|joints| std::cmp::Reverse(joints.len()));
    let mut bound: Vec<Option<DMat4>> = vec![None; nodes.len()];
    for (order, joints) in skins.iter().enumerate() {
        let common =
            { joints.iter() }.find_map(|(place, matrix)| Some(bound[*place]? * matrix.inverse()));
        let into_first = match (order, common) {
            (0, _) => DMat4::IDENTITY,
            (_, Some(common)) => common,
            (_, None) => continue,
        };
        for (place, matrix) in joints {
            bound[*place].get_or_insert(into_first * *matrix);
        }
    }
    bound
}

/// The nodes of a file and the pose in which the mesh was bound.
struct BindPose<'a> {
    nodes: &'a [RestNode],
    /// The place of the node that carries the body.
    carrier: usize,
    /// The joints of skins, where the highest bound joint of the body is as in the file.
    bound: Vec<Option<BoundJoint>>,
    /// The matrices that may bring the space in which the mesh was bound into the world, relative to the one that does so for
    /// `bound`, the likeliest first.
    spaces: Vec<DMat4>,
}

impl<'a> BindPose<'a> {
    /// Returns the bind pose; `None` if no joint of the body is bound.
    fn new(
        nodes: &'a [RestNode],
        carrier: usize,
        matrices: Vec<Option<DMat4>>,
        document: &GltfDocument,
    ) -> Option<BindPose<'a>> {
        let mut world: Vec<DMat4> = Vec::with_capacity(nodes.len());
        for node in nodes {
            let local =
                DMat4::from_scale_rotation_translation(node.scale, node.rotation, node.translation);
            world.push(node.parent.map_or(local, |parent| world[parent] * local));
        }
        let by_joint = |place: usize| Some(world[place] * matrices[place]?.inverse());
        let highest = (carrier..nodes.len()).find(|place| {
            matrices[*place].is_some() && ancestors(nodes, *place).any(|above| above == carrier)
        })?;
        // The space may be scaled and sheared, as that of a mesh with a transform of its own is; joints in the world are not.
        let space = by_joint(highest)?;
        let bound = matrices.iter().map(|matrix| {
            let (_, rotation, position) = (space * (*matrix)?).to_scale_rotation_translation();
            Some(BoundJoint {
                position,
                rotation: rotation.normalize(),
            })
        });
        let bound = bound.collect();
        // A joint above the body is posed only where a file has root motion.
        let above: Vec<usize> = ancestors(nodes, carrier).skip(1).collect();
        let mut spaces: Vec<DMat4> = { above.iter().rev() }
            .filter_map(|place| by_joint(*place))
            .collect();
        let unbound = above.iter().find(|place| matrices[**place].is_none());
        spaces.extend(unbound.map(|place| world[*place]));
        spaces.push(DMat4::IDENTITY);
        let list = document.value("nodes").as_array().into_iter().flatten();
        let meshes = list.enumerate().filter(|(_, node)| node["skin"].is_u64());
        let meshes = meshes.filter_map(|(index, _)| {
            let place = nodes.iter().position(|node| node.index == index)?;
            Some(world[place])
        });
        spaces.extend(meshes);
        spaces.push(space);
        let spaces = spaces.into_iter().map(|other| other * space.inverse());
        let spaces = spaces.collect();
        Some(BindPose {
            nodes,
            carrier,
            bound,
            spaces,
        })
    }

    /// Returns the bound joint with the nearest bound joint above it.
    fn bone(&self, place: usize) -> Option<(usize, BoundJoint, BoundJoint)> {
        let joint = self.bound[place]?;
        let mut above = ancestors(self.nodes, place).skip(1);
        let above = above.find(|above| self.bound[*above].is_some())?;
        Some((above, self.bound[above]?, joint))
    }

    /// Whether a node is at or below the one that carries the body.
    fn is_of_body(&self, place: usize) -> bool {
        ancestors(self.nodes, place).any(|above| above == self.carrier)
    }

    /// Returns the node of the body that the file stores farthest from the bind pose, and the angle by which it is turned in
    /// degrees; `None` if all are as in the bind pose.
    fn posed_node(&self, joints: &SkeletonJoints) -> Option<(usize, f64)> {
        let ends: Vec<usize> = joints.nodes.iter().flatten().copied().collect();
        let is_above_joint = |place: usize| {
            let mut ends = ends.iter();
            ends.any(|end| ancestors(self.nodes, *end).any(|above| above == place))
        };
        let leg = {
            let place =
                |joint: Joint| Some(self.nodes[joints.nodes[joint.index()]?].world_position);
            let ends = [Joint::LeftHip, Joint::LeftKnee, Joint::LeftAnkle].map(place);
            let [Some(hip), Some(knee), Some(ankle)] = ends else {
                return None;
            };
            hip.distance(knee) + knee.distance(ankle)
        };
        let mut worst: Option<(usize, f64)> = None;
        let mut is_posed = false;
        for place in 0..self.nodes.len() {
            if !self.is_of_body(place) || !is_above_joint(place) {
                continue;
            }
            let Some((above, parent, joint)) = self.bone(place) else {
                continue;
            };
            let [own, parent_node] = [place, above].map(|place| &self.nodes[place]);
            let bound = parent.rotation.inverse() * joint.rotation;
            let stored = parent_node.world_rotation.inverse() * own.world_rotation;
            let degrees = bound.angle_between(stored).to_degrees();
            let bound_offset = parent.rotation.inverse() * (joint.position - parent.position);
            let stored_offset = parent_node.world_rotation.inverse()
                * (own.world_position - parent_node.world_position);
            let distance = bound_offset.distance(stored_offset);
            is_posed |= degrees > POSED_DEGREES || distance > POSED_DISTANCE * leg;
            if worst.is_none_or(|(_, most)| degrees > most) {
                worst = Some((place, degrees));
            }
        }
        worst.filter(|_| is_posed)
    }

    /// Returns the rotations and translations that may bring the bind pose to its place in the world, the likeliest first. Files do
    /// not say which of them does.
    fn placements(&self) -> impl Iterator<Item = (DQuat, DVec3)> + '_ {
        self.spaces.iter().filter_map(|space| {
            let (scale, rotation, translation) = space.to_scale_rotation_translation();
            let is_uniform = scale.max_element() - scale.min_element() < 0.01 * scale.max_element();
            let is_rigid = scale.min_element() > 0.0 && is_uniform && translation.is_finite();
            // The size of the bones is that of the nodes.
            is_rigid.then(|| (rotation.normalize(), translation / scale.x))
        })
    }

    /// Returns the nodes in the bind pose. Nodes above the body stay where the file has them.
    fn posed_nodes(&self, rotation: DQuat, translation: DVec3) -> Vec<RestNode> {
        let mut nodes: Vec<RestNode> = Vec::with_capacity(self.nodes.len());
        for (place, node) in self.nodes.iter().enumerate() {
            let mut node = node.clone();
            if self.is_of_body(place) {
                let above = node.parent.map(|parent| &nodes[parent]);
                let (at, turn, scale) =
                    above.map_or((DVec3::ZERO, DQuat::IDENTITY, 1.0), |above| {
                        (
                            above.world_position,
                            above.world_rotation,
                            above.world_scale,
                        )
                    });
                if let Some(joint) = self.bound[place] {
                    let position = rotation * joint.position + translation;
                    let inverse = turn.inverse();
                    node.place_at(
                        inverse * (position - at) / scale,
                        inverse * rotation * joint.rotation,
                    );
                }
                node.world_rotation = turn * node.rotation;
                node.world_position = at + turn * (scale * node.translation);
            }
            nodes.push(node);
        }
        nodes
    }
}

impl RestNode {
    /// Moves a node relative to its parent. It is left as it is in the file where the difference is that of rounding.
    fn place_at(&mut self, translation: DVec3, rotation: DQuat) {
        let rotation = rotation.normalize();
        if rotation.angle_between(self.rotation) > SAME {
            self.rotation = rotation;
            self.is_turned = true;
        }
        if translation.distance(self.translation) > SAME * translation.length().max(1e-9) {
            self.translation = translation;
            self.is_moved = true;
        }
    }
}
