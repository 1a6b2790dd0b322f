//! The guided pass.
//!
//! ```text
//! baseline, scales ──Objective──▶ loss ──▶ one step of a Subject ──▶ … ──▶ motions ──▶ one step of the finish ──▶ … ──▶ motions
//! ```

mod objective;
mod optimised;
mod subjects;

use burn::tensor::Tensor;
use lamogen_laban::Goals;
use lamogen_model::Denoiser;

use crate::error::GuideError;
use crate::guidance::{Guidance, GuidanceVariable};
use crate::observer::{Observer, Pass, Step};
use crate::sampler::{Batch, Sampler};
pub use objective::LabanComparison;
pub(crate) use objective::Targets;
use objective::{Broken, Objective};
use subjects::{Condition, Subject, Told};

/// What the guided pass gives.
#[derive(Clone, Debug)]
pub struct Guided {
    /// The motions, normalised, `[batch, frames, features]`.
    pub motion: Tensor<3>,
    /// Laban features of the whole body.
    pub whole: LabanComparison,
    /// Those of the parts that any motion of the batch asks something of, and of what is the rest of the body to it.
    pub parts: Vec<LabanComparison>,
    /// The Laban loss of each motion at every step: `[step][motion]`.
    pub loss: Vec<Vec<f32>>,
}

impl<D: Denoiser> Sampler<'_, D> {
    /// Pass 2: from the same noise towards the scaled Laban features of the baseline (paper,
    /// section "Step 2: Laban-Guided Generation").
    ///
    /// `baseline` is what [`baseline`](Sampler::baseline) gave for the same batch; there are
    /// goals for each motion, such as a scale. Motions are the network's, with bones that may stretch, and measured as such; what
    /// [`Body::Rig`](crate::Body::Rig) asks for is done by [`Rig`](crate::Rig) afterwards, instead of [`Guidance::finish`].
    ///
    /// # Errors
    ///
    /// If an option makes no sense, the network has no scales and shifts to move, the observer stops the run, or a loss or gradient is not
    /// finite.
    ///
    /// # Panics
    ///
    /// If noise, lengths, prompts, baseline and goals are not of as many motions, or a length is 0 or
    /// beyond the noise's frames.
    pub fn guided(
        &self,
        batch: &Batch<D::Context>,
        baseline: Tensor<3>,
        goals: &[Goals],
        guidance: &Guidance,
        observer: &mut dyn Observer,
    ) -> Result<Guided, GuideError> {
        guidance.check()?;
        let lengths = &batch.lengths;
        let objective = Objective::new(
            self.normalization,
            baseline.clone(),
            lengths,
            goals,
            guidance,
        );
        let told = match guidance.laban_condition {
            true => Some(self.told(batch, &objective)?),
            false => None,
        };
        let batch = told.as_ref().unwrap_or(batch);
        let steps = guidance.steps(self.steps().len());
        let mut course = Course::new(steps, observer);
        let told = &batch.prompt.embedding;
        let subject = self.subject(&objective, batch, (baseline, told), guidance)?;
        let (mut motion, embedding) = course.follow(subject)?;
        if let Some(finish) = guidance.network_finish() {
            let own = finish.alone(guidance);
            let subject = self.subject(&objective, batch, (motion, &embedding), &own)?;
            (motion, _) = course.follow(subject)?;
        }
        let loss = course.loss;
        let mut reached = objective.reached(motion.clone()).into_iter();
        Ok(Guided {
            motion,
            whole: reached.next().expect("the whole body is a term"),
            parts: reached.collect(),
            loss,
        })
    }

    /// A batch whose network is told the features to reach.
    fn told(
        &self,
        batch: &Batch<D::Context>,
        objective: &Objective<'_>,
    ) -> Result<Batch<D::Context>, GuideError> {
        let means = objective.told(&batch.lengths);
        let added = self.model.embed_laban(&means);
        let added = added.ok_or(GuideError::NoLabanCondition)?;
        let mut told = batch.clone();
        told.prompt.embedding = told.prompt.embedding + added;
        Ok(told)
    }

    /// What guidance moves. Where that is a finished motion, it is the one given, made with the embedding beside it.
    fn subject<'s>(
        &'s self,
        objective: &'s Objective<'_>,
        batch: &'s Batch<D::Context>,
        (motion, embedding): (Tensor<3>, &'s Tensor<2>),
        guidance: &'s Guidance,
    ) -> Result<Box<dyn Subject + 's>, GuideError> {
        let condition = |told| -> Box<dyn Subject + 's> {
            Box::new(Condition::new(self, objective, batch, told, guidance))
        };
        Ok(match guidance.variable {
            GuidanceVariable::Embedding => condition(Told::Embedding),
            GuidanceVariable::Modulation => match self.model.modulations() {
                0 => return Err(GuideError::NoModulation),
                _ => condition(Told::Modulation),
            },
            GuidanceVariable::Prediction | GuidanceVariable::Nothing => {
                Box::new(subjects::Prediction::new(self, objective, batch, guidance))
            }
            GuidanceVariable::Motion { iterations } => Box::new(subjects::Motion::new(
                objective, motion, embedding, iterations, guidance,
            )),
            GuidanceVariable::Noise { iterations } => Box::new(subjects::Noise::new(
                self, objective, batch, iterations, guidance,
            )),
        })
    }
}

/// The steps of a pass, one subject's after another's.
struct Course<'o> {
    steps: usize,
    /// Of each motion at every step so far.
    loss: Vec<Vec<f32>>,
    observer: &'o mut dyn Observer,
}

impl<'o> Course<'o> {
    fn new(steps: usize, observer: &'o mut dyn Observer) -> Self {
        Course {
            steps,
            loss: Vec::new(),
            observer,
        }
    }

    /// All steps of a subject; the motions that come of them, and the embeddings that stand at the end.
    fn follow(
        &mut self,
        mut subject: Box<dyn Subject + '_>,
    ) -> Result<(Tensor<3>, Tensor<2>), GuideError> {
        let (before, steps) = (self.loss.len(), self.steps);
        for own in 0..subject.steps() {
            let (index, timestep) = (before + own, subject.timestep(own));
            let made = subject.step(own).map_err(|broken| {
                let Broken {
                    quantity,
                    component,
                    motion,
                } = broken;
                GuideError::NotFinite {
                    quantity,
                    component,
                    index,
                    steps,
                    timestep,
                    motion,
                }
            })?;
            self.loss.push(made.loss);
            let step = Step {
                pass: Pass::Guided,
                index,
                steps,
                timestep,
                loss: self.loss.last().map(Vec::as_slice),
                gradient: made.gradient.as_ref(),
                embedding: subject.embedding(),
                prediction: &made.prediction,
            };
            if self.observer.step(&step).is_break() {
                return Err(GuideError::stopped(&step, &self.loss));
            }
        }
        let embedding = subject.embedding().clone();
        Ok((subject.finish(), embedding))
    }
}
