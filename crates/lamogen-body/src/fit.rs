//! From a motion whose bones may stretch to one of rigid bones, over the whole clip at once.

use std::ops::ControlFlow;

use glam::{DQuat, DVec3};
use lamogen_motion::{FRAMES_PER_SECOND, JOINTS, Joint, Motion, RestPose, Rotations};
use rayon::prelude::*;

use crate::banded::Banded;
use crate::contacts::{Stand, stands};
use crate::descent::Descent;
use crate::pose::{Bones, DRIVEN, Pose, of_quaternion};

/// Numbers of a frame: the root, and a quaternion of every driven joint.
const WIDTH: usize = 3 + 4 * DRIVEN.len();

/// How a motion becomes one of rigid bones.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fit {
    pub evaluations: usize,
    /// m⁻²: distance of a joint from the motion's.
    pub nearness: f64,
    /// Second difference of a joint's quaternion.
    pub rotation: f64,
    /// Third difference of a joint's position.
    pub jerk: f64,
    pub stand: f64,
    pub floor: f64,
    pub hinge: f64,
    pub plane: f64,
    pub prior: f64,
    pub goal: f64,
    pub clearance: f64,
    /// Third difference of a joint's distance from the motion's.
    pub drift: f64,
    pub neck: f64,
    /// Second difference of what a rotation is off the first.
    pub turn: f64,
    /// Turns of a joint between two frames above `fastest` degrees.
    pub haste: f64,
    pub fastest: f64,
}

impl Default for Fit {
    fn default() -> Self {
        Fit {
            evaluations: 60,
            nearness: 1.0,
            rotation: 0.5,
            jerk: 0.3,
            stand: 50.0,
            floor: 50.0,
            hinge: 2.0,
            plane: 0.05,
            prior: 0.002,
            goal: 1.0,
            clearance: 10.0,
            drift: 0.0,
            neck: 1.0,
            turn: 0.0,
            haste: 20.0,
            fastest: 27.0,
        }
    }
}

/// A function of joint positions that a fit lowers besides staying near: what guidance wants.
pub trait Goal {
    /// Value and gradient of every motion: `joints[motion][frame][joint]` in metres.
    fn evaluate(&mut self, joints: &[Vec<[[f32; 3]; JOINTS]>]) -> Vec<(f64, Vec<[[f32; 3]; JOINTS]>)>;
}

/// A limb that bends one way only.
struct Hinge {
    joint: Joint,
    bone: DVec3,
    /// The axis it bends about.
    axis: DVec3,
    /// The way the lower bone goes when it bends.
    ahead: DVec3,
}

fn hinges(bones: &Bones) -> [Hinge; 4] {
    [
        (Joint::LeftElbow, Joint::LeftWrist, DVec3::NEG_Y),
        (Joint::RightElbow, Joint::RightWrist, DVec3::Y),
        (Joint::LeftKnee, Joint::LeftAnkle, DVec3::X),
        (Joint::RightKnee, Joint::RightAnkle, DVec3::X),
    ]
    .map(|(joint, end, axis)| {
        let bone = bones.0[end.index()].normalize_or_zero();
        Hinge {
            joint,
            bone,
            axis,
            ahead: axis.cross(bone).normalize_or_zero(),
        }
    })
}

/// One motion on its way.
struct Track {
    bones: Bones,
    hinges: [Hinge; 4],
    wanted: Vec<[DVec3; JOINTS]>,
    /// How much each frame counts.
    trust: Vec<f64>,
    stands: Vec<Stand>,
    /// How high the ball of each foot is to be at least, at every frame.
    clear: Vec<[f64; 2]>,
    first: Vec<[DQuat; JOINTS]>,
    curvature: Vec<Banded>,
    fit: Fit,
    floor: f64,
    descent: Descent,
}

/// What a trial point is.
struct Trial {
    lengths: Vec<[f64; DRIVEN.len()]>,
    local: Vec<[DQuat; JOINTS]>,
    poses: Vec<Pose>,
}

