//! Solves the global rotation of every joint at every frame from joint positions.

use glam::{DMat3, DQuat, DVec3};

use super::fit::fit_rotation;
use super::rest::{BRANCH_JOINTS, MIN_BONE_LENGTH, RestPose};
use super::twist::{TwistEstimate, smooth_twists};
use crate::motion::Motion;
use crate::precise::{points, smooth_step, vector};
use crate::skeleton::{JOINTS, Joint};

/// An arm or a leg: two bones that bend in a plane.
struct Limb {
    /// The shoulder or hip.
    upper: Joint,
    /// The elbow or knee.
    middle: Joint,
    /// The wrist or ankle.
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

/// Weights of the estimates of a twist, where adding no twist to the turn of the bone from frame to frame has weight 1.
mod weight {
    /// The weight of the smallest swing where nothing else is known: large, so that the swing is met exactly.
    pub(super) const SWING: f64 = 1e4;
    /// The weight of the plane in which a limb bends.
    pub(super) const PLANE: f64 = 100.0;
    /// The weight of the smallest swing of a limb that hardly bends: it takes over within two seconds.
    pub(super) const STRAIGHT: f64 = 0.001;
}

/// The bend of a limb, in degrees, above which its plane begins to count.
const PLANE_FROM: f64 = 10.0;
/// The bend of a limb, in degrees, above which its plane counts fully.
const PLANE_FULL: f64 = 30.0;

/// Returns the rotation of every joint in the world at every frame.
pub(super) fn solve_global(motion: &Motion, rest: &RestPose) -> Vec<[DQuat; JOINTS]> {
    let poses: Vec<[DVec3; JOINTS]> = motion.joints().iter().map(points).collect();
    let mut global = vec![[DQuat::IDENTITY; JOINTS]; poses.len()];
    for joint in Joint::ALL {
        let solver = JointSolver {
            poses: &poses,
            rest,
            global: &global,
        };
        let turns = solver.solve(joint);
        for (pose, turn) in global.iter_mut().zip(turns) {
            pose[joint.index()] = turn;
        }
    }
    global
}

/// Solves the rotations of one joint over a whole motion. The joints above it must have been solved before.
struct JointSolver<'a> {
    poses: &'a [[DVec3; JOINTS]],
    rest: &'a RestPose,
    /// The rotations solved so far, in the world.
    global: &'a [[DQuat; JOINTS]],
}

