//! The fit of a single motion to a rigid body: its terms and their gradients.

use glam::{DQuat, DVec3};
use lamogen_motion::{FRAMES_PER_SECOND, JOINTS, Joint, RestPose, Rotations};

use crate::banded::BandedFactorization;
use crate::contacts::{FEET, FootContact, find_contacts, least_foot_heights};
use crate::descent::Minimizer;
use crate::fit::FitInput;
use crate::held::{hold_start, hold_turns};
use crate::options::FitOptions;
use crate::pose::{BoneOffsets, PARENT_JOINTS, Pose, positions, quaternion_gradient, rotations_on};
use crate::seam::{close_seams, jump_share, remove_travel};
use crate::snaps::{bridge_snaps, frame_trust, is_trusted};
use crate::steps::{break_into_steps, lift_between_steps};

mod curvatures;

/// The number of unknowns of a frame: the root position, and the quaternion of every joint that has children.
const FRAME_WIDTH: usize = 3 + 4 * PARENT_JOINTS.len();

/// The number of frames after the last one of a loop that take part in its fit: the terms look at up to four frames in a row.
/// They are the first frames again, moved on by the travel.
const SEAM_FRAMES: usize = 3;

/// The factor on the weight of the third differences that begin in held frames. The held frames cannot move, so that a goal which sets
/// in after them would otherwise be reached by a leap there. It falls to 1 within [`BORDER_FRAMES`], evenly by its logarithm: a body
/// that is to slow down would otherwise rush ahead as soon as it may, to have its step behind it.
const BORDER_SMOOTHNESS: f64 = 300.0;
/// The number of frames over which that factor falls: one second.
const BORDER_FRAMES: usize = 20;

/// What the frames after the last one of a loop are, compared with the first ones.
struct LoopSeam {
    /// The travel of a cycle, in metres.
    travel: DVec3,
    /// For each joint, whether its quaternion changes its sign from cycle to cycle (-1), as that of a body that turns round
    /// once does, or not (1).
    signs: [f64; JOINTS],
}

/// An elbow or knee, which bends one way only.
struct HingeJoint {
    joint: Joint,
    /// The index of the joint in [`PARENT_JOINTS`].
    place: usize,
    /// The direction of the bone below the joint in the T-pose.
    bone: DVec3,
    /// The axis about which the joint bends.
    axis: DVec3,
    /// The direction in which the bone below the joint moves when the joint bends.
    bend_direction: DVec3,
}

/// The fit of a single motion to a body.
pub(crate) struct MotionFit {
    options: FitOptions,
    rest: RestPose,
    offsets: BoneOffsets,
    hinges: [HingeJoint; 4],
    /// The joint positions of the motion, transferred to this body, in metres.
    reference: Vec<[DVec3; JOINTS]>,
    /// The local rotations solved from the motion.
    solved: Vec<[DQuat; JOINTS]>,
    /// The trust in each frame, 0 to 1.
    trust: Vec<f64>,
    contacts: Vec<FootContact>,
    /// The least height of the ball of each foot at every frame, in metres.
    least_foot_heights: Vec<[f64; 2]>,
    /// The height of the ground, in metres.
    ground: f64,
    /// The number of frames at the beginning that stay as they are.
    held: usize,
    /// How the end of a loop leads into its beginning; `None` for a motion with two ends. The tables of a loop have
    /// [`SEAM_FRAMES`] further frames.
    seam: Option<LoopSeam>,
    /// Rough curvatures of the fit's value, of the root and of every joint that has children.
    curvatures: Vec<BandedFactorization>,
    minimizer: Minimizer,
}

/// The fit's own terms at a trial motion.
pub(crate) struct FitEvaluation {
    value: f64,
    /// The gradient of the terms of the joint positions with respect to these.
    position_gradient: Vec<[DVec3; JOINTS]>,
    /// The gradient of the other terms with respect to root and quaternions, [`FRAME_WIDTH`] numbers a frame.
    gradient: Vec<f64>,
}

/// The motion that a trial point of the minimiser describes.
pub(crate) struct TrialMotion {
    /// The number of frames without those of the seam of a loop.
    frames: usize,
    /// The lengths of the trial point's quaternions.
    lengths: Vec<[f64; PARENT_JOINTS.len()]>,
    local: Vec<[DQuat; JOINTS]>,
    poses: Vec<Pose>,
}

