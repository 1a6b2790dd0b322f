//! The skeleton of a BVH file, apart from its motion: what is needed to write other motions for it.

use std::fmt::Write;
use std::path::Path;

use glam::{DQuat, DVec3};

use super::cursor::{BvhError, Cursor};
use super::euler::euler_angles;
use super::read::{parse, read_hierarchy};
use crate::body::MappedBody;
use crate::clip::{Clip, END_SITE};
use crate::import::guess_up;
use crate::mapping::JointMapping;
use crate::names::{missing_joints, recognise};
use crate::skeleton::SkeletonError;
use crate::units::{Unit, UpAxis};

/// A channel of a joint: the meaning of one number in every row of a BVH. Axes are 0, 1 and 2 for X, Y and Z.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BvhChannel {
    /// The position along an axis, relative to the parent.
    Position(usize),
    /// A rotation about an axis, after the rotations of the channels before it.
    Rotation(usize),
}

/// A joint of a BVH.
#[derive(Clone, Debug, PartialEq)]
pub struct BvhJoint {
    /// The name in the file.
    pub name: String,
    /// The index of the parent, which is smaller than that of the joint.
    pub parent: Option<usize>,
    /// The position relative to the parent in the pose without rotations, in the file's unit and axes.
    pub offset: [f64; 3],
    /// The channels, in their order.
    pub channels: Vec<BvhChannel>,
    /// The rotation relative to the parent in the first frame: a quaternion `[x, y, z, w]`.
    pub first_rotation: [f64; 4],
}

/// The skeleton of a BVH file.
#[derive(Clone, Debug, PartialEq)]
pub struct BvhSkeleton {
    /// The text of the file up to its motion.
    header: String,
    /// The joints, parents before their children, without end sites.
    pub joints: Vec<BvhJoint>,
    /// The unit of lengths.
    pub unit: Unit,
    /// The axis that points up.
    pub up: UpAxis,
}

/// The reason why a BVH has no skeleton for other motions.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)]
pub enum BvhSkeletonError {
    /// The text is damaged.
    #[error(transparent)]
    Text(#[from] BvhError),
    /// The joints are not known.
    #[error(transparent)]
    Joints(#[from] SkeletonError),
    /// A joint has rotations that are not about three different axes.
    #[error(
        "expected three rotations about different axes of the joint {joint:?}, or none, found {found}"
    )]
    Rotations { joint: String, found: String },
}

/// The values of a joint at a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BvhJointPose {
    /// The position relative to the parent, in the file's unit and axes.
    pub position: [f64; 3],
    /// The rotation relative to the parent: a quaternion `[x, y, z, w]` of length 1.
    pub rotation: [f64; 4],
}

