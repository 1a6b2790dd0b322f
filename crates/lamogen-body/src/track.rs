//! One motion on its way to rigid bones: the terms of a fit with their gradients.

use glam::{DQuat, DVec3};
use lamogen_motion::{FRAMES_PER_SECOND, JOINTS, Joint, RestPose, Rotations};

use crate::banded::Banded;
use crate::contacts::{FEET, FootContact, clearance, stands};
use crate::descent::Descent;
use crate::fit::FitInput;
use crate::options::FitOptions;
use crate::pose::{Bones, DRIVEN, Pose, of_quaternion};
use crate::snaps::{bridge, is_believed, trust};

/// Numbers of a frame: the root, and a quaternion of every driven joint.
const WIDTH: usize = 3 + 4 * DRIVEN.len();

/// A limb that bends one way only.
struct Hinge {
    joint: Joint,
    /// The direction of the lower bone in the T-pose.
    bone: DVec3,
    /// The axis it bends about.
    axis: DVec3,
    /// Where the lower bone goes when it bends.
    ahead: DVec3,
}

/// One motion on its way.
pub(crate) struct Track {
    fit: FitOptions,
    rest: RestPose,
    bones: Bones,
    hinges: [Hinge; 4],
    /// Where the motion has the joints, on this body.
    wanted: Vec<[DVec3; JOINTS]>,
    /// The rotations solved from it.
    solved: Vec<[DQuat; JOINTS]>,
    /// How much each frame is to be believed.
    trust: Vec<f64>,
    stands: Vec<FootContact>,
    /// How high the ball of each foot is to be at least.
    clearance: Vec<[f64; 2]>,
    ground: f64,
    /// Rough curvatures of the root and of every driven joint.
    curvatures: Vec<Banded>,
    pub(crate) descent: Descent,
}

/// What the numbers of a trial point mean.
pub(crate) struct Trial {
    lengths: Vec<[f64; DRIVEN.len()]>,
    local: Vec<[DQuat; JOINTS]>,
    poses: Vec<Pose>,
}

impl Trial {
    /// Joint positions in metres, a pose a frame.
    pub(crate) fn joints(&self) -> Vec<[[f32; 3]; JOINTS]> {
        let poses = self.poses.iter();
        poses
            .map(|pose| pose.positions.map(|point| point.as_vec3().to_array()))
            .collect()
    }
}

impl Track {
    pub(crate) fn new(input: &FitInput<'_>, fit: FitOptions) -> Track {
        let FitInput {
            motion,
            body: rest,
            ground,
        } = *input;
        let bones = Bones::of(rest);
        let rotations = Rotations::of(motion);
        // Bones keep their directions and get the body's lengths; a body without legs tells no size.
        let rotations = match rotations.rest().leg() > 0.0 {
            true => rotations.on(rest),
            false => Rotations::on_body(motion, rest),
        };
        let mut solved: Vec<[DQuat; JOINTS]> = { rotations.local().iter() }
            .map(|pose| pose.map(|q| DQuat::from_array(q.map(f64::from)).normalize()))
            .collect();
        let wanted = rotations.joints().into_iter();
        let wanted: Vec<[DVec3; JOINTS]> = wanted
            .map(|pose| pose.map(|point| DVec3::from(point.map(f64::from))))
            .collect();
        let trust = trust(&solved);
        bridge(&mut solved, &trust);
        let mut stands = stands(&wanted, motion.features(), ground);
        stands.retain(|stand| {
            trust[stand.from..stand.until]
                .iter()
                .all(|t| is_believed(*t))
        });
        let mut point = vec![0.0; WIDTH * wanted.len()];
        for (t, row) in point.chunks_exact_mut(WIDTH).enumerate() {
            row[..3].copy_from_slice(&wanted[t][0].to_array());
            for (k, joint) in DRIVEN.iter().enumerate() {
                quaternion_of(row, k).copy_from_slice(&solved[t][joint.index()].to_array());
            }
        }
        let mut track = Track {
            fit,
            rest: rest.clone(),
            hinges: hinges(&bones),
            bones,
            clearance: clearance(&wanted, &stands, ground),
            wanted,
            solved,
            trust,
            stands,
            ground,
            curvatures: Vec::new(),
            descent: Descent::new(point),
        };
        track.curvatures = track.curvatures();
        track
    }

