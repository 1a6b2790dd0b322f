//! The skeleton animation of a file, for any skeleton.

use glam::{DQuat, DVec3};

/// An animation of named nodes. The transform of each node is relative to its parent.
#[derive(Clone, Debug)]
pub(crate) struct Clip {
    /// The nodes in an order in which every parent comes before its children.
    pub(crate) nodes: Vec<Node>,
    /// The number of frames, at least 1.
    pub(crate) frames: usize,
    /// The time from one frame to the next: positive, but it may be 0 if there is only one frame.
    pub(crate) seconds_per_frame: f64,
}

/// One node of a clip. `translations`, `rotations` and `scales` have one entry for each frame, or a single entry if they
/// do not change over time.
#[derive(Clone, Debug)]
pub(crate) struct Node {
    /// The name in the file. The end sites of a BVH are nodes too and are called [`END_SITE`].
    pub(crate) name: String,
    pub(crate) parent: Option<usize>,
    /// The position in the rest pose, relative to the parent.
    pub(crate) rest: DVec3,
    pub(crate) translations: Vec<DVec3>,
    pub(crate) rotations: Vec<DQuat>,
    pub(crate) scales: Vec<DVec3>,
}

/// The name of a node that only marks the end of a limb.
pub(crate) const END_SITE: &str = "End Site";

/// The position and rotation of a node in the world.
#[derive(Clone, Copy, Debug)]
pub(crate) struct NodePose {
    /// The position in the file's units.
    pub(crate) position: DVec3,
    /// The rotation in the world. Scales do not affect it.
    pub(crate) rotation: DQuat,
    scale: DVec3,
}

impl Clip {
    /// Returns the world positions of all nodes at a time, in the file's units.
    pub(crate) fn positions(&self, seconds: f64) -> Vec<DVec3> {
        let poses = self.node_poses(seconds).into_iter();
        poses.map(|pose| pose.position).collect()
    }

    /// Returns the world positions and rotations of all nodes at a time.
    ///
    /// Between two frames, rotations are interpolated along the shortest arc.
    pub(crate) fn node_poses(&self, seconds: f64) -> Vec<NodePose> {
        let last = (self.frames - 1) as f64;
        let frame = match self.seconds_per_frame > 0.0 {
            true => (seconds / self.seconds_per_frame).clamp(0.0, last),
            false => 0.0,
        };
        let (first, part) = (frame.floor() as usize, frame.fract());
        let mut poses: Vec<NodePose> = Vec::with_capacity(self.nodes.len());
        for node in &self.nodes {
            let (here, next) = frame_pair(&node.translations, first);
            let translation = here.lerp(next, part);
            let (here, next) = frame_pair(&node.rotations, first);
            let rotation = here.slerp(next, part);
            let (here, next) = frame_pair(&node.scales, first);
            let scale = here.lerp(next, part);
            poses.push(match node.parent.map(|parent| poses[parent]) {
                None => NodePose {
                    position: translation,
                    rotation,
                    scale,
                },
                Some(parent) => NodePose {
                    position: parent.position + parent.rotation * (parent.scale * translation),
                    rotation: parent.rotation * rotation,
                    scale: parent.scale * scale,
                },
            });
        }
        poses
    }

    /// Returns the world positions of all nodes in the rest pose, without any rotation, in the file's units.
    pub(crate) fn rest_positions(&self) -> Vec<DVec3> {
        let mut places: Vec<DVec3> = Vec::with_capacity(self.nodes.len());
        for node in &self.nodes {
            let parent = node.parent.map_or(DVec3::ZERO, |parent| places[parent]);
            places.push(parent + node.rest);
        }
        places
    }

    /// Returns the nodes on the path from a node to the root, the node itself first.
    pub(crate) fn ancestors(&self, node: usize) -> impl Iterator<Item = usize> + '_ {
        std::iter::successors(Some(node), |&node| self.nodes[node].parent)
    }

    /// Returns whether a node is `ancestor` itself or one of its descendants.
    pub(crate) fn is_at_or_below(&self, node: usize, ancestor: usize) -> bool {
        // Parents come before their children, so indices below the ancestor's cannot contain it.
        self.ancestors(node)
            .take_while(|&node| node >= ancestor)
            .any(|node| node == ancestor)
    }

    /// Returns the direct children of a node.
    pub(crate) fn children(&self, node: usize) -> impl Iterator<Item = usize> + '_ {
        (node + 1..self.nodes.len()).filter(move |&child| self.nodes[child].parent == Some(node))
    }
}

/// Returns the entries of a frame and of the next frame.
fn frame_pair<T: Copy>(entries: &[T], frame: usize) -> (T, T) {
    let last = entries.len() - 1;
    (entries[frame.min(last)], entries[(frame + 1).min(last)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::FRAC_PI_2;

    fn node(parent: Option<usize>, rest: DVec3, rotations: Vec<DQuat>) -> Node {
        Node {
            name: String::new(),
            parent,
            rest,
            translations: vec![rest],
            rotations,
            scales: vec![DVec3::ONE],
        }
    }

    #[test]
    fn between_frames_a_limb_swings_on_its_arc() {
        let swing = vec![DQuat::IDENTITY, DQuat::from_rotation_z(FRAC_PI_2)];
        let clip = Clip {
            nodes: vec![
                node(None, DVec3::Y, swing),
                node(Some(0), DVec3::X, vec![DQuat::IDENTITY]),
            ],
            frames: 2,
            seconds_per_frame: 0.1,
        };
        let half = 0.5f64.sqrt();
        for (seconds, place) in [
            (0.0, DVec3::new(1.0, 1.0, 0.0)),
            (0.05, DVec3::new(half, 1.0 + half, 0.0)),
            (0.1, DVec3::new(0.0, 2.0, 0.0)),
            (9.0, DVec3::new(0.0, 2.0, 0.0)),
        ] {
            assert!(clip.positions(seconds)[1].abs_diff_eq(place, 1e-12));
        }
        assert_eq!(clip.rest_positions()[1], DVec3::new(1.0, 1.0, 0.0));
        assert!(clip.is_at_or_below(1, 0) && !clip.is_at_or_below(0, 1));
    }
}
