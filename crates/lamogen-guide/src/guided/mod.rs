//! The guided pass.
//!
//! ```text
//! baseline, goals ──Objective──▶ loss ──▶ steps of a Variable ──▶ motions ──▶ steps of the finish ──▶ motions
//! ```

mod adam_variable;
mod objective;
mod variables;

use burn::tensor::Tensor;
use lamogen_laban::Goals;
use lamogen_model::Denoiser;

use crate::error::GuideError;
use crate::guidance::{Guidance, GuidanceVariable};
use crate::loss_term::TermComparison;
use crate::observer::{Observer, Pass, Step};
use crate::places::RootPlan;
use crate::sampler::{Batch, Sampler};
pub use objective::LabanComparison;
pub(crate) use objective::{Comparisons, HeldFrames, Targets};
use objective::{NonFinite, Objective};
use variables::{ConditionPart, ConditioningVariable, Variable};

/// The result of a guided pass.
#[derive(Clone, Debug)]
pub struct GuidedMotions {
    /// The motions, normalised, `[batch, frames, features]`.
    pub motion: Tensor<3>,
    /// The Laban features of the whole body.
    pub whole: LabanComparison,
    /// The Laban features of each part of the body that any motion of the batch has goals for, and of the rest of the
    /// body beside it.
    pub parts: Vec<LabanComparison>,
    /// The values of the terms of [`Guidance::loss_terms`], and then of [`Guidance::places`].
    pub terms: Vec<TermComparison>,
    /// The loss of each motion at every step, over all terms: `[step][motion]`.
    pub loss: Vec<Vec<f32>>,
}

impl<D: Denoiser> Sampler<'_, D> {
    /// Runs pass 2: from the same noise towards the goals, such as the baseline's Laban features times a scale (paper,
    /// section "Step 2: Laban-Guided Generation").
    ///
    /// `baseline` is the result of [`baseline`](Sampler::baseline) for the same batch; `goals` holds the goals of
    /// each motion. Motions are those of the network: their bones may stretch, and they are measured without a rigid
    /// body. With [`Body::Rig`](crate::Body::Rig), [`Rig`](crate::Rig) turns them into motions of a rigid body
    /// afterwards, and there is no [`Guidance::finish`].
    ///
    /// # Errors
    ///
    /// If an option or a loss term is invalid, the network lacks the scales and shifts or tokens to move or the Laban condition
    /// to set, the observer stops the run, or a loss or gradient is not finite.
    ///
    /// # Panics
    ///
    /// If noise, lengths, prompts, baseline and goals differ in the number of motions, or a length is 0 or
    /// larger than the number of frames of the noise.
    pub fn guided(
        &self,
        batch: &Batch<D::Context>,
        baseline: Tensor<3>,
        goals: &[Goals],
        guidance: &Guidance,
        observer: &mut dyn Observer,
    ) -> Result<GuidedMotions, GuideError> {
        guidance.check()?;
        let lengths = &batch.lengths;
        let objective = Objective::new(
            self.normalization,
            baseline.clone(),
            lengths,
            goals,
            guidance,
        )?;
        let conditioned = match guidance.laban_condition {
            true => Some(self.with_laban_condition(batch, &objective)?),
            false => None,
        };
        let batch = conditioned.as_ref().unwrap_or(batch);
        // Windows begin at the origin of their own, so the way of the root is planned for whole motions only.
        let root_plan = match self.model.window() {
            None => RootPlan::new(
                &guidance.places,
                guidance.place_origin.as_ref(),
                lengths,
                self.normalization,
            ),
            Some(_) => None,
        };
        let planned = self.with_root_plan(root_plan);
        let steps = guidance.steps(self.steps().len() * self.windows(batch));
        let mut pass = GuidedPass::new(steps, observer);
        let embedding = &batch.prompt.embedding;
        let variable = planned.variable(&objective, batch, (baseline, embedding), guidance)?;
        let (mut motion, embedding) = pass.run(variable)?;
        if let Some(finish) = guidance.network_finish() {
            let guidance = finish.alone(guidance);
            let variable = planned.variable(&objective, batch, (motion, &embedding), &guidance)?;
            (motion, _) = pass.run(variable)?;
        }
        let loss = pass.loss;
        let Comparisons {
            whole,
            parts,
            terms,
        } = objective.compare(motion.clone());
        Ok(GuidedMotions {
            motion,
            whole,
            parts,
            terms,
            loss,
        })
    }

    /// Returns the batch with the Laban features to reach added to the network's condition.
    fn with_laban_condition(
        &self,
        batch: &Batch<D::Context>,
        objective: &Objective<'_>,
    ) -> Result<Batch<D::Context>, GuideError> {
        let means = objective.laban_means(&batch.lengths);
        let added = self.model.embed_laban(&means);
        let added = added.ok_or(GuideError::NoLabanCondition)?;
        let mut batch = batch.clone();
        batch.prompt.embedding = batch.prompt.embedding + added;
        Ok(batch)
    }

    /// Returns the variable that guidance moves. A variable that is a finished motion starts at `motion`, which was
    /// generated with `embedding`.
    fn variable<'s>(
        &'s self,
        objective: &'s Objective<'_>,
        batch: &'s Batch<D::Context>,
        (motion, embedding): (Tensor<3>, &'s Tensor<2>),
        guidance: &'s Guidance,
    ) -> Result<Box<dyn Variable + 's>, GuideError> {
        let condition = |part, motion| -> Box<dyn Variable + 's> {
            Box::new(ConditioningVariable::new(
                self, objective, batch, motion, part, guidance,
            ))
        };
        Ok(match guidance.variable {
            GuidanceVariable::Embedding => condition(ConditionPart::Embedding, motion),
            GuidanceVariable::Modulation => match self.model.modulation_width() {
                0 => return Err(GuideError::NoModulation),
                _ => condition(ConditionPart::Modulation, motion),
            },
            GuidanceVariable::Tokens => match self.model.token_offset_width() {
                0 => return Err(GuideError::NoTokens),
                _ => condition(ConditionPart::Tokens, motion),
            },
            GuidanceVariable::Prediction | GuidanceVariable::None => Box::new(
                variables::PredictionVariable::new(self, objective, batch, motion, guidance),
            ),
            GuidanceVariable::Motion { iterations } => Box::new(variables::MotionVariable::new(
                objective, motion, embedding, iterations, guidance,
            )),
            GuidanceVariable::Noise { .. } if self.model.window().is_some() => {
                return Err(GuideError::NoStartNoise);
            }
            GuidanceVariable::Noise { iterations } => Box::new(variables::NoiseVariable::new(
                self, objective, batch, iterations, guidance,
            )),
        })
    }
}