    /// What the trial point that the descent asks for means.
    pub(crate) fn trial(&self) -> Trial {
        self.meaning(self.descent.trial())
    }

    /// The rotations of the best point so far.
    pub(crate) fn rotations(&self) -> Rotations {
        let best = self.meaning(self.descent.point());
        let roots = best.poses.iter().map(|pose| pose.positions[0]);
        let local = best.local.iter();
        Rotations::new(
            self.rest.clone(),
            roots.map(|root| root.as_vec3().to_array()).collect(),
            local
                .map(|pose| pose.map(|q| q.to_array().map(|x| x as f32)))
                .collect(),
            FRAMES_PER_SECOND,
        )
    }

    /// Tells the descent value and gradient at a trial point. `goal` is a value that is added, with its gradient with respect to the positions.
    pub(crate) fn advance(&mut self, trial: &Trial, goal: Option<&(f64, Vec<[[f32; 3]; JOINTS]>)>) {
        let mut of_positions = vec![[DVec3::ZERO; JOINTS]; self.wanted.len()];
        let mut value = self.positions(trial, &mut of_positions);
        if let Some((of_goal, gradient)) = goal {
            value += self.fit.goal * of_goal;
            for (sums, gradient) in of_positions
                .as_flattened_mut()
                .iter_mut()
                .zip(gradient.as_flattened())
            {
                *sums += self.fit.goal * DVec3::from(gradient.map(f64::from));
            }
        }
        let mut gradient = vec![0.0; WIDTH * self.wanted.len()];
        value += self.frames(trial, &of_positions, &mut gradient);
        value += self.steps(trial, &mut gradient);
        self.keep_lengths(trial, &mut gradient);
        let curvatures = &self.curvatures;
        self.descent.tell(value, gradient, &|step| {
            for (block, banded) in curvatures.iter().enumerate() {
                let (offset, width) = match block {
                    0 => (0, 3),
                    _ => (4 * block - 1, 4),
                };
                for i in 0..width {
                    banded.solve(step, offset + i, WIDTH);
                }
            }
        });
    }

    fn meaning(&self, point: &[f64]) -> Trial {
        let frames = self.wanted.len();
        let mut trial = Trial {
            lengths: Vec::with_capacity(frames),
            local: Vec::with_capacity(frames),
            poses: Vec::with_capacity(frames),
        };
        for row in point.chunks_exact(WIDTH) {
            let mut local = [DQuat::IDENTITY; JOINTS];
            let mut lengths = [0.0; DRIVEN.len()];
            for (k, joint) in DRIVEN.iter().enumerate() {
                let q = DQuat::from_slice(&row[3 + 4 * k..7 + 4 * k]);
                lengths[k] = q.length();
                local[joint.index()] = q / lengths[k];
            }
            let root = DVec3::from_slice(&row[..3]);
            trial.poses.push(Pose::of(&self.bones, root, &local));
            trial.local.push(local);
            trial.lengths.push(lengths);
        }
        trial
    }

