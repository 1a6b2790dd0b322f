//! Recognition of the joints of a skeleton without a motion, such as that of a character.

use glam::{DQuat, DVec3};
use lamogen_motion::{JOINTS, Joint};

use crate::clip::{Clip, Node};
use crate::mapping::{JointMapping, MappingError};
use crate::names::{UnknownSkeleton, is_limb_joint, missing_joints, recognise};
use crate::schemes::REQUIRED;

/// A node of a skeleton.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SkeletonNode {
    /// The name in the file.
    pub name: String,
    /// The index of the parent, which must be smaller than the node's own.
    pub parent: Option<usize>,
    /// Whether the node moves a mesh. Of two skeletons with the same names, the one with more such nodes is found.
    pub is_skinned: bool,
}

/// The nodes of a skeleton that are joints.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SkeletonJoints {
    /// The naming scheme: a known scheme, or `mapping file`.
    pub scheme: &'static str,
    /// The index of each joint's node, indexed by [`Joint::index`]. Joints of the spine have no nodes: they are what lies
    /// between pelvis and neck.
    pub nodes: [Option<usize>; JOINTS],
}

impl SkeletonJoints {
    /// Returns the joints that a body needs and that have no node.
    pub fn missing_joints(&self) -> Vec<Joint> {
        missing_joints(&self.nodes)
    }

    /// Returns the first joint of a limb that a body needs and whose node is not below that of the joint before it, with that
    /// joint. `is_below` says whether a node is below another one.
    pub fn misplaced_joint(
        &self,
        is_below: impl Fn(usize, usize) -> bool,
    ) -> Option<(Joint, Joint)> {
        let mut limbs = { REQUIRED.into_iter() }.filter(|joint| is_limb_joint(*joint));
        limbs.find_map(|joint| {
            let parent = joint.parent()?;
            let is_misplaced = !is_below(self.node(joint)?, self.node(parent)?);
            is_misplaced.then_some((joint, parent))
        })
    }

    /// Returns the node of a joint.
    pub fn node(&self, joint: Joint) -> Option<usize> {
        self.nodes[joint.index()]
    }
}

/// The reason why the joints of a skeleton are not found.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SkeletonError {
    /// The names follow no known scheme.
    #[error(transparent)]
    Unknown(#[from] UnknownSkeleton),
    /// The mapping does not fit the skeleton.
    #[error("{0}")]
    Mapping(String),
}

impl From<MappingError> for SkeletonError {
    fn from(error: MappingError) -> Self {
        SkeletonError::Mapping(error.to_string())
    }
}

/// Finds the joints of a skeleton by the names of its nodes, or by a mapping.
///
/// # Errors
///
/// If the names follow no known scheme, or the mapping names a node that is not there.
///
/// # Panics
///
/// If a parent does not come before its children.
pub fn find_joints(
    nodes: &[SkeletonNode],
    mapping: Option<&JointMapping>,
) -> Result<SkeletonJoints, SkeletonError> {
    let clip_nodes = nodes.iter().enumerate().map(|(index, node)| {
        assert!(node.parent.is_none_or(|parent| parent < index));
        Node {
            name: node.name.clone(),
            parent: node.parent,
            rest: DVec3::ZERO,
            translations: vec![DVec3::ZERO],
            // Skinned nodes take the place of those that an animation moves.
            rotations: vec![DQuat::IDENTITY; 1 + usize::from(node.is_skinned)],
            scales: vec![DVec3::ONE],
        }
    });
    let clip = Clip {
        nodes: clip_nodes.collect(),
        frames: 2,
        seconds_per_frame: 0.0,
    };
    let (scheme, nodes) = match mapping {
        Some(mapping) => ("mapping file", mapping.nodes(&clip)?),
        None => recognise(&clip)?,
    };
    Ok(SkeletonJoints { scheme, nodes })
}
