//! Computation of the 22 joints from the nodes of any skeleton.

use glam::{DQuat, DVec3};
use lamogen_motion::{JOINTS, Joint};

use crate::clip::Clip;
use crate::schemes::JointNodes;

/// The positions of the spine joints along the spine, from the pelvis (0) to the neck (1), on the body of HumanML3D.
const SPINE: [(Joint, f64); 3] = [
    (Joint::Spine1, 0.239),
    (Joint::Spine2, 0.498),
    (Joint::Spine3, 0.602),
];
/// The length from neck to head, relative to the length from pelvis to neck.
const HEAD: f64 = 0.187;
/// The length from the upper spine to the neck, relative to the length from the upper spine to the head.
const NECK: f64 = 0.68;
/// The position of a collar relative to the upper spine: the first number times the vector to the shoulder, plus the
/// second number times the vector to the neck. The numbers are fitted to HumanML3D's body in motion and are accurate
/// to 3 cm.
const COLLAR: [f64; 2] = [0.365, 0.36];
/// The length from ankle to foot, relative to the length from knee to ankle.
const FOOT: f64 = 0.33;
/// The direction of a foot that has no node: its components forward and along the shin.
const FOOT_FORWARD: [f64; 2] = [0.9, 0.43];
/// The distance below which two joints count as being at the same position, relative to the length of the leg. A bone
/// between them has no direction. Some files have such joints only as handles for animators.
const SAME_PLACE: f64 = 0.01;

/// A human body, as a mapping from its joints to nodes of a clip. The clip may have other nodes too.
///
/// Joints that the file lacks, or that are at the same position as their parent, are placed:
/// - **spine**: if there are exactly three nodes between pelvis and neck, they are the three joints; otherwise the
///   joints are put on the line through these nodes, at the same fractions of its length as on HumanML3D's body;
/// - **neck**: on the line from the upper spine to the head; **head**: beyond the neck, towards the end of the neck if
///   the file has one;
/// - **collar**: between upper spine, neck and shoulder;
/// - **foot**: from the ankle towards the end of the foot, at most as far as the ball of the foot; forward if the file
///   has no end of the foot.
pub(crate) struct MappedBody {
    nodes: JointNodes,
    /// The nodes of the spine: the pelvis, the nodes between, and the neck or else the head.
    spine: Vec<usize>,
    /// The nodes at the ends of the left and the right foot, if the foot has no node of its own.
    foot_ends: [Option<usize>; 2],
    /// The node at the end of the neck, if the head has no node of its own.
    neck_end: Option<usize>,
}

/// Knee, ankle and foot of the left and the right leg.
const FEET: [(Joint, Joint, Joint); 2] = [
    (Joint::LeftKnee, Joint::LeftAnkle, Joint::LeftFoot),
    (Joint::RightKnee, Joint::RightAnkle, Joint::RightFoot),
];
/// Collar and shoulder of the left and the right arm.
const COLLARS: [(Joint, Joint); 2] = [
    (Joint::LeftCollar, Joint::LeftShoulder),
    (Joint::RightCollar, Joint::RightShoulder),
];

