//! The frames of a BVH: its rows of numbers as translations and rotations of nodes.

use glam::{DQuat, DVec3};

use crate::bvh::BvhChannel;
use crate::bvh::cursor::{BvhError, Cursor};
use crate::clip::Node;

/// Reads all rows of numbers, passes each of them to `take_row`, and returns their count.
pub(super) fn read_rows(
    cursor: &mut Cursor<'_>,
    width: usize,
    mut take_row: impl FnMut(&[f64]),
) -> Result<usize, BvhError> {
    let mut row = Vec::with_capacity(width);
    let mut frames = 0;
    while !cursor.peek().is_empty() {
        let start = cursor.clone();
        row.clear();
        while !cursor.peek_in_line().is_empty() {
            row.push(cursor.number("a number")?);
        }
        if row.len() != width {
            let expected = format!("a row of {width} numbers, one for each channel");
            return Err(start.error(&expected, &row.len().to_string()));
        }
        take_row(&row);
        frames += 1;
    }
    Ok(frames)
}

impl Node {
    /// Takes the numbers of the node's channels from a row and appends the translation and rotation of the frame.
    ///
    /// Positions replace the offset, as in the files of programs that move other joints than the root. An axis without a
    /// channel keeps its offset.
    pub(super) fn push_frame<'a>(
        &mut self,
        channels: &[BvhChannel],
        values: &mut impl Iterator<Item = &'a f64>,
    ) {
        let mut translation = self.rest;
        let mut rotation = DQuat::IDENTITY;
        let (mut has_position, mut has_rotation) = (false, false);
        for (channel, &value) in channels.iter().zip(values) {
            match channel {
                BvhChannel::Position(axis) => {
                    has_position = true;
                    translation[*axis] = value;
                }
                BvhChannel::Rotation(axis) => {
                    has_rotation = true;
                    rotation *= DQuat::from_axis_angle(DVec3::AXES[*axis], value.to_radians());
                }
            }
        }
        if has_position {
            self.translations.push(translation);
        }
        if has_rotation {
            // A product of three unit quaternions needs no normalisation; one of thousands would.
            self.rotations.push(rotation);
        }
    }
}

/// Completes the nodes after the last frame: corrects positions that are relative to the offsets, and adds a single entry
/// to each node without channels of positions or rotations.
///
/// Some programs give every joint six channels, but fill in the positions of the root only, or write the difference of
/// each joint's position to its offset, which is only noise. If the positions as a whole are much nearer to zero than to the
/// offsets, they are therefore taken as relative to the offsets.
pub(super) fn finish_nodes(mut nodes: Vec<Node>) -> Vec<Node> {
    let is_moved_child = |node: &&mut Node| node.parent.is_some() && !node.translations.is_empty();
    // The median over the frames of a joint, so that a single outlier has no effect.
    let median_distance = |node: &Node, from: DVec3| {
        let mut distances: Vec<f64> = { node.translations.iter() }
            .map(|place| place.distance(from))
            .collect();
        distances.sort_by(f64::total_cmp);
        distances[distances.len() / 2]
    };
    let (mut from_zero, mut from_offset) = (0.0, 0.0);
    for node in nodes.iter_mut().filter(is_moved_child) {
        from_zero += median_distance(node, DVec3::ZERO);
        from_offset += median_distance(node, node.rest);
    }
    // The sums over all joints decide: a single joint may move anywhere, but all bones together do not shrink to zero.
    const MUCH_NEARER: f64 = 0.25;
    let is_relative = from_zero < MUCH_NEARER * from_offset;
    for node in nodes.iter_mut().filter(is_moved_child) {
        let is_zero = node.translations.iter().all(|place| *place == DVec3::ZERO);
        if is_zero {
            node.translations = vec![node.rest];
        } else if is_relative {
            for place in &mut node.translations {
                *place += node.rest;
            }
        }
    }
    for node in &mut nodes {
        if node.translations.is_empty() {
            node.translations = vec![node.rest];
        }
        if node.rotations.is_empty() {
            node.rotations = vec![DQuat::IDENTITY];
        }
    }
    nodes
}
