//! Global rotations of every joint at every frame.

use glam::{DMat3, DQuat, DVec3};

use super::fit::fit;
use super::rest::{HUBS, RestPose, SHORTEST};
use super::twist::{Hint, smooth};
use crate::motion::Motion;
use crate::precise::{points, vector};
use crate::skeleton::{JOINTS, Joint};

/// A joint with one child below it, and the child of that: a limb that bends in a plane.
struct Limb {
    /// Shoulder or hip.
    upper: Joint,
    /// Elbow or knee.
    middle: Joint,
    /// Wrist or ankle.
    end: Joint,
}

const LIMBS: [Limb; 4] = [
    Limb {
        upper: Joint::LeftShoulder,
        middle: Joint::LeftElbow,
        end: Joint::LeftWrist,
    },
    Limb {
        upper: Joint::RightShoulder,
        middle: Joint::RightElbow,
        end: Joint::RightWrist,
    },
    Limb {
        upper: Joint::LeftHip,
        middle: Joint::LeftKnee,
        end: Joint::LeftAnkle,
    },
    Limb {
        upper: Joint::RightHip,
        middle: Joint::RightKnee,
        end: Joint::RightAnkle,
    },
];

/// How much a hint on a twist counts, against 1 for turning no further than the bone itself does from
/// frame to frame.
mod weight {
    /// The smallest swing, where nothing else is known: exact.
    pub(super) const SWING: f64 = 1e4;
    /// The bending plane of a limb.
    pub(super) const PLANE: f64 = 100.0;
    /// The smallest swing of a limb that hardly bends: takes over within two seconds.
    pub(super) const STRAIGHT: f64 = 0.001;
}

/// Bends in degrees from which on a limb's plane is known a little, and fully.
const PLANE_FROM: f64 = 10.0;
const PLANE_SURE: f64 = 30.0;

/// What every joint has turned to in the world, frame by frame.
pub(super) fn solve(motion: &Motion, rest: &RestPose) -> Vec<[DQuat; JOINTS]> {
    let poses: Vec<[DVec3; JOINTS]> = motion.joints().iter().map(points).collect();
    let mut global = vec![[DQuat::IDENTITY; JOINTS]; poses.len()];
    for joint in Joint::ALL {
        let turns = Turns {
            poses: &poses,
            rest,
            global: &global,
        };
        let column = turns.of(joint);
        for (pose, turn) in global.iter_mut().zip(column) {
            pose[joint.index()] = turn;
        }
    }
    global
}

/// What is known when a joint's turn comes: all joints above it are solved.
struct Turns<'a> {
    poses: &'a [[DVec3; JOINTS]],
    rest: &'a RestPose,
    global: &'a [[DQuat; JOINTS]],
}