impl TrialMotion {
    /// Returns the joint positions in metres, one pose for each frame.
    pub(crate) fn joints(&self) -> Vec<[[f32; 3]; JOINTS]> {
        let poses = self.poses[..self.frames].iter();
        poses
            .map(|pose| pose.positions.map(|point| point.as_vec3().to_array()))
            .collect()
    }
}

impl MotionFit {
    /// Prepares the fit of a motion. It starts at the rotations solved from the motion. `stiff_frames` are
    /// those of the goal ([`FitObjective::stiff_frames`](crate::FitObjective::stiff_frames)).
    pub(crate) fn new(
        input: &FitInput<'_>,
        options: FitOptions,
        stiff_frames: &[usize],
    ) -> MotionFit {
        let FitInput {
            motion,
            body: rest,
            ground,
            start,
        } = *input;
        let offsets = BoneOffsets::of(rest);
        // A loop is prepared with a cycle before it and one after it, so that its ends know their neighbours.
        let repeated = motion.repeated(3);
        let rotations = rotations_on(repeated.as_ref().unwrap_or(motion), rest);
        let mut solved: Vec<[DQuat; JOINTS]> = { rotations.local().iter() }
            .map(|pose| pose.map(|q| DQuat::from_array(q.map(f64::from)).normalize()))
            .collect();
        let mut reference = positions(&rotations);
        let mut trust = frame_trust(&solved);
        bridge_snaps(&mut solved, &trust);
        let features = { motion.features() }.map(|rows| match repeated {
            Some(_) => rows.repeat(3),
            None => rows.to_vec(),
        });
        let frames = motion.frames();
        if repeated.is_some() {
            close_seams(&offsets, frames, &mut reference, &mut solved);
        }
        let held = start.map_or(0, |start| start.frames().min(frames));
        if let Some(start) = start {
            hold_start(start, &mut reference);
            hold_turns(start, &mut solved);
        }
        let find =
            |reference: &[[DVec3; JOINTS]]| find_contacts(reference, features.as_deref(), ground);
        let mut contacts = find(&reference);
        // A body with a foot that stands throughout a cycle does not travel.
        let stands_throughout =
            |contact: &FootContact| contact.from <= frames && contact.until >= 2 * frames;
        if repeated.is_some() && contacts.iter().any(stands_throughout) {
            remove_travel(frames, &mut reference);
            contacts = find(&reference);
        }
        contacts.retain(|contact| {
            trust[contact.from..contact.until]
                .iter()
                .all(|trust| is_trusted(*trust))
        });
        // A foot that stands in the held frames goes on standing where it stands at their end.
        for contact in &mut contacts {
            if contact.from < held && held < contact.until {
                contact.position = reference[held - 1][contact.joint.index()].to_array();
            }
        }
        let mut least_foot_heights = least_foot_heights(&reference, &contacts, ground);
        if let Some(stride) = options.stride {
            let steps = break_into_steps(contacts.clone(), &reference, stride);
            lift_between_steps(&mut least_foot_heights, [&contacts, &steps], ground);
            contacts = steps;
        }
        let seam = repeated.map(|_| {
            let seam = LoopSeam {
                travel: (reference[2 * frames][0] - reference[frames][0])
                    * DVec3::new(1.0, 0.0, 1.0),
                signs: std::array::from_fn(|joint| {
                    solved[frames][joint]
                        .dot(solved[2 * frames][joint])
                        .signum()
                }),
            };
            let kept = frames..2 * frames + SEAM_FRAMES.min(frames);
            reference = reference[kept.clone()].to_vec();
            solved = solved[kept.clone()].to_vec();
            trust = trust[kept.clone()].to_vec();
            least_foot_heights = least_foot_heights[kept.clone()].to_vec();
            contacts.retain(|contact| contact.from < kept.end && contact.until > kept.start);
            for contact in &mut contacts {
                contact.from = contact.from.max(kept.start) - kept.start;
                contact.until = contact.until.min(kept.end) - kept.start;
            }
            // The second cycle is moved back to the place of the first one.
            for place in reference.as_flattened_mut() {
                *place -= seam.travel;
            }
            for contact in &mut contacts {
                contact.position = (DVec3::from(contact.position) - seam.travel).to_array();
            }
            seam
        });
        let mut point = vec![0.0; FRAME_WIDTH * frames];
        for (t, row) in point.chunks_exact_mut(FRAME_WIDTH).enumerate() {
            row[..3].copy_from_slice(&reference[t][0].to_array());
            for (k, joint) in PARENT_JOINTS.iter().enumerate() {
                quaternion_mut(row, k).copy_from_slice(&solved[t][joint.index()].to_array());
            }
        }
        let mut fit = MotionFit {
            options,
            rest: rest.clone(),
            hinges: hinges(&offsets),
            offsets,
            least_foot_heights,
            seam,
            reference,
            solved,
            trust,
            contacts,
            ground,
            held,
            curvatures: Vec::new(),
            minimizer: Minimizer::new(point),
        };
        fit.curvatures = fit.curvatures(stiff_frames);
        fit
    }