    /// Terms of the positions; their gradient is added up.
    // Frames and joints are places in several tables at once.
    #[allow(clippy::needless_range_loop)]
    fn positions(&self, trial: &Trial, gradient: &mut [[DVec3; JOINTS]]) -> f64 {
        let fit = &self.fit;
        let at = |t: usize, j: usize| trial.poses[t].positions[j];
        let mut value = 0.0;
        for t in 0..self.wanted.len() {
            let weight = fit.nearness * self.trust[t];
            for j in 0..JOINTS {
                let off = at(t, j) - self.wanted[t][j];
                value += weight * off.length_squared();
                gradient[t][j] += 2.0 * weight * off;
                let depth = (self.ground - at(t, j).y).max(0.0);
                value += fit.floor * depth * depth;
                gradient[t][j].y -= 2.0 * fit.floor * depth;
            }
            for (foot, least) in FEET.into_iter().zip(self.clearance[t]) {
                let missing = (least - at(t, foot.index()).y).max(0.0);
                value += fit.clearance * missing * missing;
                gradient[t][foot.index()].y -= 2.0 * fit.clearance * missing;
            }
        }
        for t in 3..self.wanted.len() {
            let trust = self.trust[t].min(self.trust[t - 3]);
            for j in 0..JOINTS {
                let third = third([t - 3, t - 2, t - 1, t].map(|t| at(t, j)));
                let wanted = [t - 3, t - 2, t - 1, t].map(|t| self.wanted[t][j]);
                let off = third - self::third(wanted);
                value += fit.jerk * third.length_squared();
                value += fit.smoothness * trust * off.length_squared();
                let g = 2.0 * (fit.jerk * third + fit.smoothness * trust * off);
                gradient[t][j] += g;
                gradient[t - 1][j] -= 3.0 * g;
                gradient[t - 2][j] += 3.0 * g;
                gradient[t - 3][j] -= g;
            }
        }
        for stand in &self.stands {
            let j = stand.joint.index();
            for (t, gradient) in gradient
                .iter_mut()
                .enumerate()
                .take(stand.until)
                .skip(stand.from)
            {
                let off = at(t, j) - DVec3::from(stand.place);
                value += fit.stand * off.length_squared();
                gradient[j] += 2.0 * fit.stand * off;
            }
        }
        value
    }

    /// Terms of the rotations at single frames, and the way back from the positions.
    fn frames(&self, trial: &Trial, of_positions: &[[DVec3; JOINTS]], gradient: &mut [f64]) -> f64 {
        let fit = &self.fit;
        let mut value = 0.0;
        for (t, row) in gradient.chunks_exact_mut(WIDTH).enumerate() {
            let (root, mut turns) = trial.poses[t].pull(&of_positions[t]);
            row[..3].copy_from_slice(&root.to_array());
            for hinge in &self.hinges {
                let q = trial.local[t][hinge.joint.index()];
                let lower = q * hinge.bone;
                let (back, aside) = (lower.dot(hinge.ahead).min(0.0), lower.dot(hinge.axis));
                value += fit.hinge * back * back + fit.plane * aside * aside;
                let of_lower =
                    2.0 * fit.hinge * back * hinge.ahead + 2.0 * fit.plane * aside * hinge.axis;
                turns[hinge.joint.index()] += q.inverse() * lower.cross(of_lower);
            }
            for (k, joint) in DRIVEN.iter().enumerate() {
                let j = joint.index();
                let q = trial.local[t][j];
                let off = (q - self.solved[t][j]).to_array();
                let of_turn = of_quaternion(q, turns[j]);
                for (i, g) in quaternion_of(row, k).iter_mut().enumerate() {
                    value += fit.prior * off[i] * off[i];
                    *g += of_turn[i] + 2.0 * fit.prior * off[i];
                }
            }
        }
        value
    }

    /// Terms of the rotations from frame to frame.
    fn steps(&self, trial: &Trial, gradient: &mut [f64]) -> f64 {
        let fit = &self.fit;
        // The quaternions of two rotations differ by twice the sine of a quarter of the angle between them.
        let fastest = 2.0 * (fit.fastest.to_radians() / 4.0).sin();
        let mut value = 0.0;
        for t in 1..self.wanted.len() {
            for (k, joint) in DRIVEN.iter().enumerate() {
                let j = joint.index();
                let mut add = |t: usize, share: f64, g: [f64; 4]| {
                    let row = &mut gradient[t * WIDTH..(t + 1) * WIDTH];
                    for (sum, g) in quaternion_of(row, k).iter_mut().zip(g) {
                        *sum += share * g;
                    }
                };
                let step = trial.local[t][j] - trial.local[t - 1][j];
                let over = step.length() - fastest;
                if over > 0.0 {
                    value += fit.haste * over * over;
                    let g = (step * (2.0 * fit.haste * over / step.length())).to_array();
                    add(t, 1.0, g);
                    add(t - 1, -1.0, g);
                }
                if t < 2 {
                    continue;
                }
                let second = |local: &[[DQuat; JOINTS]]| {
                    local[t][j] + local[t - 2][j] - local[t - 1][j] * 2.0
                };
                let own = second(&trial.local);
                let off = own - second(&self.solved);
                let weight = fit.weight_of(*joint);
                value += weight
                    * (fit.rotation * own.length_squared() + fit.turning * off.length_squared());
                let g = (own * fit.rotation + off * fit.turning) * (2.0 * weight);
                add(t, 1.0, g.to_array());
                add(t - 1, -2.0, g.to_array());
                add(t - 2, 1.0, g.to_array());
            }
        }
        value
    }

