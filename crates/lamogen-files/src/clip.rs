//! A skeleton animation as a file holds it, whatever its skeleton.

use glam::{DQuat, DVec3};

/// Named nodes that move, each seen from its parent.
#[derive(Clone, Debug)]
pub(crate) struct Clip {
    /// Parents stand before their children.
    pub(crate) nodes: Vec<Node>,
    /// At least one.
    pub(crate) frames: usize,
    /// Positive, but for a single frame, where it may be 0.
    pub(crate) seconds_per_frame: f64,
}

/// One node of a clip. What does not change over time has one entry, else one for every frame.
#[derive(Clone, Debug)]
pub(crate) struct Node {
    /// As the file has it. The ends of a BVH's limbs are nodes, too, and called [`END_SITE`].
    pub(crate) name: String,
    pub(crate) parent: Option<usize>,
    /// Where the node is in the rest pose, seen from its parent.
    pub(crate) rest: DVec3,
    pub(crate) translations: Vec<DVec3>,
    pub(crate) rotations: Vec<DQuat>,
    pub(crate) scale: DVec3,
}

/// Name of a node that only says where a limb ends.
pub(crate) const END_SITE: &str = "End Site";

/// A node in the world.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Placed {
    /// Where it is, in the file's units.
    pub(crate) position: DVec3,
    /// How it is turned. Scales, which are no turns, play no part.
    pub(crate) turn: DQuat,
    scale: DVec3,
}

impl Clip {
    /// Where all nodes are after some seconds, in the file's units.
    pub(crate) fn positions(&self, seconds: f64) -> Vec<DVec3> {
        let placed = self.placed(seconds).into_iter();
        placed.map(|node| node.position).collect()
    }

    /// Where all nodes are after some seconds, and how they are turned. Between two frames rotations
    /// take the shortest way.
    pub(crate) fn placed(&self, seconds: f64) -> Vec<Placed> {
        let last = (self.frames - 1) as f64;
        let frame = match self.seconds_per_frame > 0.0 {
            true => (seconds / self.seconds_per_frame).clamp(0.0, last),
            false => 0.0,
        };
        let (first, part) = (frame.floor() as usize, frame.fract());
        let mut placed: Vec<Placed> = Vec::with_capacity(self.nodes.len());
        for node in &self.nodes {
            let (here, next) = neighbours(&node.translations, first);
            let shift = here.lerp(next, part);
            let (here, next) = neighbours(&node.rotations, first);
            let turn = here.slerp(next, part);
            placed.push(match node.parent.map(|parent| placed[parent]) {
                None => Placed {
                    position: shift,
                    turn,
                    scale: node.scale,
                },
                Some(above) => Placed {
                    position: above.position + above.turn * (above.scale * shift),
                    turn: above.turn * turn,
                    scale: above.scale * node.scale,
                },
            });
        }
        placed
    }

    /// Where all nodes are in the rest pose, without any rotation, in the file's units.
    pub(crate) fn rest_positions(&self) -> Vec<DVec3> {
        let mut places: Vec<DVec3> = Vec::with_capacity(self.nodes.len());
        for node in &self.nodes {
            let parent = node.parent.map_or(DVec3::ZERO, |parent| places[parent]);
            places.push(parent + node.rest);
        }
        places
    }

    /// The nodes from one to the root, itself first.
    pub(crate) fn ancestors(&self, node: usize) -> impl Iterator<Item = usize> + '_ {
        std::iter::successors(Some(node), |&node| self.nodes[node].parent)
    }

    /// Whether a node hangs from another, or is it.
    pub(crate) fn hangs_from(&self, node: usize, ancestor: usize) -> bool {
        // Parents stand before their children: past the ancestor's place there is nothing to find.
        self.ancestors(node)
            .take_while(|&above| above >= ancestor)
            .any(|above| above == ancestor)
    }

    /// The nodes that hang directly from a node.
    pub(crate) fn children(&self, node: usize) -> impl Iterator<Item = usize> + '_ {
        (node + 1..self.nodes.len()).filter(move |&child| self.nodes[child].parent == Some(node))
    }
}

/// The entry of a frame and that of the next.
fn neighbours<T: Copy>(entries: &[T], frame: usize) -> (T, T) {
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
            scale: DVec3::ONE,
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
        assert!(clip.hangs_from(1, 0) && !clip.hangs_from(0, 1));
    }
}