    /// Returns the travel of a cycle of a loop, in metres.
    pub(crate) fn loop_travel(&self) -> Option<[f64; 3]> {
        { self.seam.as_ref() }.map(|seam| seam.travel.to_array())
    }

    /// Returns whether the fit has converged.
    pub(crate) fn is_done(&self) -> bool {
        self.minimizer.is_done()
    }

    /// Returns the motion that is to be evaluated next.
    pub(crate) fn trial(&self) -> TrialMotion {
        self.motion_at(self.minimizer.trial())
    }

    /// Returns the rotations of the best point so far.
    pub(crate) fn rotations(&self) -> Rotations {
        let best = self.motion_at(self.minimizer.point());
        let roots = best.poses[..best.frames].iter();
        let roots = roots.map(|pose| pose.positions[0]);
        let local = best.local[..best.frames].iter();
        Rotations::new(
            self.rest.clone(),
            roots.map(|root| root.as_vec3().to_array()).collect(),
            local
                .map(|pose| pose.map(|q| q.to_array().map(|x| x as f32)))
                .collect(),
            FRAMES_PER_SECOND,
        )
        .with_loop_travel({ self.seam.as_ref() }.map(|seam| {
            let travel = seam.travel.as_vec3();
            [travel.x, travel.z]
        }))
    }

    /// Computes the fit's own terms at a trial motion.
    pub(crate) fn evaluate(&self, trial: &TrialMotion) -> FitEvaluation {
        let frames = self.reference.len();
        let mut position_gradient = vec![[DVec3::ZERO; JOINTS]; frames];
        let mut gradient = vec![0.0; FRAME_WIDTH * frames];
        let value = self.add_position_terms(trial, &mut position_gradient)
            + self.add_rotation_terms(trial, &mut gradient)
            + self.add_step_terms(trial, &mut gradient);
        FitEvaluation {
            value,
            position_gradient,
            gradient,
        }
    }

    /// Passes the value and the gradient at a trial motion to the minimiser. `goal` is the value of the goal there, with its
    /// gradient with respect to the joint positions; it is weighted and added.
    pub(crate) fn advance(
        &mut self,
        trial: &TrialMotion,
        evaluation: FitEvaluation,
        goal: Option<&(f64, Vec<[[f64; 3]; JOINTS]>)>,
    ) {
        let FitEvaluation {
            mut value,
            mut position_gradient,
            mut gradient,
        } = evaluation;
        if let Some((goal_value, gradient)) = goal {
            value += self.options.goal * goal_value;
            for (sums, gradient) in position_gradient
                .as_flattened_mut()
                .iter_mut()
                .zip(gradient.as_flattened())
            {
                *sums += self.options.goal * DVec3::from(*gradient);
            }
        }
        pull_back_positions(trial, &position_gradient, &mut gradient);
        self.fold_seam(trial.frames, &mut gradient);
        self.differentiate_normalization(trial, &mut gradient);
        let held = self.held * FRAME_WIDTH;
        gradient[..held].fill(0.0);
        let curvatures = &self.curvatures;
        self.minimizer.update(value, gradient, &|step| {
            let (root, joints) = curvatures.split_first().expect("the root has a curvature");
            root.solve::<3>(step, 0, FRAME_WIDTH);
            for (joint, curvature) in joints.iter().enumerate() {
                curvature.solve::<4>(step, 3 + 4 * joint, FRAME_WIDTH);
            }
            step[..held].fill(0.0);
        });
    }