/// The steps of a guided pass, those of one variable after those of another.
struct GuidedPass<'o> {
    steps: usize,
    /// The loss of each motion at every step so far.
    loss: Vec<Vec<f32>>,
    observer: &'o mut dyn Observer,
}

impl<'o> GuidedPass<'o> {
    fn new(steps: usize, observer: &'o mut dyn Observer) -> Self {
        GuidedPass {
            steps,
            loss: Vec::new(),
            observer,
        }
    }

    /// Makes all steps of a variable. Returns the final motions and embeddings.
    fn run(
        &mut self,
        mut variable: Box<dyn Variable + '_>,
    ) -> Result<(Tensor<3>, Tensor<2>), GuideError> {
        let (before, steps) = (self.loss.len(), self.steps);
        for variable_step in 0..variable.steps() {
            let index = before + variable_step;
            let timestep = variable.timestep(variable_step);
            let output = variable.step(variable_step).map_err(|non_finite| {
                let NonFinite {
                    quantity,
                    value,
                    motion,
                } = non_finite;
                GuideError::NotFinite {
                    quantity,
                    value,
                    index,
                    steps,
                    timestep,
                    motion,
                }
            })?;
            self.loss.push(output.loss);
            let step = Step {
                pass: Pass::Guided,
                index,
                steps,
                timestep,
                loss: self.loss.last().map(Vec::as_slice),
                gradient: output.gradient.as_ref(),
                embedding: variable.embedding(),
                prediction: &output.prediction,
            };
            if self.observer.step(&step).is_break() {
                return Err(GuideError::stopped(&step, &self.loss));
            }
        }
        let embedding = variable.embedding().clone();
        Ok((variable.finish(), embedding))
    }
}
