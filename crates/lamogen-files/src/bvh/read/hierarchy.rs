//! The hierarchy of a BVH: its joints and the channels of each joint.

use glam::DVec3;

use crate::bvh::BvhChannel;
use crate::bvh::cursor::{BvhError, Cursor};
use crate::clip::{END_SITE, Node};

/// The most joints of a file. A human skeleton has 20 to 200; a file with many more is not a human and would take long.
const MAX_NODES: usize = 2000;

impl BvhChannel {
    /// Returns the channel of a name such as `Xposition` or `Zrotation`.
    fn from_name(name: &str) -> Option<BvhChannel> {
        let name = name.to_ascii_lowercase();
        let axis = ["x", "y", "z"]
            .into_iter()
            .position(|axis| name.starts_with(axis))?;
        match &name[1..] {
            "position" => Some(BvhChannel::Position(axis)),
            "rotation" => Some(BvhChannel::Rotation(axis)),
            _ => None,
        }
    }
}

/// Reads the joints from the name of the ROOT to its closing brace, and the channels of each joint.
pub(in crate::bvh) fn read_hierarchy(
    cursor: &mut Cursor<'_>,
) -> Result<(Vec<Node>, Vec<Vec<BvhChannel>>), BvhError> {
    let mut nodes = vec![read_node_start(cursor, None)?];
    let mut channels = vec![Vec::new()];
    let mut offset_read = vec![false];
    let mut branch = vec![0];
    while let Some(&node) = branch.last() {
        let found = cursor.clone();
        let word = cursor.next_token().to_ascii_uppercase();
        match word.as_str() {
            "OFFSET" if offset_read[node] => {
                return Err(found.error("one OFFSET of a joint", "a second"));
            }
            "OFFSET" => {
                for axis in 0..3 {
                    nodes[node].rest[axis] = cursor.number("three numbers after OFFSET")?;
                }
                offset_read[node] = true;
            }
            "CHANNELS" if !channels[node].is_empty() => {
                return Err(found.error("one list of CHANNELS of a joint", "a second"));
            }
            "CHANNELS" => channels[node] = read_channels(cursor)?,
            "JOINT" | "END" => {
                if nodes.len() == MAX_NODES {
                    return Err(found.error(&format!("at most {MAX_NODES} joints"), "more"));
                }
                branch.push(nodes.len());
                let mut child = read_node_start(cursor, Some(node))?;
                if word == "END" {
                    child.name = END_SITE.into();
                }
                nodes.push(child);
                channels.push(Vec::new());
                offset_read.push(false);
            }
            "}" if !offset_read[node] => {
                let name = &nodes[node].name;
                return Err(
                    found.error("OFFSET and three numbers", &format!("the end of {name:?}"))
                );
            }
            "}" => {
                branch.pop();
            }
            _ => {
                return Err(found.error(
                    "OFFSET, CHANNELS, JOINT, End Site or }",
                    &found.describe_next(),
                ));
            }
        }
    }
    Ok((nodes, channels))
}

/// Reads the name of a joint and its opening brace.
fn read_node_start(cursor: &mut Cursor<'_>, parent: Option<usize>) -> Result<Node, BvhError> {
    let name = cursor.joint_name()?;
    Ok(Node {
        name,
        parent,
        rest: DVec3::ZERO,
        translations: Vec::new(),
        rotations: Vec::new(),
        scales: vec![DVec3::ONE],
    })
}

/// Reads the count of channels and their names.
fn read_channels(cursor: &mut Cursor<'_>) -> Result<Vec<BvhChannel>, BvhError> {
    let count = cursor.parse("the number of channels", |token| {
        token.parse::<usize>().ok()
    })?;
    let mut channels = Vec::new();
    for _ in 0..count {
        let found = cursor.clone();
        let expected = "a channel such as Xposition or Zrotation";
        let channel = cursor.parse(expected, BvhChannel::from_name)?;
        if matches!(channel, BvhChannel::Position(_)) && channels.contains(&channel) {
            return Err(found.error("each position channel once", &found.describe_next()));
        }
        channels.push(channel);
    }
    Ok(channels)
}
