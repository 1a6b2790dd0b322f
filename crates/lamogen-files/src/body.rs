//! From the nodes of any skeleton to the 22 joints.

use glam::{DQuat, DVec3};
use lamogen_motion::{JOINTS, Joint};

use crate::clip::Clip;
use crate::schemes::Nodes;

/// How far along the spine its joints are, from the pelvis (0) to the neck (1), on the body of
/// HumanML3D.
const SPINE: [(Joint, f64); 3] = [
    (Joint::Spine1, 0.239),
    (Joint::Spine2, 0.498),
    (Joint::Spine3, 0.602),
];
/// From neck to head, where that from pelvis to neck is 1.
const HEAD: f64 = 0.187;
/// From upper spine to neck, where that from upper spine to head is 1.
const NECK: f64 = 0.68;
/// A collar seen from the upper spine: this part of the way to the shoulder and that of the way to the
/// neck. Fitted to HumanML3D's body in motion, right to 3 cm.
const COLLAR: [f64; 2] = [0.365, 0.36];
/// From ankle to foot, where that from knee to ankle is 1.
const FOOT: f64 = 0.33;
/// How much of a foot without any joint goes forward, and how much goes on along the shin.
const FOOT_FORWARD: [f64; 2] = [0.9, 0.43];
/// Joints nearer to each other than this part of the leg are at one place: such a bone has no
/// direction. Some files have them as mere handles.
const SAME_PLACE: f64 = 0.01;

/// A human body among the nodes of a clip, whatever its other nodes are.
///
/// Joints that the file lacks, or that are at the same place as the joint they hang from, are placed:
/// - **spine**: what lies between pelvis and neck. Three nodes are the three joints; of any other number
///   the joints are put on the line through them, where they are on HumanML3D's body;
/// - **neck**: on the way from the upper spine to the head; **head**: on from the neck, towards the end
///   of the neck if the file has one;
/// - **collar**: between upper spine, neck and shoulder;
/// - **foot**: from the ankle towards the end of the foot, at most as far as the ball of the foot is; without
///   an end, forward.
pub(crate) struct Body {
    nodes: Nodes,
    /// The line of the spine: pelvis, what is between, neck or head.
    spine: Vec<usize>,
    /// Ends of the left and the right foot and of the neck, where joints are missing.
    foot_ends: [Option<usize>; 2],
    neck_end: Option<usize>,
}

const FEET: [(Joint, Joint, Joint); 2] = [
    (Joint::LeftKnee, Joint::LeftAnkle, Joint::LeftFoot),
    (Joint::RightKnee, Joint::RightAnkle, Joint::RightFoot),
];
const COLLARS: [(Joint, Joint); 2] = [
    (Joint::LeftCollar, Joint::LeftShoulder),
    (Joint::RightCollar, Joint::RightShoulder),
];

impl Body {
    /// The body of a clip, some of whose nodes are joints.
    ///
    /// # Panics
    ///
    /// If a required joint has no node.
    pub(crate) fn new(clip: &Clip, nodes: Nodes) -> Body {
        let places = clip.positions(0.0);
        let node = |nodes: &Nodes, joint: Joint| nodes[joint.index()];
        let required = |joint: Joint| places[nodes[joint.index()].expect("a required joint")];
        let leg = required(Joint::LeftHip).distance(required(Joint::LeftKnee))
            + required(Joint::LeftKnee).distance(required(Joint::LeftAnkle));
        let same = |a: usize, b: usize| places[a].distance(places[b]) <= SAME_PLACE * leg;
        let farthest_child = |node: usize| {
            let far = |child: &usize| places[*child].distance(places[node]);
            let children = clip.children(node).filter(|&child| !same(child, node));
            children.max_by(|a, b| far(a).total_cmp(&far(b)))
        };
        let mut nodes = nodes;

        // A neck that is a handle at the chest gives way to the next node towards the head.
        if let Some(neck) = node(&nodes, Joint::Neck)
            && let Some(chest) = clip.nodes[neck].parent
            && same(neck, chest)
        {
            let head = node(&nodes, Joint::Head);
            let towards_head = head
                .into_iter()
                .flat_map(|head| clip.ancestors(head).skip(1));
            let between: Vec<usize> = towards_head.take_while(|&above| above != neck).collect();
            nodes[Joint::Neck.index()] = match head {
                Some(_) => between.into_iter().rev().find(|&above| !same(above, chest)),
                None => Some(neck),
            };
        }
        for (collar, shoulder) in COLLARS {
            if let (Some(c), Some(s)) = (node(&nodes, collar), node(&nodes, shoulder))
                && (same(c, s) || clip.nodes[c].parent.is_some_and(|parent| same(c, parent)))
            {
                nodes[collar.index()] = None;
            }
        }
        for (_, ankle, foot) in FEET {
            if let (Some(a), Some(f)) = (node(&nodes, ankle), node(&nodes, foot))
                && same(a, f)
            {
                nodes[foot.index()] = None;
            }
        }

        let pelvis = node(&nodes, Joint::Pelvis).expect("a required joint");
        let top = node(&nodes, Joint::Neck).or(node(&nodes, Joint::Head));
        let top = top.expect("head or neck is required");
        let mut spine = vec![top];
        for above in clip.ancestors(top).skip(1) {
            // The way down ends at the pelvis, or where it parts from the way to the pelvis.
            if clip.hangs_from(pelvis, above) {
                break;
            }
            spine.push(above);
        }
        spine.push(pelvis);
        spine.reverse();
        spine.dedup_by(|next, before| same(*next, *before));
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

        let ends = |joint: Joint, end_of: Joint| match node(&nodes, joint) {
            Some(_) => None,
            None => node(&nodes, end_of).and_then(farthest_child),
        };
        Body {
            foot_ends: FEET.map(|(_, ankle, foot)| ends(foot, ankle)),
            neck_end: ends(Joint::Head, Joint::Neck),
            nodes,
            spine,
        }
    }