impl JointSolver<'_> {
    /// Returns the rotation of a joint in the world at every frame.
    fn solve(&self, joint: Joint) -> Vec<DQuat> {
        if let Some(branch) = BRANCH_JOINTS.iter().find(|branch| branch.joint == joint) {
            return self.solve_branch(joint, branch.children());
        }
        match joint.children().next() {
            Some(child) => self.solve_bone(joint, child),
            // The positions do not tell how head, hands and toes turn.
            None => self.parent_turns(joint).collect(),
        }
    }

    /// Returns the rotations of the joint's parent; for the pelvis these are the identity.
    fn parent_turns(&self, joint: Joint) -> impl Iterator<Item = DQuat> + '_ {
        let parent = joint.parent();
        self.global.iter().map(move |pose| match parent {
            Some(parent) => pose[parent.index()],
            None => DQuat::IDENTITY,
        })
    }

    fn offset(&self, joint: Joint) -> DVec3 {
        vector(self.rest.offset(joint))
    }

    /// Returns the rotations of a branch joint that fit its three children best.
    fn solve_branch(&self, joint: Joint, children: [Joint; 3]) -> Vec<DQuat> {
        let offsets = children.map(|child| self.offset(child));
        let mut expected = self.parent_turns(joint).next().unwrap_or_default();
        let turn = |pose: &[DVec3; JOINTS]| {
            let positions = children.map(|child| pose[child.index()] - pose[joint.index()]);
            expected = fit_rotation(&offsets, &positions, expected);
            expected
        };
        self.poses.iter().map(turn).collect()
    }

    /// Returns the rotations that point a bone in its direction. Their twist about the bone is estimated where it is
    /// known and carried along elsewhere.
    fn solve_bone(&self, joint: Joint, child: Joint) -> Vec<DQuat> {
        let parents: Vec<DQuat> = self.parent_turns(joint).collect();
        let Some(rest) = self.offset(child).try_normalize() else {
            return parents;
        };
        // Everything below is relative to the parent, so that a turn of the whole body adds no twist.
        let bones = self.bone_directions((joint, child), &parents, rest);
        let swings = bones
            .iter()
            .map(|&bone| DQuat::from_rotation_arc(rest, bone));
        let swings: Vec<DQuat> = swings.collect();
        // The first swing, carried along from frame to frame by the shortest turns of the bone.
        let mut carried: Vec<DQuat> = Vec::with_capacity(bones.len());
        for (frame, &bone) in bones.iter().enumerate() {
            carried.push(match frame.checked_sub(1) {
                None => swings[0],
                Some(previous) => {
                    let turn = DQuat::from_rotation_arc(bones[previous], bone);
                    (turn * carried[previous]).normalize()
                }
            });
        }
        let estimate = |frame: usize, turn: DQuat, weight: f64| {
            let between = carried[frame].inverse() * turn;
            TwistEstimate {
                angle: 2.0 * between.xyz().dot(rest).atan2(between.w),
                weight,
            }
        };
        let swing_estimates = |weight: f64| -> Vec<TwistEstimate> {
            let frames = swings.iter().zip(&bones).enumerate();
            let estimates = frames.map(|(frame, (&swing, &bone))| {
                estimate(frame, swing, weight * swing_certainty(rest, bone))
            });
            estimates.collect()
        };
        let twists = match LIMBS.iter().find(|limb| limb.upper == joint) {
            None => smooth_twists(&[&swing_estimates(weight::SWING)]),
            Some(limb) => {
                let planes = self.bending_planes(limb, rest, &bones, &parents);
                let planes = planes.into_iter().enumerate();
                let planes: Vec<TwistEstimate> = planes
                    .map(|(frame, (turn, certainty))| {
                        estimate(frame, turn, weight::PLANE * certainty)
                    })
                    .collect();
                limb_twists(&planes, &swing_estimates(weight::STRAIGHT))
            }
        };
        let turns = parents.iter().zip(&carried).zip(twists);
        turns
            .map(|((&parent, &turn), twist)| {
                (parent * turn * DQuat::from_axis_angle(rest, twist)).normalize()
            })
            .collect()
    }

    /// Returns the directions of a bone relative to the parent of the joint in which it starts. A bone without length
    /// keeps its last direction, at first that of the T-pose.
    fn bone_directions(
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
                if bone.length() > MIN_BONE_LENGTH {
                    last = (parent.inverse() * bone).normalize();
                }
                last
            })
            .collect()
    }

    /// Returns, for every frame, the rotation of a limb's upper bone that makes the hinge axis of elbow or knee
    /// orthogonal to the plane in which the limb bends, and the certainty of that plane, 0 to 1.
    fn bending_planes(
        &self,
        limb: &Limb,
        rest: DVec3,
        bones: &[DVec3],
        parents: &[DQuat],
    ) -> Vec<(DQuat, f64)> {
        let hinge = RestPose::hinge(limb.middle).expect("elbows and knees are hinges");
        let from_rest = orthogonal_basis(rest, vector(hinge)).transpose();
        let plane = |((pose, parent), &bone): ((&[DVec3; JOINTS], &DQuat), &DVec3)| {
            let lower = pose[limb.end.index()] - pose[limb.middle.index()];
            let lower = (parent.inverse() * lower).normalize_or_zero();
            let normal = bone.cross(lower);
            if normal.length() < 1e-3 {
                return (DQuat::IDENTITY, 0.0);
            }
            let bend = normal.length().atan2(bone.dot(lower)).to_degrees();
            // A limb that is folded flat has no plane either.
            let certainty = ramp(bend, PLANE_FROM, PLANE_FULL) * ramp(180.0 - bend, 2.0, 10.0);
            let turn = orthogonal_basis(bone, normal.normalize()) * from_rest;
            (DQuat::from_mat3(&turn), certainty)
        };
        self.poses
            .iter()
            .zip(parents)
            .zip(bones)
            .map(plane)
            .collect()
    }
}

/// Returns the twists of a limb's upper bone.
///
/// Where a limb bends well, its plane gives the twist. Where it bends only a little between two straight moments, elbow
/// or knee may be overstretched, so that the plane is right but its side is not; then the side is taken that agrees with
/// the rest of the motion.
fn limb_twists(planes: &[TwistEstimate], swings: &[TwistEstimate]) -> Vec<f64> {
    let is_certain = |estimate: &TwistEstimate| estimate.weight >= weight::PLANE * 0.99;
    let certain: Vec<TwistEstimate> = planes
        .iter()
        .map(|estimate| match is_certain(estimate) {
            true => *estimate,
            false => TwistEstimate {
                weight: 0.0,
                ..*estimate
            },
        })
        .collect();
    let expected = smooth_twists(&[&certain, swings]);
    let mut planes = planes.to_vec();
    let mut start = 0;
    for bend in planes.chunk_by_mut(|a, b| (a.weight > 0.0) == (b.weight > 0.0)) {
        let agreement = bend.iter().zip(&expected[start..]);
        let agreement: f64 = agreement
            .map(|(estimate, expected)| estimate.weight * (estimate.angle - expected).cos())
            .sum();
        start += bend.len();
        if agreement < 0.0 && !bend.iter().any(is_certain) {
            for estimate in bend {
                estimate.angle += std::f64::consts::PI;
            }
        }
    }
    smooth_twists(&[&planes, swings])
}

/// Returns how well the smallest swing between two directions is defined, 0 to 1; it is undefined (0) between opposite
/// directions.
fn swing_certainty(from: DVec3, to: DVec3) -> f64 {
    ((1.0 + from.dot(to)) / 0.2).clamp(0.0, 1.0).powi(4)
}

/// Returns 0 for `x` up to `from`, 1 from `to` on, and a smooth transition between.
fn ramp(x: f64, from: f64, to: f64) -> f64 {
    smooth_step((x - from) / (to - from))
}

/// Returns the basis of two orthogonal unit vectors and their cross product.
fn orthogonal_basis(first: DVec3, second: DVec3) -> DMat3 {
    DMat3::from_cols(first, second, first.cross(second))
}
