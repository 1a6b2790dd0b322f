//! The parts of a body that hands touch, on the body of a motion and on that of a character.

use glam::{DQuat, DVec3};
use lamogen_motion::{ARMS, JOINTS, Joint, RestPose};

use crate::retarget::{CharacterPose, Retargeter};
use crate::skeleton::CharacterSkeleton;

/// Trunk widths of characters are at most this many times smaller or larger than the lengths of their trunks say. Where rigs have
/// the joints of hips and shoulders differs more than bodies do.
const MAX_WIDTH: f64 = 1.6;

/// The positions and rotations of the joints of a motion's body in the world at one frame.
pub(crate) struct SourcePose {
    pub(crate) positions: [DVec3; JOINTS],
    pub(crate) turns: [DQuat; JOINTS],
}

/// A part of the body: a rounded solid about the line between joints.
#[derive(Clone, Debug)]
pub(crate) struct BodyPart {
    /// The joints at whose mean position the line starts, and those at which it ends.
    ends: [Vec<Joint>; 2],
    /// The joints whose rotations the part has at the ends of the line.
    turned_by: [Joint; 2],
    /// The position of the middle of the part relative to the line, in the rest pose of the motion's body, in metres.
    middle: DVec3,
    /// How far the surface is from the middle along the axes of the rest pose, in metres.
    radii: DVec3,
    /// The size of the character's part along the same axes at both ends of the line, in units of that of the motion's body.
    scales: [DVec3; 2],
    /// The arm whose own hand cannot touch the part: 0 is the left one.
    pub(crate) arm: Option<usize>,
}

/// A place at a part of the body, independent of the pose.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PartPlace {
    /// The place along the line, from 0 to 1.
    along: f64,
    /// The distance of this place from the start of the line, in metres.
    height: f64,
    /// The position relative to this place on the line in the rest pose, in metres.
    offset: DVec3,
    /// The distance from the surface in metres, which is less than 0 inside.
    pub(crate) distance: f64,
}

/// Returns the parts that hands touch: trunk, head, thighs and arms.
pub(crate) fn body_parts(retargeter: &Retargeter<'_>) -> Vec<BodyPart> {
    let skeleton = retargeter.skeleton;
    let sizes = BodySizes::new(skeleton, &retargeter.source_rest);
    let unit = sizes.unit;
    let girth = |x: f64| DVec3::new(x, sizes.trunk, (x * sizes.trunk).sqrt());
    let neck = neck_joints(skeleton);
    let mut parts = vec![BodyPart {
        ends: [vec![Joint::LeftHip, Joint::RightHip], neck.to_vec()],
        turned_by: [Joint::Pelvis, Joint::Spine3],
        middle: DVec3::ZERO,
        radii: DVec3::new(0.16, 0.12, 0.11) * unit,
        scales: [girth(sizes.hips), girth(sizes.shoulders)],
        arm: None,
    }];
    if skeleton.joint(Joint::Head).is_some() {
        parts.push(BodyPart {
            ends: [vec![Joint::Head], vec![Joint::Head]],
            turned_by: [Joint::Head; 2],
            middle: DVec3::new(0.0, 0.07, 0.03) * unit,
            radii: DVec3::new(0.085, 0.13, 0.1) * unit,
            scales: [DVec3::splat(sizes.head); 2],
            arm: None,
        });
    }
    let mut limb = |joints: [Joint; 2], radius: f64, scale: f64, arm: Option<usize>| {
        parts.push(BodyPart {
            ends: joints.map(|joint| vec![joint]),
            turned_by: [joints[0]; 2],
            middle: DVec3::ZERO,
            radii: DVec3::splat(radius * unit),
            scales: [DVec3::splat(scale); 2],
            arm,
        });
    };
    limb([Joint::LeftHip, Joint::LeftKnee], 0.07, sizes.hips, None);
    limb([Joint::RightHip, Joint::RightKnee], 0.07, sizes.hips, None);
    for (arm, [shoulder, elbow, wrist]) in ARMS.into_iter().enumerate() {
        limb([shoulder, elbow], 0.045, sizes.arms, Some(arm));
        limb([elbow, wrist], 0.035, sizes.arms, Some(arm));
    }
    parts
}

/// Returns the joints that are at the upper end of the trunk of both bodies.
fn neck_joints(skeleton: &CharacterSkeleton) -> &'static [Joint] {
    match skeleton.joint(Joint::Neck) {
        Some(_) => &[Joint::Neck],
        None => &[Joint::LeftShoulder, Joint::RightShoulder],
    }
}

/// The sizes of the parts of a character in units of those of the motion's body.
struct BodySizes {
    trunk: f64,
    /// The width of the hips. How far apart the joints of the legs are says little of it, so trunk and shoulders count as much.
    hips: f64,
    shoulders: f64,
    head: f64,
    /// The thickness of the arms.
    arms: f64,
    /// The size of the motion's body in units of HumanML3D's.
    unit: f64,
}

