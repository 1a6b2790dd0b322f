//! Fits motions whose bones may stretch to rigid bodies, each motion over its whole length at once.

use std::ops::ControlFlow;

use lamogen_motion::{JOINTS, Motion, RestPose, Rotations};
use rayon::prelude::*;

use crate::held::hold_start;
use crate::options::FitOptions;
use crate::pose::{positions, rotations_on};
use crate::track::{FitEvaluation, MotionFit, TrialMotion};

/// A motion to fit, and the body to fit it to.
#[derive(Clone, Copy, Debug)]
pub struct FitInput<'a> {
    /// The motion. If it has pose features, their foot contacts are taken into account.
    pub motion: &'a Motion,
    /// The body, whose bone lengths the fitted motion gets. Bones keep the directions that they have in the motion.
    pub body: &'a RestPose,
    /// The height of the ground, in metres.
    pub ground: f64,
    /// The frames with which the result begins, on the same body and where the motion is: the fit leaves them as they are, and
    /// goes on from them. `None` where all frames are fitted, as always in a loop.
    pub start: Option<&'a Rotations>,
}

impl FitInput<'_> {
    /// Returns the joint positions at which a fit begins, in metres: those of the motion on the body, after the frames that the
    /// result begins with. Nothing is fitted yet.
    pub fn joints(&self) -> Vec<[[f32; 3]; JOINTS]> {
        let mut poses = positions(&rotations_on(self.motion, self.body));
        if let Some(start) = self.start {
            hold_start(start, &mut poses);
        }
        let poses = poses.into_iter();
        poses
            .map(|pose| pose.map(|point| point.as_vec3().to_array()))
            .collect()
    }
}

/// The result of a fit.
#[derive(Clone, Debug)]
pub struct FitResult {
    /// The rotations of every motion, in the order of the inputs.
    pub rotations: Vec<Rotations>,
    /// Whether the fit was stopped before its end. The rotations are then the best ones found until the stop.
    pub is_stopped: bool,
}

/// An objective, as a function of joint positions, that a fit minimises together with its own terms.
pub trait FitObjective: Send {
    /// Returns the value of every motion and its gradient with respect to the joint positions, which are
    /// `joints[motion][frame][joint]` in metres. If a value is not finite, the fit rejects the step and tries a shorter
    /// one.
    fn evaluate(
        &mut self,
        joints: &[Vec<[[f32; 3]; JOINTS]>],
    ) -> Vec<(f64, Vec<[[f64; 3]; JOINTS]>)>;

    /// Takes the travel of a cycle of a motion that is a loop, `[x, y, z]` in metres. It is called before the first evaluation, for
    /// loops only. The default does nothing.
    fn set_loop_travel(&mut self, motion: usize, travel: [f64; 3]) {
        let _ = (motion, travel);
    }

    /// Returns the frames of a motion at which the objective counts far more than all terms of the fit, such as those of a
    /// place that a hand has to reach. A fit makes its steps shorter there. The default returns none.
    fn stiff_frames(&self, motion: usize) -> Vec<usize> {
        let _ = motion;
        Vec::new()
    }
}

/// The progress of a fit.
#[derive(Clone, Copy, Debug)]
pub struct FitProgress {
    /// The number of evaluations made.
    pub done: usize,
    /// The largest number of evaluations; the fit may end earlier.
    pub total: usize,
}

impl FitOptions {
    /// Returns the largest number of evaluations with or without a goal.
    pub fn allowed(&self, has_goal: bool) -> usize {
        match has_goal {
            true => self.goal_evaluations,
            false => self.evaluations,
        }
    }