impl Turns<'_> {
    fn of(&self, joint: Joint) -> Vec<DQuat> {
        if let Some(hub) = HUBS.iter().find(|hub| hub.joint == joint) {
            return self.hub(joint, hub.children());
        }
        match joint.children().next() {
            Some(child) => self.bone(joint, child),
            // Head, hands and toes: nothing is known beyond them.
            None => self.parents(joint).collect(),
        }
    }

    /// Turns of the joint above; the T-pose above the pelvis.
    fn parents(&self, joint: Joint) -> impl Iterator<Item = DQuat> + '_ {
        let parent = joint.parent();
        self.global.iter().map(move |pose| match parent {
            Some(parent) => pose[parent.index()],
            None => DQuat::IDENTITY,
        })
    }

    fn offset(&self, joint: Joint) -> DVec3 {
        vector(self.rest.offset(joint))
    }

    /// The best turn for three children at once.
    fn hub(&self, joint: Joint, children: [Joint; 3]) -> Vec<DQuat> {
        let shape = children.map(|child| self.offset(child));
        let mut expected = self.parents(joint).next().unwrap_or_default();
        let turn = |pose: &[DVec3; JOINTS]| {
            let places = children.map(|child| pose[child.index()] - pose[joint.index()]);
            expected = fit(&shape, &places, expected);
            expected
        };
        self.poses.iter().map(turn).collect()
    }

    /// The turn that points one bone the right way, with a twist that is known or carried through.
    fn bone(&self, joint: Joint, child: Joint) -> Vec<DQuat> {
        let parents: Vec<DQuat> = self.parents(joint).collect();
        let Some(rest) = self.offset(child).try_normalize() else {
            return parents;
        };
        // All of this is seen from the parent: a body that turns as a whole twists nothing.
        let bones = self.directions((joint, child), &parents, rest);
        let swings = bones
            .iter()
            .map(|&bone| DQuat::from_rotation_arc(rest, bone));
        let swings: Vec<DQuat> = swings.collect();
        // The first turn, carried along by the bone alone.
        let mut carried: Vec<DQuat> = Vec::with_capacity(bones.len());
        for (frame, &bone) in bones.iter().enumerate() {
            carried.push(match frame.checked_sub(1) {
                None => swings[0],
                Some(before) => {
                    let turn = DQuat::from_rotation_arc(bones[before], bone);
                    (turn * carried[before]).normalize()
                }
            });
        }
        let hint = |frame: usize, turn: DQuat, weight: f64| {
            let between = carried[frame].inverse() * turn;
            Hint {
                angle: 2.0 * between.xyz().dot(rest).atan2(between.w),
                weight,
            }
        };
        let swings = |weight: f64| -> Vec<Hint> {
            let frames = swings.iter().zip(&bones).enumerate();
            let hints = frames
                .map(|(frame, (&swing, &bone))| hint(frame, swing, weight * certainty(rest, bone)));
            hints.collect()
        };
        let twists = match LIMBS.iter().find(|limb| limb.upper == joint) {
            None => smooth(&[&swings(weight::SWING)]),
            Some(limb) => {
                let planes = self.planes(limb, rest, &bones, &parents);
                let planes = planes.into_iter().enumerate();
                let planes: Vec<Hint> = planes
                    .map(|(frame, (turn, sure))| hint(frame, turn, weight::PLANE * sure))
                    .collect();
                bent(&planes, &swings(weight::STRAIGHT))
            }
        };
        let turns = parents.iter().zip(&carried).zip(twists);
        turns
            .map(|((&parent, &turn), twist)| {
                (parent * turn * DQuat::from_axis_angle(rest, twist)).normalize()
            })
            .collect()
    }

    /// Directions of a bone, seen from the parent of the joint where it starts; where it has none it keeps
    /// the one it had, at first that of the T-pose.
    fn directions(
        &self,
        (joint, child): (Joint, Joint),
        parents: &[DQuat],
        rest: DVec3,
    ) -> Vec<DVec3> {
        let mut last = rest;
        let frames = self.poses.iter().zip(parents);
        frames
            .map(|(pose, parent)| {
                let bone = pose[child.index()] - pose[joint.index()];
                if bone.length() > SHORTEST {
                    last = (parent.inverse() * bone).normalize();
                }
                last
            })
            .collect()
    }

    /// The turn of a limb's upper bone that puts the hinge upright on the plane in which the limb bends,
    /// and how sure that plane is, 0 to 1.
    fn planes(
        &self,
        limb: &Limb,
        rest: DVec3,
        bones: &[DVec3],
        parents: &[DQuat],
    ) -> Vec<(DQuat, f64)> {
        let hinge = RestPose::hinge(limb.middle).expect("elbows and knees are hinges");
        let standing = frame(rest, vector(hinge)).transpose();
        let plane = |((pose, parent), &bone): ((&[DVec3; JOINTS], &DQuat), &DVec3)| {
            let lower = pose[limb.end.index()] - pose[limb.middle.index()];
            let lower = (parent.inverse() * lower).normalize_or_zero();
            let normal = bone.cross(lower);
            if normal.length() < 1e-3 {
                return (DQuat::IDENTITY, 0.0);
            }
            let bend = normal.length().atan2(bone.dot(lower)).to_degrees();
            // Folded flat, a limb has no plane either.
            let sure = ramp(bend, PLANE_FROM, PLANE_SURE) * ramp(180.0 - bend, 2.0, 10.0);
            let turn = frame(bone, normal.normalize()) * standing;
            (DQuat::from_mat3(&turn), sure)
        };
        self.poses
            .iter()
            .zip(parents)
            .zip(bones)
            .map(plane)
            .collect()
    }
}

/// The twists of a limb. Bent well, it says itself which way it bends. Bent a little from one straight
/// moment to the next, elbow or knee may be overstretched, so the side is taken that the rest of the motion
/// suggests.
fn bent(planes: &[Hint], swings: &[Hint]) -> Vec<f64> {
    let is_sure = |hint: &Hint| hint.weight >= weight::PLANE * 0.99;
    let sure: Vec<Hint> = planes
        .iter()
        .map(|hint| match is_sure(hint) {
            true => *hint,
            false => Hint {
                weight: 0.0,
                ..*hint
            },
        })
        .collect();
    let suggested = smooth(&[&sure, swings]);
    let mut sided = planes.to_vec();
    let mut start = 0;
    for bend in sided.chunk_by_mut(|a, b| (a.weight > 0.0) == (b.weight > 0.0)) {
        let agreement = bend.iter().zip(&suggested[start..]);
        let agreement: f64 = agreement
            .map(|(hint, suggested)| hint.weight * (hint.angle - suggested).cos())
            .sum();
        start += bend.len();
        if agreement < 0.0 && !bend.iter().any(is_sure) {
            for hint in bend {
                hint.angle += std::f64::consts::PI;
            }
        }
    }
    smooth(&[&sided, swings])
}

/// How well the smallest swing between two directions is defined, 0 to 1: not at all between opposites.
fn certainty(from: DVec3, to: DVec3) -> f64 {
    ((1.0 + from.dot(to)) / 0.2).clamp(0.0, 1.0).powi(4)
}

/// 0 up to `from`, 1 from `to` on, smooth between.
fn ramp(x: f64, from: f64, to: f64) -> f64 {
    let x = ((x - from) / (to - from)).clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}

/// The frame of two directions upright on each other.
fn frame(first: DVec3, second: DVec3) -> DMat3 {
    DMat3::from_cols(first, second, first.cross(second))
}