impl Track {
    fn new(motion: &Motion, rest: &RestPose, floor: f64, fit: Fit) -> Track {
        let bones = Bones::of(rest);
        let rotations = Rotations::on_body(motion, rest);
        let mut first: Vec<[DQuat; JOINTS]> = { rotations.local().iter() }
            .map(|pose| pose.map(|q| DQuat::from_array(q.map(f64::from)).normalize()))
            .collect();
        let wanted: Vec<[DVec3; JOINTS]> = { motion.joints().iter() }
            .map(|pose| pose.map(|point| DVec3::from(point.map(f64::from))))
            .collect();
        let trust = trust(&first);
        bridge(&mut first, &trust);
        let mut point = vec![0.0; WIDTH * wanted.len()];
        for (t, row) in point.chunks_exact_mut(WIDTH).enumerate() {
            row[..3].copy_from_slice(&wanted[t][0].to_array());
            for (k, joint) in DRIVEN.iter().enumerate() {
                let q = first[t][joint.index()].to_array();
                row[3 + 4 * k..7 + 4 * k].copy_from_slice(&q);
            }
        }
        let mut stands = match fit.stand > 0.0 {
            true => stands(motion, floor),
            false => Vec::new(),
        };
        stands.retain(|stand| (stand.from..stand.until).all(|t| trust[t] > 0.5));
        let clear = clearance(&wanted, &stands, floor);
        let mut track = Track {
            clear,
            hinges: hinges(&bones),
            bones,
            wanted,
            trust,
            stands,
            first,
            curvature: Vec::new(),
            fit,
            floor,
            descent: Descent::new(point),
        };
        track.curvature = track.curvatures();
        track
    }

    /// Rough curvatures of the root and of every driven joint.
    fn curvatures(&self) -> Vec<Banded> {
        let frames = self.wanted.len();
        let below = below(&self.bones);
        let mut standing = vec![0.0; frames];
        for stand in &self.stands {
            for t in stand.from..stand.until {
                standing[t] += self.fit.stand;
            }
        }
        let Fit {
            nearness,
            rotation,
            jerk,
            drift,
            prior,
            turn,
            ..
        } = self.fit;
        let rotation = rotation + turn;
        let jerk = jerk + drift;
        let joints = JOINTS as f64;
        let root = Banded::new(
            frames,
            |t| 2.0 * (nearness * self.trust[t] * joints + standing[t]) + 1e-3,
            0.0,
            2.0 * jerk * joints,
        );
        let mut all = vec![root];
        for joint in DRIVEN {
            let lever = below[joint.index()];
            let is_leg = matches!(
                joint,
                Joint::LeftHip
                    | Joint::RightHip
                    | Joint::LeftKnee
                    | Joint::RightKnee
                    | Joint::LeftAnkle
                    | Joint::RightAnkle
                    | Joint::Pelvis
            );
            let own = |t: usize| {
                let stand = if is_leg { 0.25 * standing[t] } else { 0.0 };
                2.0 * (4.0 * nearness * self.trust[t] * lever + stand + prior) + 1e-4
            };
            all.push(Banded::new(
                frames,
                own,
                2.0 * rotation * if joint == Joint::Neck { self.fit.neck } else { 1.0 },
                2.0 * 4.0 * jerk * lever,
            ));
        }
        all
    }

    fn precondition(&self, step: &mut [f64]) {
        for (block, banded) in self.curvature.iter().enumerate() {
            let (offset, width) = match block {
                0 => (0, 3),
                _ => (3 + 4 * (block - 1), 4),
            };
            for i in 0..width {
                banded.solve(step, offset + i, WIDTH);
            }
        }
    }