    /// Returns the motion that a point of the minimiser describes.
    fn motion_at(&self, point: &[f64]) -> TrialMotion {
        let frames = point.len() / FRAME_WIDTH;
        let all = self.reference.len();
        let mut trial = TrialMotion {
            frames,
            lengths: Vec::with_capacity(all),
            local: Vec::with_capacity(all),
            poses: Vec::with_capacity(all),
        };
        for row in point.chunks_exact(FRAME_WIDTH) {
            let mut local = [DQuat::IDENTITY; JOINTS];
            let mut lengths = [0.0; PARENT_JOINTS.len()];
            for (k, joint) in PARENT_JOINTS.iter().enumerate() {
                let q = DQuat::from_slice(&row[3 + 4 * k..7 + 4 * k]);
                lengths[k] = q.length();
                local[joint.index()] = q / lengths[k];
            }
            let root = DVec3::from_slice(&row[..3]);
            trial.poses.push(Pose::of(&self.offsets, root, &local));
            trial.local.push(local);
            trial.lengths.push(lengths);
        }
        if let Some(seam) = &self.seam {
            for t in 0..all - frames {
                let local = trial.local[t];
                let local = std::array::from_fn(|joint| local[joint] * seam.signs[joint]);
                let root = trial.poses[t].positions[0] + seam.travel;
                trial.poses.push(Pose::of(&self.offsets, root, &local));
                trial.local.push(local);
            }
        }
        trial
    }

    /// Adds the gradient of the frames of a loop's seam to that of the first frames, which they repeat, and removes it from
    /// the end.
    fn fold_seam(&self, frames: usize, gradient: &mut Vec<f64>) {
        let Some(seam) = &self.seam else {
            return;
        };
        let (own, further) = gradient.split_at_mut(frames * FRAME_WIDTH);
        let rows = own.chunks_exact_mut(FRAME_WIDTH);
        for (row, further) in rows.zip(further.chunks_exact_mut(FRAME_WIDTH)) {
            for (sum, g) in row.iter_mut().zip(&*further).take(3) {
                *sum += g;
            }
            for (k, joint) in PARENT_JOINTS.iter().enumerate() {
                let sign = seam.signs[joint.index()];
                for (sum, g) in quaternion_mut(row, k)
                    .iter_mut()
                    .zip(quaternion_mut(further, k))
                {
                    *sum += sign * *g;
                }
            }
        }
        gradient.truncate(frames * FRAME_WIDTH);
    }

    /// Returns the value of the terms of the joint positions, and adds their gradient to `gradient`.
    // Frames and joints are indices into several tables at once.
    #[allow(clippy::needless_range_loop)]
    fn add_position_terms(&self, trial: &TrialMotion, gradient: &mut [[DVec3; JOINTS]]) -> f64 {
        let options = &self.options;
        let at = |t: usize, j: usize| trial.poses[t].positions[j];
        let mut value = 0.0;
        for t in 0..self.reference.len() {
            let weight = options.nearness * self.trust[t];
            let off = |j: usize| at(t, j) - self.reference[t][j];
            // What all joints have in common along the ground counts less.
            let mean = (0..JOINTS).map(off).sum::<DVec3>() / JOINTS as f64;
            let free = (1.0 - options.placement) * DVec3::new(mean.x, 0.0, mean.z);
            value -= weight * JOINTS as f64 * free.dot(mean);
            for j in 0..JOINTS {
                let off = off(j);
                value += weight * off.length_squared();
                gradient[t][j] += 2.0 * weight * (off - free);
                let depth = (self.ground - at(t, j).y).max(0.0);
                value += options.floor * depth * depth;
                gradient[t][j].y -= 2.0 * options.floor * depth;
            }
            for (foot, least) in FEET.into_iter().zip(self.least_foot_heights[t]) {
                let missing = (least - at(t, foot.index()).y).max(0.0);
                value += options.clearance * missing * missing;
                gradient[t][foot.index()].y -= 2.0 * options.clearance * missing;
            }
        }
        for t in 3..self.reference.len() {
            let is_across = self.held > 0 && (self.held..self.held + 3).contains(&t);
            let trust = self.trust[t].min(self.trust[t - 3]);
            let smoothness = options.smoothness * trust * self.border_factor(t);
            for j in 0..JOINTS {
                let third = third_difference([t - 3, t - 2, t - 1, t].map(|t| at(t, j)));
                let reference = [t - 3, t - 2, t - 1, t].map(|t| self.reference[t][j]);
                // Where the reference passes from the held frames to the motion's own, its differences are those of two motions.
                let off = if is_across {
                    third
                } else {
                    third - third_difference(reference)
                };
                value += options.jerk * third.length_squared();
                value += smoothness * off.length_squared();
                let g = 2.0 * (options.jerk * third + smoothness * off);
                gradient[t][j] += g;
                gradient[t - 1][j] -= 3.0 * g;
                gradient[t - 2][j] += 3.0 * g;
                gradient[t - 3][j] -= g;
            }
        }
        for contact in &self.contacts {
            let j = contact.joint.index();
            let place = self.standing_place(contact, &|t| at(t, j));
            for (t, gradient) in gradient
                .iter_mut()
                .enumerate()
                .take(contact.until)
                .skip(contact.from)
            {
                let off = at(t, j) - place;
                value += options.stand * off.length_squared();
                gradient[j] += 2.0 * options.stand * off;
            }
        }
        value
    }