impl BvhSkeleton {
    /// Reads the skeleton of the text of a BVH file. A file without a motion is read, too. `path` is used only in error
    /// messages.
    ///
    /// Unit and axes are told by the size and the direction of the body. A body that has no human size in any known unit is taken
    /// to be in centimetres.
    ///
    /// # Errors
    ///
    /// If the text is damaged, the joints are neither of a known naming scheme nor named by the mapping, or a joint has other
    /// rotations than three about different axes.
    pub fn read(
        text: &str,
        mapping: Option<&JointMapping>,
        path: impl AsRef<Path>,
    ) -> Result<BvhSkeleton, BvhSkeletonError> {
        let path = path.as_ref();
        let text = text.trim_start_matches('\u{feff}');
        let mut cursor = Cursor::new(text, path);
        cursor.expect_keyword(&["HIERARCHY"], "HIERARCHY")?;
        cursor.expect_keyword(&["ROOT"], "ROOT and the name of the first joint")?;
        let (nodes, channels) = read_hierarchy(&mut cursor)?;
        let header = cursor.text_before().trim_end().to_owned();
        let clip = match cursor.peek().is_empty() {
            // Without a motion, the pose without rotations is the only one.
            true => Clip {
                nodes: { nodes.into_iter() }
                    .map(|mut node| {
                        node.translations = vec![node.rest];
                        node.rotations = vec![DQuat::IDENTITY];
                        node
                    })
                    .collect(),
                frames: 1,
                seconds_per_frame: 0.0,
            },
            false => parse(text, path)?.clip,
        };
        let found = match mapping {
            Some(mapping) => mapping.nodes(&clip).map_err(SkeletonError::from)?,
            None => recognise(&clip).map_err(SkeletonError::from)?.1,
        };
        if let Some(missing) = missing_joints(&found).first() {
            let problem = format!("expected a whole body, found no {}", missing.name());
            return Err(SkeletonError::Mapping(problem).into());
        }
        let body = MappedBody::new(&clip, found);
        let size = body.size(&clip.positions(0.0));
        let unit = Unit::of_body(size).unwrap_or(Unit::Centimetre);
        let rest = body.pose(&clip.rest_positions());
        let poses = [0, clip.frames / 2, clip.frames - 1];
        let poses =
            poses.map(|frame| body.pose(&clip.positions(frame as f64 * clip.seconds_per_frame)));
        let up = guess_up(&rest, &poses);
        let mut places = vec![0; clip.nodes.len()];
        let mut joints: Vec<BvhJoint> = Vec::new();
        for (index, (node, channels)) in clip.nodes.iter().zip(channels).enumerate() {
            places[index] = joints.len();
            if node.name == END_SITE {
                continue;
            }
            let rotations = channels.iter().filter_map(|channel| match channel {
                BvhChannel::Rotation(axis) => Some(*axis),
                BvhChannel::Position(_) => None,
            });
            let rotations: Vec<usize> = rotations.collect();
            let is_complete = (0..3).all(|axis| rotations.contains(&axis)) && rotations.len() == 3;
            if !rotations.is_empty() && !is_complete {
                let names: Vec<&str> = rotations
                    .iter()
                    .map(|axis| ["X", "Y", "Z"][*axis])
                    .collect();
                return Err(BvhSkeletonError::Rotations {
                    joint: node.name.clone(),
                    found: names.join(", "),
                });
            }
            joints.push(BvhJoint {
                name: node.name.clone(),
                parent: node.parent.map(|parent| places[parent]),
                offset: node.rest.to_array(),
                channels,
                first_rotation: node.rotations[0].normalize().to_array(),
            });
        }
        Ok(BvhSkeleton {
            header,
            joints,
            unit,
            up,
        })
    }

    /// Formats a motion of the skeleton as the text of a BVH file. The hierarchy is that of the file that was read, letter for
    /// letter. Angles continue past 180° and do not jump.
    ///
    /// # Panics
    ///
    /// If a frame has another number of joints than the skeleton.
    pub fn text(&self, frames: &[Vec<BvhJointPose>], seconds_per_frame: f64) -> String {
        let mut text = format!("{}\nMOTION\nFrames: {}\n", self.header, frames.len());
        // Writing to a String cannot fail.
        let _ = writeln!(text, "Frame Time: {seconds_per_frame}");
        let mut angles = vec![[0.0; 3]; self.joints.len()];
        for poses in frames {
            assert_eq!(poses.len(), self.joints.len(), "a pose of every joint");
            let mut separator = "";
            for ((joint, pose), angles) in self.joints.iter().zip(poses).zip(&mut angles) {
                let mut order = joint.channels.iter().filter_map(|channel| match channel {
                    BvhChannel::Rotation(axis) => Some(*axis),
                    BvhChannel::Position(_) => None,
                });
                if let (Some(first), Some(second), Some(third)) =
                    (order.next(), order.next(), order.next())
                {
                    let rotation = DQuat::from_array(pose.rotation);
                    *angles = euler_angles([first, second, third], rotation, *angles);
                }
                let mut rotations = angles.iter();
                for channel in &joint.channels {
                    let value = match channel {
                        BvhChannel::Position(axis) => pose.position[*axis],
                        BvhChannel::Rotation(_) => rotations.next().map_or(0.0, |x| x.to_degrees()),
                    };
                    // Minus zero is never written.
                    let value = if value.abs() < 5e-7 { 0.0 } else { value };
                    let _ = write!(text, "{separator}{value:.6}");
                    separator = " ";
                }
            }
            text.push('\n');
        }
        text
    }

    /// Returns the rotation from the file's axes to axes with Y up: a quaternion `[x, y, z, w]`.
    pub fn to_y_up(&self) -> [f64; 4] {
        let [x, y, z] = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| self.up.to_y_up(axis));
        DQuat::from_mat3(&glam::DMat3::from_cols(x, y, z)).to_array()
    }
}
