//! Skeletons of BVH files as characters.

use std::io::Write;
use std::path::{Path, PathBuf};

use glam::{DQuat, DVec3};
use lamogen_files::JointMapping;
use lamogen_files::bvh::{BvhChannel, BvhJointPose, BvhSkeleton, BvhSkeletonError};
use lamogen_motion::write_atomically;

use crate::character::{CharacterAnimation, has_extension};
use crate::error::CharacterError;
use crate::skeleton::RestNode;

/// The skeleton of a BVH file.
#[derive(Clone, Debug)]
pub(crate) struct BvhDocument {
    path: PathBuf,
    pub(crate) skeleton: BvhSkeleton,
}

/// The index of the node above the root of a BVH, which is not in the file and holds its unit and axes.
const WORLD: usize = usize::MAX;

impl BvhDocument {
    /// Parses the bytes of a `.bvh` file.
    pub(crate) fn parse(
        bytes: &[u8],
        mapping: Option<&JointMapping>,
        path: &Path,
    ) -> Result<BvhDocument, CharacterError> {
        // Bytes that are not UTF-8 occur in joint names of old files.
        let text = String::from_utf8_lossy(bytes);
        let skeleton = BvhSkeleton::read(&text, mapping, path).map_err(|error| match error {
            // These errors name the file themselves.
            BvhSkeletonError::Text(error) => CharacterError::Bvh(error),
            error => CharacterError::Format {
                path: path.to_owned(),
                reason: error.to_string(),
            },
        })?;
        Ok(BvhDocument {
            path: path.to_owned(),
            skeleton,
        })
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the nodes in a rest pose: without rotations, or, if `in_first_frame`, as in the first frame of the file.
    pub(crate) fn rest_nodes(&self, in_first_frame: bool) -> Vec<RestNode> {
        let scale = self.skeleton.unit.metres();
        let turn = DQuat::from_array(self.skeleton.to_y_up());
        let mut nodes = vec![RestNode {
            index: WORLD,
            name: String::new(),
            parent: None,
            translation: DVec3::ZERO,
            rotation: turn,
            scale: DVec3::splat(scale),
            world_position: DVec3::ZERO,
            world_rotation: turn,
            world_scale: scale,
            can_move: false,
            is_turned: false,
            is_moved: false,
        }];
        for (index, joint) in self.skeleton.joints.iter().enumerate() {
            let parent = joint.parent.map_or(0, |parent| parent + 1);
            let above = &nodes[parent];
            let translation = DVec3::from(joint.offset);
            let rotation = match in_first_frame {
                true => DQuat::from_array(joint.first_rotation),
                false => DQuat::IDENTITY,
            };
            let positions = { joint.channels.iter() }
                .filter(|channel| matches!(channel, BvhChannel::Position(_)));
            nodes.push(RestNode {
                index,
                name: joint.name.clone(),
                parent: Some(parent),
                translation,
                rotation,
                scale: DVec3::ONE,
                world_position: above.world_position + above.world_rotation * (scale * translation),
                world_rotation: above.world_rotation * rotation,
                world_scale: scale,
                can_move: positions.count() == 3,
                is_turned: false,
                is_moved: false,
            });
        }
        nodes
    }

    /// Returns whether the file can hold rotations of a node.
    pub(crate) fn can_turn(&self, node: &RestNode) -> bool {
        let joint = self.skeleton.joints.get(node.index);
        let is_rotation = |channel: &BvhChannel| matches!(channel, BvhChannel::Rotation(_));
        joint.is_some_and(|joint| joint.channels.iter().any(is_rotation))
    }

    /// Writes an animation as a file with the same skeleton. `nodes` are those of the rest pose.
    pub(crate) fn write(
        &self,
        path: &Path,
        nodes: &[RestNode],
        animation: &CharacterAnimation,
    ) -> Result<(), CharacterError> {
        if !has_extension(path, "bvh") {
            return Err(CharacterError::Container {
                path: path.to_owned(),
                expected: ".bvh",
                character: self.path.clone(),
            });
        }
        let mut rest: Vec<BvhJointPose> = vec![
            BvhJointPose {
                position: [0.0; 3],
                rotation: [0.0, 0.0, 0.0, 1.0],
            };
            self.skeleton.joints.len()
        ];
        for node in nodes.iter().filter(|node| node.index != WORLD) {
            rest[node.index] = BvhJointPose {
                position: node.translation.to_array(),
                rotation: node.rotation.to_array(),
            };
        }
        // In a BVH, a loop ends one step before its first frame.
        let frames = animation.frames() - usize::from(animation.is_loop);
        let frames: Vec<Vec<BvhJointPose>> = (0..frames)
            .map(|frame| {
                let mut poses = rest.clone();
                for bone in &animation.bones {
                    let turn = bone.rotations[frame].map(f64::from);
                    poses[bone.node].rotation = DQuat::from_array(turn).normalize().to_array();
                }
                for track in animation.root.iter().chain([&animation.pelvis]) {
                    poses[track.node].position = track.positions[frame].map(f64::from);
                }
                poses
            })
            .collect();
        let seconds = 1.0 / f64::from(animation.frames_per_second);
        let text = self.skeleton.text(&frames, seconds);
        write_atomically(path, |file| file.write_all(text.as_bytes())).map_err(|reason| {
            CharacterError::Write {
                path: path.to_owned(),
                reason,
            }
        })
    }
}