    fn at(&self, point: &[f64]) -> Trial {
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

    /// Value and gradient without goals; `extra` is a gradient with respect to the positions that is added.
    fn evaluate(&self, trial: &Trial, extra: Option<&[[[f32; 3]; JOINTS]]>) -> (f64, Vec<f64>) {
        let fit = &self.fit;
        let frames = self.wanted.len();
        let mut value = 0.0;
        let mut of_positions = vec![[DVec3::ZERO; JOINTS]; frames];
        for t in 0..frames {
            let gradient = &mut of_positions[t];
            for j in 0..JOINTS {
                let p = trial.poses[t].positions[j];
                let off = p - self.wanted[t][j];
                let weight = fit.nearness * self.trust[t];
                value += weight * off.length_squared();
                gradient[j] += 2.0 * weight * off;
                let depth = self.floor - p.y;
                if depth > 0.0 {
                    value += fit.floor * depth * depth;
                    gradient[j].y -= 2.0 * fit.floor * depth;
                }
            }
            for (foot, low) in FEET.into_iter().zip(self.clear[t]) {
                let missing = low - trial.poses[t].positions[foot.index()].y;
                if missing > 0.0 {
                    value += fit.clearance * missing * missing;
                    gradient[foot.index()].y -= 2.0 * fit.clearance * missing;
                }
            }
            if let Some(extra) = extra {
                for (gradient, extra) in gradient.iter_mut().zip(&extra[t]) {
                    *gradient += DVec3::from(extra.map(f64::from));
                }
            }
        }
        for t in 3..frames {
            for j in 0..JOINTS {
                let [a, b, c, d] = [t - 3, t - 2, t - 1, t].map(|t| trial.poses[t].positions[j]);
                let third = d - 3.0 * c + 3.0 * b - a;
                value += fit.jerk * third.length_squared();
                let [a, b, c, d] = [t - 3, t - 2, t - 1, t].map(|t| self.wanted[t][j]);
                let trusted = self.trust[t].min(self.trust[t - 3]);
                let own = third - (d - 3.0 * c + 3.0 * b - a);
                value += fit.drift * trusted * own.length_squared();
                let g = 2.0 * (fit.jerk * third + fit.drift * trusted * own);
                of_positions[t][j] += g;
                of_positions[t - 1][j] -= 3.0 * g;
                of_positions[t - 2][j] += 3.0 * g;
                of_positions[t - 3][j] -= g;
            }
        }
        for stand in &self.stands {
            let j = stand.joint.index();
            for t in stand.from..stand.until {
                let off = trial.poses[t].positions[j] - DVec3::from(stand.place);
                value += fit.stand * off.length_squared();
                of_positions[t][j] += 2.0 * fit.stand * off;
            }
        }

        // With respect to the quaternions, upright on them or not: that is done at the end.
        let mut gradient = vec![0.0; WIDTH * frames];
        for (t, row) in gradient.chunks_exact_mut(WIDTH).enumerate() {
            let (root, mut turns) = trial.poses[t].pull(&of_positions[t]);
            row[..3].copy_from_slice(&root.to_array());
            for hinge in &self.hinges {
                let j = hinge.joint.index();
                let q = trial.local[t][j];
                let lower = q * hinge.bone;
                let (ahead, aside) = (lower.dot(hinge.ahead), lower.dot(hinge.axis));
                let back = ahead.min(0.0);
                value += fit.hinge * back * back + fit.plane * aside * aside;
                let of_lower = 2.0 * fit.hinge * back * hinge.ahead + 2.0 * fit.plane * aside * hinge.axis;
                turns[j] += q.inverse() * lower.cross(of_lower);
            }
            for (k, joint) in DRIVEN.iter().enumerate() {
                let j = joint.index();
                let q = trial.local[t][j];
                let mut g = of_quaternion(q, turns[j]);
                let off = (q - self.first[t][j]).to_array();
                for (g, off) in g.iter_mut().zip(off) {
                    value += fit.prior * off * off;
                    *g += 2.0 * fit.prior * off;
                }
                row[3 + 4 * k..7 + 4 * k].copy_from_slice(&g);
            }
        }
        for t in 2..frames {
            for (k, joint) in DRIVEN.iter().enumerate() {
                let j = joint.index();
                let [a, b, c] = [t - 2, t - 1, t].map(|t| trial.local[t][j]);
                let second = c + a - b * 2.0;
                let [a, b, c] = [t - 2, t - 1, t].map(|t| self.first[t][j]);
                let off = (second - (c + a - b * 2.0)).to_array();
                let neck = if *joint == Joint::Neck { fit.neck } else { 1.0 };
                for (i, (second, off)) in second.to_array().into_iter().zip(off).enumerate() {
                    value += neck * (fit.rotation * second * second + fit.turn * off * off);
                    let g = 2.0 * neck * (fit.rotation * second + fit.turn * off);
                    let place = 3 + 4 * k + i;
                    gradient[t * WIDTH + place] += g;
                    gradient[(t - 1) * WIDTH + place] -= 2.0 * g;
                    gradient[(t - 2) * WIDTH + place] += g;
                }
            }
        }
        let fastest = 2.0 * (fit.fastest.to_radians() / 4.0).sin();
        for t in 1..frames {
            for (k, joint) in DRIVEN.iter().enumerate() {
                let j = joint.index();
                let step = trial.local[t][j] - trial.local[t - 1][j];
                let length = step.length();
                if length > fastest {
                    let over = length - fastest;
                    value += fit.haste * over * over;
                    for (i, part) in step.to_array().into_iter().enumerate() {
                        let g = 2.0 * fit.haste * over * part / length;
                        gradient[t * WIDTH + 3 + 4 * k + i] += g;
                        gradient[(t - 1) * WIDTH + 3 + 4 * k + i] -= g;
                    }
                }
            }
        }
        // What would change a quaternion's length alone does not count.
        for (t, row) in gradient.chunks_exact_mut(WIDTH).enumerate() {
            for (k, joint) in DRIVEN.iter().enumerate() {
                let q = trial.local[t][joint.index()].to_array();
                let g = &mut row[3 + 4 * k..7 + 4 * k];
                let along: f64 = q.iter().zip(g.iter()).map(|(q, g)| q * g).sum();
                for (g, q) in g.iter_mut().zip(q) {
                    *g = (*g - along * q) / trial.lengths[t][k];
                }
            }
        }
        (value, gradient)
    }

    fn rotations(&self, rest: &RestPose) -> Rotations {
        let trial = self.at(self.descent.point());
        let root = { trial.poses.iter() }
            .map(|pose| pose.positions[0].as_vec3().to_array())
            .collect();
        let local = { trial.local.iter() }
            .map(|pose| pose.map(|q| q.to_array().map(|x| x as f32)))
            .collect();
        Rotations::new(rest.clone(), root, local, FRAMES_PER_SECOND)
    }
}

const FEET: [Joint; 2] = [Joint::LeftFoot, Joint::RightFoot];

/// How high swinging feet are to be.
fn clearance(wanted: &[[DVec3; JOINTS]], stands: &[Stand], floor: f64) -> Vec<[f64; 2]> {
    let frames = wanted.len();
    (0..frames)
        .map(|t| {
            FEET.map(|foot| {
                let upright = wanted[t][0].y - floor > 0.5;
                let stands = stands.iter().any(|s| s.joint == foot && (s.from..s.until).contains(&t));
                if stands || !upright {
                    return f64::NEG_INFINITY;
                }
                let (a, b) = (t.saturating_sub(1), (t + 1).min(frames - 1));
                let mut way = wanted[b][foot.index()] - wanted[a][foot.index()];
                way.y = 0.0;
                let speed = way.length() / (b - a).max(1) as f64 * f64::from(FRAMES_PER_SECOND);
                let x = ((speed - 0.3) / 0.4).clamp(0.0, 1.0);
                floor + 0.06 * x
            })
        })
        .collect()
}

/// Mean over levers: Σ |offset from the joint|² of all joints below it in the rest pose.
fn below(bones: &Bones) -> [f64; JOINTS] {
    let pose = Pose::of(bones, DVec3::ZERO, &[DQuat::IDENTITY; JOINTS]);
    let mut sums = [0.0; JOINTS];
    for joint in Joint::ALL {
        let mut above = joint.parent();
        while let Some(parent) = above {
            sums[parent.index()] +=
                pose.positions[joint.index()].distance_squared(pose.positions[parent.index()]);
            above = parent.parent();
        }
    }
    sums
}

/// Turns of the pelvis between two frames from which on they are a mistake, in radians.
const SNAP: f64 = 0.6;
/// What is left of it a frame.
const BRIDGED: f64 = 0.35;

/// How much each frame is to be believed: little around frames between which the whole body snaps round.
fn trust(local: &[[DQuat; JOINTS]]) -> Vec<f64> {
    let mut trust = vec![1.0; local.len()];
    for t in 1..local.len() {
        let turned = local[t][0].angle_between(local[t - 1][0]);
        if turned > SNAP {
            let half = (turned / BRIDGED / 2.0).ceil() as usize;
            let first = t.saturating_sub(half);
            let last = (t + half).min(local.len());
            trust[first..last].fill(1e-3);
        }
    }
    trust
}

/// Rotations between believed frames, where those between them are not.
fn bridge(local: &mut [[DQuat; JOINTS]], trust: &[f64]) {
    let frames = local.len();
    let mut start = 0;
    for run in trust.chunk_by(|a, b| (*a > 0.5) == (*b > 0.5)) {
        let until = start + run.len();
        if run[0] < 0.5 {
            let before = start.checked_sub(1).map(|t| local[t]);
            let after = (until < frames).then(|| local[until]);
            for t in start..until {
                let part = (t + 1 - start) as f64 / (run.len() + 1) as f64;
                local[t] = match (before, after) {
                    (Some(a), Some(b)) => std::array::from_fn(|j| a[j].slerp(b[j], part)),
                    (Some(only), None) | (None, Some(only)) => only,
                    (None, None) => local[t],
                };
            }
        }
        start = until;
    }
    // Of the two quaternions of a rotation the one next to the frame before.
    for t in 1..frames {
        for j in 0..JOINTS {
            if local[t][j].dot(local[t - 1][j]) < 0.0 {
                local[t][j] = -local[t][j];
            }
        }
    }
}

/// How far a fit has come.
#[derive(Clone, Copy, Debug)]
pub struct Progress<'a> {
    pub evaluation: usize,
    pub values: &'a [f64],
}

