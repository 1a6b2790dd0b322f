//! The body after each pass of a batch.

use std::ops::ControlFlow;

use burn::tensor::Tensor;
use lamogen_guide::{FitProgress, GuidedMotions, LabanComparison, Pass, Rig, Step, TermComparison};
use lamogen_laban::Goals;
use lamogen_model::Denoiser;
use lamogen_motion::Motion;

use super::{BatchRun, StepObserver};
use crate::error::Error;

/// Fits the motions of each pass of the network to a rigid body, if the guidance options say so.
pub(super) struct BodyFitter<'r, 'o, D> {
    pub(super) run: &'r BatchRun<'r, D>,
    pub(super) rig: Rig<'r>,
    pub(super) embedding: &'r Tensor<2>,
    pub(super) observer: StepObserver<'o>,
}

/// The guided motions of a batch, and their Laban features beside the baseline's and the target.
pub(super) struct FinalMotions {
    pub(super) motions: Vec<Motion>,
    /// Features of the whole body.
    pub(super) whole: LabanComparison,
    /// Features of each part of the body that has goals of its own.
    pub(super) parts: Vec<LabanComparison>,
    pub(super) terms: Vec<TermComparison>,
}

impl<D: Denoiser> BodyFitter<'_, '_, D> {
    /// Fits the motions of the first pass. `normalized` are the pose features of these motions.
    pub(super) fn baselines(
        &mut self,
        network_motions: &[Motion],
        normalized: &Tensor<3>,
    ) -> Result<Vec<Motion>, Error> {
        if !self.run.group.is_rigid() {
            return Ok(network_motions.to_vec());
        }
        let mut last_step = 0;
        let mut observer = fit_observer(
            self.embedding,
            normalized,
            &mut self.observer,
            &mut last_step,
        );
        let (rotations, is_stopped) = self.rig.fit(network_motions, &mut observer);
        drop(observer);
        let motions = self.run.rigid_motions(rotations, Pass::Baseline, &[])?;
        match is_stopped {
            true => {
                let steps = self.run.group.guidance.fit.allowed(false);
                let position = (Pass::Body, last_step, steps);
                Err(self.run.stopped(position, &motions, &[], |_| None))
            }
            false => Ok(motions),
        }
    }

    /// Fits and guides the motions of the second pass.
    pub(super) fn guided(
        &mut self,
        network_motions: &[Motion],
        baselines: &[Motion],
        goals: &[Goals],
        guided: &GuidedMotions,
    ) -> Result<FinalMotions, Error> {
        if !self.run.group.is_rigid() {
            return Ok(FinalMotions {
                motions: network_motions.to_vec(),
                whole: guided.whole.clone(),
                parts: guided.parts.clone(),
                terms: guided.terms.clone(),
            });
        }
        let mut last_step = 0;
        let mut observer = fit_observer(
            self.embedding,
            &guided.motion,
            &mut self.observer,
            &mut last_step,
        );
        let rigid = self
            .rig
            .guide(network_motions, baselines, goals, &mut observer);
        drop(observer);
        let rigid = rigid.map_err(|error| self.run.interrupted(error, baselines))?;
        let motions = self
            .run
            .rigid_motions(rigid.rotations, Pass::Guided, baselines)?;
        match rigid.is_stopped {
            true => {
                let steps = self.run.group.guidance.fit.allowed(true);
                let position = (Pass::Body, last_step, steps);
                let prediction = |index: usize| motions.get(index).cloned();
                Err(self
                    .run
                    .stopped(position, baselines, &guided.loss, prediction))
            }
            false => Ok(FinalMotions {
                motions,
                whole: rigid.whole,
                parts: rigid.parts,
                terms: rigid.terms,
            }),
        }
    }
}

/// Makes an observer of a fit that passes the progress on as steps of a run. It writes the number of the last finished
/// step into `last_step`.
fn fit_observer<'s>(
    embedding: &'s Tensor<2>,
    prediction: &'s Tensor<3>,
    observer: &'s mut dyn FnMut(&Step<'_>) -> ControlFlow<()>,
    last_step: &'s mut usize,
) -> impl FnMut(FitProgress) -> ControlFlow<()> + 's {
    move |progress| {
        *last_step = progress.done - 1;
        observer(&Step {
            pass: Pass::Body,
            index: progress.done - 1,
            steps: progress.total,
            timestep: 0,
            loss: None,
            gradient: None,
            embedding,
            prediction,
        })
    }
}