impl BodySizes {
    fn new(skeleton: &CharacterSkeleton, source: &[DVec3; JOINTS]) -> BodySizes {
        let neck = neck_joints(skeleton);
        let hips = [Joint::LeftHip, Joint::RightHip];
        let own = |joint: Joint| skeleton.rest_position(joint).expect("a joint of the body");
        let theirs = |joint: Joint| source[joint.index()];
        let ratio = |from: &[Joint], to: &[Joint]| {
            let own = mean(from, own).distance(mean(to, own));
            let theirs = mean(from, theirs).distance(mean(to, theirs));
            own / theirs
        };
        let trunk = ratio(&hips, neck);
        let width = |joints: [Joint; 2]| {
            let width = ratio(&joints[..1], &joints[1..]);
            width.clamp(trunk / MAX_WIDTH, trunk * MAX_WIDTH)
        };
        let shoulders = width([Joint::LeftShoulder, Joint::RightShoulder]);
        let arm = |[shoulder, elbow, wrist]: [Joint; 3]| {
            let [upper, lower] = [ratio(&[shoulder], &[elbow]), ratio(&[elbow], &[wrist])];
            (upper + lower) / 2.0
        };
        let arm = ARMS.map(arm).iter().sum::<f64>() / 2.0;
        let mut adult = [DVec3::ZERO; JOINTS];
        let rest = RestPose::humanml3d();
        for joint in Joint::ALL {
            let parent = joint
                .parent()
                .map_or(DVec3::ZERO, |parent| adult[parent.index()]);
            adult[joint.index()] = parent + DVec3::from(rest.offset(joint).map(f64::from));
        }
        let height = |body: &dyn Fn(Joint) -> DVec3| mean(&hips, body).distance(mean(neck, body));
        BodySizes {
            trunk,
            hips: (width(hips) * shoulders * trunk).cbrt(),
            shoulders,
            head: trunk,
            arms: (trunk * arm).sqrt(),
            unit: height(&theirs) / height(&|joint| adult[joint.index()]),
        }
    }
}

/// Returns the mean position of joints.
fn mean(joints: &[Joint], position: impl Fn(Joint) -> DVec3) -> DVec3 {
    joints.iter().map(|joint| position(*joint)).sum::<DVec3>() / joints.len() as f64
}

impl PartPlace {
    /// Returns how far a point at another place of the same part has moved on the part, in metres.
    pub(crate) fn distance_from(&self, other: &PartPlace) -> f64 {
        (self.height - other.height).hypot(self.offset.distance(other.offset))
    }
}

impl BodyPart {
    /// Returns where a point is at this part of the motion's body.
    pub(crate) fn place_of(&self, point: DVec3, pose: &SourcePose) -> PartPlace {
        let [start, end] = self.source_line(pose);
        let line = end - start;
        let along = match line.length_squared() {
            0.0 => 0.0,
            length => ((point - start).dot(line) / length).clamp(0.0, 1.0),
        };
        let offset = self.source_turn(pose, along).inverse() * (point - start.lerp(end, along));
        let from_middle = offset - self.middle;
        let length = from_middle.length();
        let radius = length / (from_middle / self.radii).length();
        PartPlace {
            along,
            height: along * line.length(),
            offset,
            // At the middle itself there is no direction.
            distance: match radius.is_finite() {
                true => length - radius,
                false => -self.radii.min_element(),
            },
        }
    }

    /// Returns the point of the character's body that corresponds to a place at this part.
    pub(crate) fn point_at(
        &self,
        place: &PartPlace,
        source: &SourcePose,
        pose: &CharacterPose,
        skeleton: &CharacterSkeleton,
    ) -> DVec3 {
        let position = |joint: Joint| {
            let place = skeleton.joint(joint).expect("a joint of the body");
            pose.positions[place]
        };
        let [start, end] = [&self.ends[0], &self.ends[1]].map(|joints| mean(joints, position));
        let [source_start, source_end] = self.source_line(source);
        let source_line = skeleton.facing * (source_end - source_start);
        let lines = [source_line, end - start].map(DVec3::try_normalize);
        let [scale_start, scale_end] = self.scales;
        let offset = scale_start.lerp(scale_end, place.along) * place.offset;
        let offset = skeleton.facing * (self.source_turn(source, place.along) * offset);
        // Legs that were bent, and trunks of another posture, point elsewhere than those of the motion.
        let lean = match lines {
            [Some(from), Some(to)] => DQuat::from_rotation_arc(from, to),
            _ => DQuat::IDENTITY,
        };
        start.lerp(end, place.along) + lean * offset
    }

    fn source_line(&self, pose: &SourcePose) -> [DVec3; 2] {
        let position = |joint: Joint| pose.positions[joint.index()];
        [&self.ends[0], &self.ends[1]].map(|joints| mean(joints, position))
    }

    fn source_turn(&self, pose: &SourcePose, along: f64) -> DQuat {
        let [start, end] = self.turned_by.map(|joint| pose.turns[joint.index()]);
        start.slerp(end, along)
    }
}