    /// Fits motions to bodies. If there is a goal, the motions are also drawn towards it, and leave the input motions no
    /// further than the goal requires.
    ///
    /// The motions of a call do not influence each other: each result is the same as in a call with that motion alone,
    /// provided that the goal gives it the same values. Every sum has a fixed order, so that results do not depend on the
    /// number of threads.
    ///
    /// `on_progress` is called after every evaluation and may stop the fit, which then returns the best result so far.
    ///
    /// # Panics
    ///
    /// If the goal does not return one value and gradient for each motion.
    pub fn run(
        &self,
        inputs: &[FitInput<'_>],
        mut goal: Option<&mut dyn FitObjective>,
        on_progress: &mut dyn FnMut(FitProgress) -> ControlFlow<()>,
    ) -> FitResult {
        let total = self.allowed(goal.is_some());
        let stiff_frames = |motion| match goal.as_deref() {
            Some(goal) => goal.stiff_frames(motion),
            None => Vec::new(),
        };
        let stiff_frames: Vec<Vec<usize>> = (0..inputs.len()).map(stiff_frames).collect();
        let mut fits: Vec<MotionFit> = { inputs.par_iter().zip(&stiff_frames) }
            .map(|(input, stiff_frames)| MotionFit::new(input, *self, stiff_frames))
            .collect();
        if let Some(goal) = &mut goal {
            let travels = { fits.iter().enumerate() }
                .filter_map(|(motion, fit)| Some((motion, fit.loop_travel()?)));
            travels.for_each(|(motion, travel)| goal.set_loop_travel(motion, travel));
        }
        let mut is_stopped = false;
        for evaluation in 0..total {
            let trials: Vec<TrialMotion> = fits.par_iter().map(MotionFit::trial).collect();
            // The goal and the fits' own terms do not depend on each other.
            let (goal_values, evaluations) = rayon::join(
                || {
                    goal.as_deref_mut().map(|goal| {
                        let joints: Vec<_> = trials.iter().map(TrialMotion::joints).collect();
                        goal.evaluate(&joints)
                    })
                },
                || -> Vec<Option<FitEvaluation>> {
                    let pairs = fits.par_iter().zip(&trials);
                    let evaluate = |(fit, trial): (&MotionFit, &TrialMotion)| {
                        (!fit.is_done()).then(|| fit.evaluate(trial))
                    };
                    pairs.map(evaluate).collect()
                },
            );
            let evaluations = evaluations.into_par_iter().enumerate();
            { fits.par_iter_mut().zip(evaluations) }.for_each(|(fit, (index, evaluation))| {
                if let Some(evaluation) = evaluation {
                    let goal_value = goal_values.as_ref().map(|values| &values[index]);
                    fit.advance(&trials[index], evaluation, goal_value);
                }
            });
            is_stopped = on_progress(FitProgress {
                done: evaluation + 1,
                total,
            })
            .is_break();
            if is_stopped || fits.iter().all(MotionFit::is_done) {
                break;
            }
        }
        FitResult {
            rotations: fits.par_iter().map(MotionFit::rotations).collect(),
            is_stopped,
        }
    }
}

/// How much further down than the balls of the feet the rest of a body may be where these touch the ground, in metres: as a hand is
/// beside a foot on a stair.
const BELOW_FEET: f64 = 0.2;

/// Estimates the height of the ground under a motion, in metres. It is the height down to which the balls of the feet
/// come, without the lowest fiftieth of the frames, which may be mistakes. Where the rest of the body is far below them all the time,
/// as in a handstand or on the back with raised legs, it is the height down to which the lowest joint comes.
pub fn ground(motion: &Motion) -> f64 {
    let lowest_of = |height: &dyn Fn(&[[f32; 3]; JOINTS]) -> f32| {
        let mut heights: Vec<f64> = { motion.joints().iter() }
            .map(|pose| f64::from(height(pose)))
            .collect();
        let rank = heights.len() / 50;
        *heights.select_nth_unstable_by(rank, f64::total_cmp).1
    };
    let feet = lowest_of(&|pose| {
        let heights = crate::contacts::FEET.map(|foot| pose[foot.index()][1]);
        heights[0].min(heights[1])
    });
    let body = lowest_of(&|pose| {
        let heights = pose.iter().map(|joint| joint[1]);
        heights.fold(f32::INFINITY, f32::min)
    });
    if body < feet - BELOW_FEET { body } else { feet }
}