impl MappedBody {
    /// Creates the body of a clip from the nodes that are known to be joints.
    ///
    /// # Panics
    ///
    /// If a required joint has no node.
    pub(crate) fn new(clip: &Clip, nodes: JointNodes) -> MappedBody {
        let positions = clip.positions(0.0);
        let node = |nodes: &JointNodes, joint: Joint| nodes[joint.index()];
        let required = |joint: Joint| positions[nodes[joint.index()].expect("a required joint")];
        let leg = required(Joint::LeftHip).distance(required(Joint::LeftKnee))
            + required(Joint::LeftKnee).distance(required(Joint::LeftAnkle));
        let coincide = |a: usize, b: usize| positions[a].distance(positions[b]) <= SAME_PLACE * leg;
        let farthest_child = |node: usize| {
            let distance = |child: &usize| positions[*child].distance(positions[node]);
            let children = clip.children(node).filter(|&child| !coincide(child, node));
            children.max_by(|a, b| distance(a).total_cmp(&distance(b)))
        };
        let mut nodes = nodes;

        // A neck at the same position as the chest is only a handle: use the next node towards the head instead.
        if let Some(neck) = node(&nodes, Joint::Neck)
            && let Some(chest) = clip.nodes[neck].parent
            && coincide(neck, chest)
        {
            let head = node(&nodes, Joint::Head);
            let towards_head = head
                .into_iter()
                .flat_map(|head| clip.ancestors(head).skip(1));
            let between: Vec<usize> = towards_head.take_while(|&above| above != neck).collect();
            nodes[Joint::Neck.index()] = match head {
                Some(_) => between
                    .into_iter()
                    .rev()
                    .find(|&above| !coincide(above, chest)),
                None => Some(neck),
            };
        }
        for (collar, shoulder) in COLLARS {
            if let (Some(c), Some(s)) = (node(&nodes, collar), node(&nodes, shoulder))
                && (coincide(c, s)
                    || clip.nodes[c]
                        .parent
                        .is_some_and(|parent| coincide(c, parent)))
            {
                nodes[collar.index()] = None;
            }
        }
        for (_, ankle, foot) in FEET {
            if let (Some(a), Some(f)) = (node(&nodes, ankle), node(&nodes, foot))
                && coincide(a, f)
            {
                nodes[foot.index()] = None;
            }
        }

        let pelvis = node(&nodes, Joint::Pelvis).expect("a required joint");
        let top = node(&nodes, Joint::Neck).or(node(&nodes, Joint::Head));
        let top = top.expect("head or neck is required");
        let mut spine = vec![top];
        for above in clip.ancestors(top).skip(1) {
            // Stop at the pelvis or at the first common ancestor with it.
            if clip.is_at_or_below(pelvis, above) {
                break;
            }
            spine.push(above);
        }
        spine.push(pelvis);
        spine.reverse();
        spine.dedup_by(|next, before| coincide(*next, *before));
        if spine.last() != Some(&top) {
            spine.pop();
            spine.push(top);
        }
        let named = SPINE
            .iter()
            .any(|(joint, _)| node(&nodes, *joint).is_some());
        if let ([_, between @ .., _], false) = (&spine[..], named)
            && between.len() == SPINE.len()
        {
            for (&(joint, _), &between) in SPINE.iter().zip(between) {
                nodes[joint.index()] = Some(between);
            }
        }

        let end_node = |joint: Joint, parent: Joint| match node(&nodes, joint) {
            Some(_) => None,
            None => node(&nodes, parent).and_then(farthest_child),
        };
        MappedBody {
            foot_ends: FEET.map(|(_, ankle, foot)| end_node(foot, ankle)),
            neck_end: end_node(Joint::Head, Joint::Neck),
            nodes,
            spine,
        }
    }

    /// Returns the joints that have no node of their own and are placed.
    pub(crate) fn placed_joints(&self) -> Vec<Joint> {
        let joints = Joint::ALL.into_iter();
        joints
            .filter(|joint| self.nodes[joint.index()].is_none())
            .collect()
    }

    /// Returns the size of the body, which does not depend on the pose: the length from ankle over knee to hip, as the
    /// mean of both sides, plus the length from the pelvis along the spine to the head.
    pub(crate) fn size(&self, positions: &[DVec3]) -> f64 {
        let pose = self.pose(positions);
        let bone = |a: Joint, b: Joint| pose[a.index()].distance(pose[b.index()]);
        use Joint::*;
        let legs = bone(LeftHip, LeftKnee)
            + bone(LeftKnee, LeftAnkle)
            + bone(RightHip, RightKnee)
            + bone(RightKnee, RightAnkle);
        let spine = [Pelvis, Spine1, Spine2, Spine3, Neck, Head];
        let spine: f64 = spine.windows(2).map(|pair| bone(pair[0], pair[1])).sum();
        legs / 2.0 + spine
    }