    /// The joints that have no node of their own and are placed.
    pub(crate) fn placed(&self) -> Vec<Joint> {
        let joints = Joint::ALL.into_iter();
        joints
            .filter(|joint| self.nodes[joint.index()].is_none())
            .collect()
    }

    /// The way from ankle to hip, on the mean of both sides, and from pelvis along the spine to the
    /// head: what a human is known by, whatever the pose.
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

    /// The joints, where all nodes are known.
    pub(crate) fn pose(&self, positions: &[DVec3]) -> [DVec3; JOINTS] {
        let mut pose = [DVec3::ZERO; JOINTS];
        for joint in Joint::ALL {
            if let Some(node) = self.nodes[joint.index()] {
                pose[joint.index()] = positions[node];
            }
        }
        let lacks = |joint: Joint| self.nodes[joint.index()].is_none();
        let line = Line::new(self.spine.iter().map(|&node| positions[node]));
        // The line ends at the neck, or else at the head.
        let neck = match lacks(Joint::Neck) {
            true => 1.0 / (1.0 + HEAD),
            false => 1.0,
        };
        for (joint, part) in SPINE {
            if lacks(joint) {
                pose[joint.index()] = line.at(part * neck);
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

    /// How every joint is turned in the frame of the joint that it hangs from, and the pelvis in the world, where it is known
    /// how all nodes are turned in the world: quaternions `[x, y, z, w]`. Joints that the file lacks are turned as the one that
    /// they hang from. What nodes in between turn is part of the joint below them.
    pub(crate) fn turns(&self, turns: &[DQuat]) -> [[f64; 4]; JOINTS] {
        let mut global = [DQuat::IDENTITY; JOINTS];
        Joint::ALL.map(|joint| {
            let above = joint
                .parent()
                .map_or(DQuat::IDENTITY, |p| global[p.index()]);
            let turn = self.nodes[joint.index()].map_or(above, |node| turns[node]);
            global[joint.index()] = turn;
            (above.conjugate() * turn).to_array()
        })
    }

    /// Where the pelvis faces.
    fn forward(&self, pose: &[DVec3; JOINTS]) -> DVec3 {
        let left = pose[Joint::LeftHip.index()] - pose[Joint::RightHip.index()];
        let up = pose[Joint::Spine1.index()] - pose[Joint::Pelvis.index()];
        left.cross(up)
    }
}

/// A line through points.
struct Line(Vec<DVec3>);

impl Line {
    fn new(points: impl Iterator<Item = DVec3>) -> Line {
        Line(points.collect())
    }

    fn length(&self) -> f64 {
        self.0
            .windows(2)
            .map(|pair| pair[0].distance(pair[1]))
            .sum()
    }

    /// The point at a part of the length, from 0 to 1.
    fn at(&self, part: f64) -> DVec3 {
        let mut left = part * self.length();
        for pair in self.0.windows(2) {
            let bone = pair[0].distance(pair[1]);
            if left < bone {
                return pair[0].lerp(pair[1], left / bone);
            }
            left -= bone;
        }
        self.0.last().copied().unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_walked_by_its_length() {
        let line =
            Line::new([DVec3::ZERO, DVec3::X, DVec3::X, DVec3::new(1.0, 3.0, 0.0)].into_iter());
        assert_eq!(line.length(), 4.0);
        assert_eq!(line.at(0.0), DVec3::ZERO);
        assert_eq!(line.at(0.5), DVec3::new(1.0, 1.0, 0.0));
        assert_eq!(line.at(1.0), DVec3::new(1.0, 3.0, 0.0));
    }
}