    /// Takes from a gradient what would change the length of a quaternion alone: its length means nothing.
    fn keep_lengths(&self, trial: &Trial, gradient: &mut [f64]) {
        for (t, row) in gradient.chunks_exact_mut(WIDTH).enumerate() {
            for (k, joint) in DRIVEN.iter().enumerate() {
                let q = trial.local[t][joint.index()].to_array();
                let g = quaternion_of(row, k);
                let along: f64 = q.iter().zip(g.iter()).map(|(q, g)| q * g).sum();
                for (g, q) in g.iter_mut().zip(q) {
                    *g = (*g - along * q) / trial.lengths[t][k];
                }
            }
        }
    }

    /// How the value bends along the root and along every driven joint, each by itself: what a step is divided by.
    fn curvatures(&self) -> Vec<Banded> {
        let FitOptions {
            nearness,
            smoothness,
            jerk,
            turning,
            rotation,
            stand,
            prior,
            ..
        } = self.fit;
        let frames = self.wanted.len();
        let mut standing = vec![0.0; frames];
        for own in &self.stands {
            for standing in &mut standing[own.from..own.until] {
                *standing += stand;
            }
        }
        let third = jerk + smoothness;
        let joints = JOINTS as f64;
        let root = |t: usize| 2.0 * (nearness * self.trust[t] * joints + standing[t]) + 1e-3;
        let mut all = vec![Banded::new(frames, root, 0.0, 2.0 * third * joints)];
        let levers = levers(&self.bones);
        for joint in DRIVEN {
            // A quaternion's numbers change half as fast as the angle, and squares count.
            let lever = 4.0 * levers[joint.index()];
            let carries = if is_of_a_leg(joint) { 0.25 } else { 0.0 };
            let own = |t: usize| {
                let near = nearness * self.trust[t] * lever;
                2.0 * (near + carries * standing[t] + prior) + 1e-4
            };
            let second = 2.0 * (rotation + turning) * self.fit.weight_of(joint);
            all.push(Banded::new(frames, own, second, 2.0 * third * lever));
        }
        all
    }
}

/// The quaternion of a driven joint in the numbers of a frame.
fn quaternion_of(row: &mut [f64], place: usize) -> &mut [f64] {
    &mut row[3 + 4 * place..7 + 4 * place]
}

fn third([a, b, c, d]: [DVec3; 4]) -> DVec3 {
    d - 3.0 * c + 3.0 * b - a
}

fn is_of_a_leg(joint: Joint) -> bool {
    use Joint::*;
    matches!(
        joint,
        Pelvis | LeftHip | RightHip | LeftKnee | RightKnee | LeftAnkle | RightAnkle
    )
}

fn hinges(bones: &Bones) -> [Hinge; 4] {
    [
        (Joint::LeftElbow, Joint::LeftWrist),
        (Joint::RightElbow, Joint::RightWrist),
        (Joint::LeftKnee, Joint::LeftAnkle),
        (Joint::RightKnee, Joint::RightAnkle),
    ]
    .map(|(joint, end)| {
        let axis = RestPose::hinge(joint).expect("elbows and knees are hinges");
        let axis = DVec3::from(axis.map(f64::from));
        let bone = bones.0[end.index()].normalize_or_zero();
        Hinge {
            joint,
            bone,
            axis,
            ahead: axis.cross(bone),
        }
    })
}

/// For every joint the sum of squared distances to all joints that it moves, in the rest pose.
fn levers(bones: &Bones) -> [f64; JOINTS] {
    let pose = Pose::of(bones, DVec3::ZERO, &[DQuat::IDENTITY; JOINTS]);
    let mut sums = [0.0; JOINTS];
    for joint in Joint::ALL {
        let place = pose.positions[joint.index()];
        for above in std::iter::successors(joint.parent(), |above| above.parent()) {
            sums[above.index()] += place.distance_squared(pose.positions[above.index()]);
        }
    }
    sums
}