    /// Returns the factor on the weight of the third difference that ends at a frame.
    fn border_factor(&self, frame: usize) -> f64 {
        match frame.checked_sub(self.held) {
            Some(after) if self.held > 0 => {
                BORDER_SMOOTHNESS.powf(jump_share(after, BORDER_FRAMES))
            }
            _ => 1.0,
        }
    }

    /// Returns where a foot stands in a contact: at the mean of its places on the ground, so that a step may become shorter or longer.
    /// A foot that stands in the frames that are held goes on standing where it is. `at` returns its position at a frame.
    fn standing_place(&self, contact: &FootContact, at: &dyn Fn(usize) -> DVec3) -> DVec3 {
        let place = DVec3::from(contact.position);
        if contact.from < self.held {
            return place;
        }
        let frames = contact.from..contact.until;
        let mean = frames.clone().map(at).sum::<DVec3>() / frames.len() as f64;
        DVec3::new(mean.x, place.y, mean.z)
    }

    /// Returns the value of the terms of the rotations at single frames, and adds their gradient to `gradient`.
    fn add_rotation_terms(&self, trial: &TrialMotion, gradient: &mut [f64]) -> f64 {
        let options = &self.options;
        let mut value = 0.0;
        for (t, row) in gradient.chunks_exact_mut(FRAME_WIDTH).enumerate() {
            for hinge in &self.hinges {
                let q = trial.local[t][hinge.joint.index()];
                let bone = q * hinge.bone;
                let (back, aside) = (
                    bone.dot(hinge.bend_direction).min(0.0),
                    bone.dot(hinge.axis),
                );
                value += options.hinge * back * back + options.plane * aside * aside;
                let bone_gradient = 2.0 * options.hinge * back * hinge.bend_direction
                    + 2.0 * options.plane * aside * hinge.axis;
                let turn = q.inverse() * bone.cross(bone_gradient);
                let sums = quaternion_mut(row, hinge.place).iter_mut();
                for (sum, g) in sums.zip(quaternion_gradient(q, turn)) {
                    *sum += g;
                }
            }
            for (k, joint) in PARENT_JOINTS.iter().enumerate() {
                let j = joint.index();
                let prior = options.prior_of(*joint);
                let off = (trial.local[t][j] - self.solved[t][j]).to_array();
                for (sum, off) in quaternion_mut(row, k).iter_mut().zip(off) {
                    value += prior * off * off;
                    *sum += 2.0 * prior * off;
                }
            }
        }
        value
    }