impl Fit {
    /// Fits motions to a body.
    pub fn run(
        &self,
        motions: &[&Motion],
        rest: &RestPose,
        mut goal: Option<&mut dyn Goal>,
        watch: &mut dyn FnMut(&Progress<'_>) -> ControlFlow<()>,
    ) -> Vec<Rotations> {
        let mut tracks: Vec<Track> = { motions.par_iter() }
            .map(|motion| Track::new(motion, rest, 0.0, *self))
            .collect();
        for evaluation in 0..self.evaluations {
            let trials: Vec<Trial> = { tracks.par_iter() }
                .map(|track| track.at(track.descent.trial()))
                .collect();
            let wanted = goal.as_deref_mut().map(|goal| {
                let joints: Vec<Vec<[[f32; 3]; JOINTS]>> = { trials.iter() }
                    .map(|trial| {
                        let poses = trial.poses.iter();
                        poses
                            .map(|pose| pose.positions.map(|p| p.as_vec3().to_array()))
                            .collect()
                    })
                    .collect();
                goal.evaluate(&joints)
            });
            tracks.par_iter_mut().enumerate().for_each(|(i, track)| {
                if track.descent.is_done() {
                    return;
                }
                let extra = wanted.as_ref().map(|wanted| &wanted[i]);
                let (mut value, gradient) =
                    track.evaluate(&trials[i], extra.map(|(_, gradient)| &gradient[..]));
                if let Some((extra, _)) = extra {
                    value += extra;
                }
                let mut descent = std::mem::replace(&mut track.descent, Descent::new(Vec::new()));
                descent.tell(value, gradient, &|step| track.precondition(step));
                track.descent = descent;
            });
            let values: Vec<f64> = tracks.iter().map(|track| track.descent.value()).collect();
            let progress = Progress {
                evaluation,
                values: &values,
            };
            if watch(&progress).is_break() || tracks.iter().all(|track| track.descent.is_done()) {
                break;
            }
        }
        tracks.par_iter().map(|track| track.rotations(rest)).collect()
    }
}
