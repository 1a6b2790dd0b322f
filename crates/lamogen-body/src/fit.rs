//! From motions whose bones may stretch to motions of rigid bones, each over its whole length at once.

use std::ops::ControlFlow;

use lamogen_motion::{JOINTS, Motion, RestPose, Rotations};
use rayon::prelude::*;

use crate::options::FitOptions;
use crate::track::{Track, Trial};

/// A motion to fit, and the body that it shall be on.
#[derive(Clone, Copy, Debug)]
pub struct FitInput<'a> {
    /// The motion; contacts of its pose features are heard, if it has some.
    pub motion: &'a Motion,
    /// The bones. Those of the motion keep their directions and get these lengths.
    pub body: &'a RestPose,
    /// How high the ground is, in metres.
    pub ground: f64,
}

/// What came of a fit.
#[derive(Clone, Debug)]
pub struct FitResult {
    /// The rotations of every motion.
    pub rotations: Vec<Rotations>,
    /// Whether the fit was stopped before its end; the rotations are the best ones until then.
    pub is_stopped: bool,
}

/// Something that motions shall reach, as a function of their joints that a fit makes small.
pub trait FitObjective {
    /// The value of every motion and its gradient with respect to the positions: `joints[motion][frame][joint]` in metres. A value that
    /// is not finite is stepped back from.
    fn evaluate(
        &mut self,
        joints: &[Vec<[[f32; 3]; JOINTS]>],
    ) -> Vec<(f64, Vec<[[f32; 3]; JOINTS]>)>;
}

/// How far a fit has come.
#[derive(Clone, Copy, Debug)]
pub struct FitProgress {
    /// Evaluations made.
    pub done: usize,
    /// Evaluations that are allowed; it may end earlier.
    pub total: usize,
}

impl FitOptions {
    /// Evaluations that are allowed.
    pub fn allowed(&self, has_goal: bool) -> usize {
        match has_goal {
            true => self.goal_evaluations,
            false => self.evaluations,
        }
    }

    /// Fits motions to bodies. Where there is a goal, they are drawn towards it, as far from the motions as it takes and no further.
    ///
    /// Motions of a call do not touch each other: each becomes what it becomes alone, as far as the goal's values are those that it has
    /// alone. Sums run in an order of their own, so that results do not depend on the number of threads.
    ///
    /// `watch` is called after every evaluation and may stop the fit, which then gives the best until there.
    ///
    /// # Panics
    ///
    /// If the goal gives no value and gradient for each motion.
    pub fn run(
        &self,
        inputs: &[FitInput<'_>],
        mut goal: Option<&mut dyn FitObjective>,
        watch: &mut dyn FnMut(FitProgress) -> ControlFlow<()>,
    ) -> FitResult {
        let total = self.allowed(goal.is_some());
        let mut tracks: Vec<Track> = { inputs.par_iter() }
            .map(|input| Track::new(input, *self))
            .collect();
        let mut is_stopped = false;
        for evaluation in 0..total {
            let trials: Vec<Trial> = tracks.par_iter().map(Track::trial).collect();
            let goals = goal.as_deref_mut().map(|goal| {
                let joints: Vec<_> = trials.iter().map(Trial::joints).collect();
                goal.evaluate(&joints)
            });
            tracks
                .par_iter_mut()
                .enumerate()
                .for_each(|(place, track)| {
                    if !track.descent.is_done() {
                        track.advance(&trials[place], goals.as_ref().map(|goals| &goals[place]));
                    }
                });
            is_stopped = watch(FitProgress {
                done: evaluation + 1,
                total,
            })
            .is_break();
            if is_stopped || tracks.iter().all(|track| track.descent.is_done()) {
                break;
            }
        }
        FitResult {
            rotations: tracks.par_iter().map(Track::rotations).collect(),
            is_stopped,
        }
    }
}

/// How high the ground is under a motion, in metres: as low as the balls of its feet come, but for the lowest fiftieth of the frames, which may be
/// mistakes.
pub fn ground(motion: &Motion) -> f64 {
    let lowest = |pose: &[[f32; 3]; JOINTS]| {
        let heights = crate::contacts::FEET.map(|foot| pose[foot.index()][1]);
        f64::from(heights[0].min(heights[1]))
    };
    let mut heights: Vec<f64> = motion.joints().iter().map(lowest).collect();
    let place = heights.len() / 50;
    *heights.select_nth_unstable_by(place, f64::total_cmp).1
}