    /// Computes the positions of the joints from the positions of all nodes.
    pub(crate) fn pose(&self, positions: &[DVec3]) -> [DVec3; JOINTS] {
        let mut pose = [DVec3::ZERO; JOINTS];
        for joint in Joint::ALL {
            if let Some(node) = self.nodes[joint.index()] {
                pose[joint.index()] = positions[node];
            }
        }
        let lacks = |joint: Joint| self.nodes[joint.index()].is_none();
        let line = Polyline::new(self.spine.iter().map(|&node| positions[node]));
        // The line ends at the neck, or at the head if there is no neck.
        let neck_part = match lacks(Joint::Neck) {
            true => 1.0 / (1.0 + HEAD),
            false => 1.0,
        };
        for (joint, part) in SPINE {
            if lacks(joint) {
                pose[joint.index()] = line.point_at(part * neck_part);
            }
        }
        let spine3 = pose[Joint::Spine3.index()];
        if lacks(Joint::Neck) {
            pose[Joint::Neck.index()] = spine3.lerp(pose[Joint::Head.index()], NECK);
        }
        let neck = pose[Joint::Neck.index()];
        if lacks(Joint::Head) {
            let towards = self
                .neck_end
                .map_or(neck - spine3, |end| positions[end] - neck);
            pose[Joint::Head.index()] = neck + towards.normalize_or_zero() * HEAD * line.length();
        }
        for (collar, shoulder) in COLLARS {
            if lacks(collar) {
                let to_shoulder = pose[shoulder.index()] - spine3;
                pose[collar.index()] =
                    spine3 + COLLAR[0] * to_shoulder + COLLAR[1] * (neck - spine3);
            }
        }
        for ((knee, ankle, foot), end) in FEET.into_iter().zip(self.foot_ends) {
            if lacks(foot) {
                let shin = pose[ankle.index()] - pose[knee.index()];
                let length = FOOT * shin.length();
                let to_foot = match end {
                    Some(end) => (positions[end] - pose[ankle.index()]).clamp_length_max(length),
                    None => {
                        let down = shin.normalize_or_zero();
                        let forward = self
                            .forward(&pose)
                            .reject_from_normalized(down)
                            .normalize_or_zero();
                        length * (FOOT_FORWARD[0] * forward + FOOT_FORWARD[1] * down)
                    }
                };
                pose[foot.index()] = pose[ankle.index()] + to_foot;
            }
        }
        pose
    }

    /// Computes the rotation of each joint relative to its parent joint, and of the pelvis in the world, from the world
    /// rotations of all nodes: quaternions `[x, y, z, w]`. Joints that the file lacks have the world rotation of their
    /// parent. Rotations of nodes between two joints belong to the lower joint.
    pub(crate) fn local_rotations(&self, rotations: &[DQuat]) -> [[f64; 4]; JOINTS] {
        let mut global = [DQuat::IDENTITY; JOINTS];
        Joint::ALL.map(|joint| {
            let above = joint
                .parent()
                .map_or(DQuat::IDENTITY, |p| global[p.index()]);
            let rotation = self.nodes[joint.index()].map_or(above, |node| rotations[node]);
            global[joint.index()] = rotation;
            (above.conjugate() * rotation).to_array()
        })
    }

    /// Returns the direction that the front of the pelvis faces; its length is arbitrary.
    fn forward(&self, pose: &[DVec3; JOINTS]) -> DVec3 {
        let left = pose[Joint::LeftHip.index()] - pose[Joint::RightHip.index()];
        let up = pose[Joint::Spine1.index()] - pose[Joint::Pelvis.index()];
        left.cross(up)
    }
}

/// A line of straight segments through points.
struct Polyline(Vec<DVec3>);

impl Polyline {
    fn new(points: impl Iterator<Item = DVec3>) -> Polyline {
        Polyline(points.collect())
    }

    fn length(&self) -> f64 {
        self.0
            .windows(2)
            .map(|pair| pair[0].distance(pair[1]))
            .sum()
    }

    /// Returns the point at a fraction of the length, from 0 to 1.
    fn point_at(&self, part: f64) -> DVec3 {
        let mut remaining = part * self.length();
        for pair in self.0.windows(2) {
            let bone = pair[0].distance(pair[1]);
            if remaining < bone {
                return pair[0].lerp(pair[1], remaining / bone);
            }
            remaining -= bone;
        }
        self.0.last().copied().unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_on_a_polyline_are_found_by_its_length() {
        let line =
            Polyline::new([DVec3::ZERO, DVec3::X, DVec3::X, DVec3::new(1.0, 3.0, 0.0)].into_iter());
        assert_eq!(line.length(), 4.0);
        assert_eq!(line.point_at(0.0), DVec3::ZERO);
        assert_eq!(line.point_at(0.5), DVec3::new(1.0, 1.0, 0.0));
        assert_eq!(line.point_at(1.0), DVec3::new(1.0, 3.0, 0.0));
    }
}