    /// Returns the value of the terms of the rotations from frame to frame, and adds their gradient to `gradient`.
    fn add_step_terms(&self, trial: &TrialMotion, gradient: &mut [f64]) -> f64 {
        let options = &self.options;
        // The difference of two unit quaternions has the length 2 sin(a / 4), where a is the angle between the rotations.
        let fastest = 2.0 * (options.fastest.to_radians() / 4.0).sin();
        let mut value = 0.0;
        for t in 1..self.reference.len() {
            for (k, joint) in PARENT_JOINTS.iter().enumerate() {
                let j = joint.index();
                let mut add = |t: usize, share: f64, g: [f64; 4]| {
                    let row = &mut gradient[t * FRAME_WIDTH..(t + 1) * FRAME_WIDTH];
                    for (sum, g) in quaternion_mut(row, k).iter_mut().zip(g) {
                        *sum += share * g;
                    }
                };
                let step = trial.local[t][j] - trial.local[t - 1][j];
                let excess = step.length() - fastest;
                if excess > 0.0 {
                    value += options.haste * excess * excess;
                    let g = (step * (2.0 * options.haste * excess / step.length())).to_array();
                    add(t, 1.0, g);
                    add(t - 1, -1.0, g);
                }
                if t < 2 {
                    continue;
                }
                let second_difference = |local: &[[DQuat; JOINTS]]| {
                    local[t][j] + local[t - 2][j] - local[t - 1][j] * 2.0
                };
                let own = second_difference(&trial.local);
                let off = own - second_difference(&self.solved);
                let weight = options.turning_factor(*joint);
                value += weight
                    * (options.rotation * own.length_squared()
                        + options.turning * off.length_squared());
                let g = (own * options.rotation + off * options.turning) * (2.0 * weight);
                add(t, 1.0, g.to_array());
                add(t - 1, -2.0, g.to_array());
                add(t - 2, 1.0, g.to_array());
            }
        }
        value
    }

    /// Converts the gradient with respect to normalised quaternions to the gradient with respect to the quaternions of the
    /// trial point. The part along a quaternion is removed, because the length of a quaternion has no effect.
    fn differentiate_normalization(&self, trial: &TrialMotion, gradient: &mut [f64]) {
        for (t, row) in gradient.chunks_exact_mut(FRAME_WIDTH).enumerate() {
            for (k, joint) in PARENT_JOINTS.iter().enumerate() {
                let q = trial.local[t][joint.index()].to_array();
                let g = quaternion_mut(row, k);
                let along: f64 = q.iter().zip(g.iter()).map(|(q, g)| q * g).sum();
                for (g, q) in g.iter_mut().zip(q) {
                    *g = (*g - along * q) / trial.lengths[t][k];
                }
            }
        }
    }
}

/// Adds the gradient of the joint positions, pulled back to root and rotations.
fn pull_back_positions(
    trial: &TrialMotion,
    position_gradient: &[[DVec3; JOINTS]],
    gradient: &mut [f64],
) {
    let rows = gradient.chunks_exact_mut(FRAME_WIDTH).enumerate();
    for (t, row) in rows {
        let (root, turns) = trial.poses[t].pull_back(&position_gradient[t]);
        for (sum, g) in row.iter_mut().zip(root.to_array()) {
            *sum += g;
        }
        for (k, joint) in PARENT_JOINTS.iter().enumerate() {
            let j = joint.index();
            let sums = quaternion_mut(row, k).iter_mut();
            for (sum, g) in sums.zip(quaternion_gradient(trial.local[t][j], turns[j])) {
                *sum += g;
            }
        }
    }
}

/// Returns the quaternion of the joint with an index in [`PARENT_JOINTS`] from the unknowns of a frame.
fn quaternion_mut(row: &mut [f64], index: usize) -> &mut [f64] {
    &mut row[3 + 4 * index..7 + 4 * index]
}

/// Returns the third difference of four consecutive values.
fn third_difference([a, b, c, d]: [DVec3; 4]) -> DVec3 {
    d - 3.0 * c + 3.0 * b - a
}

fn hinges(offsets: &BoneOffsets) -> [HingeJoint; 4] {
    [
        (Joint::LeftElbow, Joint::LeftWrist),
        (Joint::RightElbow, Joint::RightWrist),
        (Joint::LeftKnee, Joint::LeftAnkle),
        (Joint::RightKnee, Joint::RightAnkle),
    ]
    .map(|(joint, end)| {
        let axis = RestPose::hinge(joint).expect("elbows and knees are hinges");
        let axis = DVec3::from(axis.map(f64::from));
        let bone = offsets.0[end.index()].normalize_or_zero();
        HingeJoint {
            joint,
            place: { PARENT_JOINTS.iter().position(|parent| *parent == joint) }
                .expect("elbows and knees have children"),
            bone,
            axis,
            bend_direction: axis.cross(bone),
        }
    })
}
