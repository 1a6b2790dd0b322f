//! The variables that guidance may move towards the target, and what one step does to each.
//!
//! ```text
//! Condition    e, or its scales and shifts ──network at a step──▶ clean motion ──▶ loss      at every DDIM step
//! Prediction              clean motion ──▶ loss                    at every DDIM step
//! Motion                  finished motion ──▶ loss                 again and again
//! Noise        z ──all steps of a pass──▶ finished motion ──▶ loss again and again
//! ```

use burn::tensor::Tensor;
use lamogen_model::Denoiser;

use super::adam_variable::AdamVariable;
use super::objective::{LossGradient, MotionPath, NonFinite, Objective};
use crate::guidance::{Guidance, GuidanceVariable, UpdateTiming};
use crate::sampler::{Batch, Latent, Sampler, mix};

/// The result of one step.
pub(super) struct StepOutput {
    /// The loss of each motion before the last update of the step.
    pub(super) loss: Vec<f32>,
    /// The gradient with respect to the embedding or modulation, where that is moved.
    pub(super) gradient: Option<Tensor<2>>,
    /// The current prediction of the clean motions, normalised.
    pub(super) prediction: Tensor<3>,
}

/// A variable that a guided pass moves.
pub(super) trait Variable {
    /// Returns the number of steps.
    fn steps(&self) -> usize;

    /// Returns the timestep at which the network is evaluated in a step; 0 where it is evaluated at none, or at all.
    fn timestep(&self, index: usize) -> usize;

    /// Makes a step.
    fn step(&mut self, index: usize) -> Result<StepOutput, NonFinite>;

    /// Returns the current sentence embedding.
    fn embedding(&self) -> &Tensor<2>;

    /// Returns the motions after the last step, normalised.
    fn finish(self: Box<Self>) -> Tensor<3>;
}

/// The network's condition: the sentence embedding (the paper's method), or the scales and shifts that the stylization layers compute from it.
pub(super) struct Condition<'s, 'a, D: Denoiser> {
    sampler: &'s Sampler<'a, D>,
    objective: &'s Objective<'a>,
    latent: Latent<'s, D::Context>,
    variable: AdamVariable<2>,
    part: ConditionPart,
    guidance: &'s Guidance,
}

/// The part of the condition that is moved.
#[derive(Clone, Copy, Debug)]
pub(super) enum ConditionPart {
    Embedding,
    Modulation,
}

impl<'s, 'a, D: Denoiser> Condition<'s, 'a, D> {
    pub(super) fn new(
        sampler: &'s Sampler<'a, D>,
        objective: &'s Objective<'a>,
        batch: &'s Batch<D::Context>,
        part: ConditionPart,
        guidance: &'s Guidance,
    ) -> Self {
        let latent = sampler.start(batch);
        let start = match part {
            ConditionPart::Embedding => latent.embedding.clone(),
            ConditionPart::Modulation => {
                let shape = [batch.lengths.len(), sampler.model.modulations()];
                Tensor::zeros(shape, &latent.embedding.device())
            }
        };
        let mut condition = Condition {
            sampler,
            objective,
            latent,
            variable: AdamVariable::new(start, guidance),
            part,
            guidance,
        };
        condition.write_to_latent();
        condition
    }

    fn move_down(&mut self, gradient: Tensor<2>, index: usize) {
        let rate = self.guidance.rate(index, self.steps());
        self.variable.update(gradient, rate);
        self.write_to_latent();
    }

    /// Writes the moved tensor to the latent, from which the network reads it.
    fn write_to_latent(&mut self) {
        let value = self.variable.value.clone();
        match self.part {
            ConditionPart::Embedding => self.latent.embedding = value,
            ConditionPart::Modulation => self.latent.modulation = Some(value),
        }
    }

    fn gradient(&self, index: usize) -> Result<LossGradient<2>, NonFinite> {
        let Condition {
            sampler, latent, ..
        } = self;
        let step = &sampler.steps()[index];
        self.objective.gradient(|| {
            let linearized = sampler.linearize(latent, index);
            MotionPath {
                leaf: linearized.output.clone(),
                clean: Box::new(|output| sampler.clean(latent, output, step)),
                pull: Box::new(|gradient| linearized.pull(gradient)),
            }
        })
    }
}

impl<D: Denoiser> Variable for Condition<'_, '_, D> {
    fn steps(&self) -> usize {
        self.sampler.steps().len()
    }

    fn timestep(&self, index: usize) -> usize {
        self.sampler.steps()[index].timestep
    }

    fn step(&mut self, index: usize) -> Result<StepOutput, NonFinite> {
        let mut found = self.gradient(index)?;
        for _ in 1..self.guidance.updates_per_step {
            self.move_down(found.gradient, index);
            found = self.gradient(index)?;
        }
        self.move_down(found.gradient.clone(), index);
        let output = match self.guidance.update {
            UpdateTiming::Lagged => found.leaf,
            UpdateTiming::Immediate => self.sampler.evaluate(&self.latent, index),
        };
        let step = &self.sampler.steps()[index];
        let prediction = self.sampler.clean(&self.latent, output.clone(), step);
        self.latent.x = { self.sampler }.advance(&self.latent, &prediction, output, step);
        Ok(StepOutput {
            loss: found.loss,
            gradient: Some(found.gradient),
            prediction,
        })
    }

    fn embedding(&self) -> &Tensor<2> {
        &self.latent.embedding
    }

    fn finish(self: Box<Self>) -> Tensor<3> {
        self.latent.x
    }
}

/// The clean motion that is predicted at each step (the paper's rival "classifier guidance"). Where it is not updated, the pass is sampled as it is.
pub(super) struct Prediction<'s, 'a, D: Denoiser> {
    sampler: &'s Sampler<'a, D>,
    objective: &'s Objective<'a>,
    latent: Latent<'s, D::Context>,
    guidance: &'s Guidance,
    updates: usize,
}

impl<'s, 'a, D: Denoiser> Prediction<'s, 'a, D> {
    pub(super) fn new(
        sampler: &'s Sampler<'a, D>,
        objective: &'s Objective<'a>,
        batch: &'s Batch<D::Context>,
        guidance: &'s Guidance,
    ) -> Self {
        Prediction {
            sampler,
            objective,
            latent: sampler.start(batch),
            guidance,
            updates: match guidance.variable {
                GuidanceVariable::Nothing => 0,
                _ => guidance.updates_per_step,
            },
        }
    }
}

impl<D: Denoiser> Variable for Prediction<'_, '_, D> {
    fn steps(&self) -> usize {
        self.sampler.steps().len()
    }

    fn timestep(&self, index: usize) -> usize {
        self.sampler.steps()[index].timestep
    }

    fn step(&mut self, index: usize) -> Result<StepOutput, NonFinite> {
        let (sampler, latent) = (self.sampler, &mut self.latent);
        let step = &sampler.steps()[index];
        let output = sampler.evaluate(latent, index);
        let mut prediction = sampler.clean(latent, output.clone(), step);
        // The noise stays what the network saw.
        let noise = sampler.noise(latent, latent.x.clone(), &prediction, output, step);
        let mut loss = match self.updates {
            0 => self.objective.loss_of_motions(prediction.clone()),
            _ => Vec::new(),
        };
        let rate = self.guidance.rate(index, sampler.steps().len());
        for _ in 0..self.updates {
            let found = { self.objective }.gradient(|| identity_path(&prediction))?;
            prediction = prediction - found.gradient * rate;
            loss = found.loss;
        }
        latent.x = mix(&prediction, noise, step);
        Ok(StepOutput {
            loss,
            gradient: None,
            prediction,
        })
    }

    fn embedding(&self) -> &Tensor<2> {
        &self.latent.embedding
    }

    fn finish(self: Box<Self>) -> Tensor<3> {
        self.latent.x
    }
}

/// The finished motion (the paper's rival "raw frame update").
pub(super) struct Motion<'s, 'a> {
    objective: &'s Objective<'a>,
    variable: AdamVariable<3>,
    embedding: &'s Tensor<2>,
    iterations: usize,
    guidance: &'s Guidance,
}

impl<'s, 'a> Motion<'s, 'a> {
    pub(super) fn new(
        objective: &'s Objective<'a>,
        baseline: Tensor<3>,
        embedding: &'s Tensor<2>,
        iterations: usize,
        guidance: &'s Guidance,
    ) -> Self {
        Motion {
            objective,
            variable: AdamVariable::new(baseline, guidance),
            embedding,
            iterations,
            guidance,
        }
    }
}

impl Variable for Motion<'_, '_> {
    fn steps(&self) -> usize {
        self.iterations
    }

    fn timestep(&self, _: usize) -> usize {
        0
    }

    fn step(&mut self, index: usize) -> Result<StepOutput, NonFinite> {
        let found = { self.objective }.gradient(|| identity_path(&self.variable.value))?;
        let rate = self.guidance.rate(index, self.iterations);
        self.variable.update(found.gradient, rate);
        Ok(StepOutput {
            loss: found.loss,
            gradient: None,
            prediction: self.variable.value.clone(),
        })
    }

    fn embedding(&self) -> &Tensor<2> {
        self.embedding
    }

    fn finish(self: Box<Self>) -> Tensor<3> {
        self.variable.value
    }
}

/// The start noise, through all steps of a pass (Karunratanakul et al. 2024).
pub(super) struct Noise<'s, 'a, D: Denoiser> {
    sampler: &'s Sampler<'a, D>,
    objective: &'s Objective<'a>,
    batch: &'s Batch<D::Context>,
    variable: AdamVariable<3>,
    /// 1 where a frame is part of its motion, else 0; none where no motion is padded.
    keep: Option<Tensor<3>>,
    /// The Euclidean length of each motion's noise, `[batch, 1, 1]`, which guidance keeps.
    length: Tensor<3>,
    iterations: usize,
    guidance: &'s Guidance,
}

impl<'s, 'a, D: Denoiser> Noise<'s, 'a, D> {
    pub(super) fn new(
        sampler: &'s Sampler<'a, D>,
        objective: &'s Objective<'a>,
        batch: &'s Batch<D::Context>,
        iterations: usize,
        guidance: &'s Guidance,
    ) -> Self {
        let keep = sampler.start(batch).mask.keep();
        Noise {
            length: length(&batch.noise, &keep),
            keep,
            variable: AdamVariable::new(batch.noise.clone(), guidance),
            sampler,
            objective,
            batch,
            iterations,
            guidance,
        }
    }

    /// Runs a whole pass from the noise and returns the path back to it.
    fn pass(&self) -> MotionPath<'_, 3> {
        let sampler = self.sampler;
        let mut latent = sampler.start(self.batch);
        latent.x = self.variable.value.clone();
        let mut back: Vec<Box<dyn FnOnce(Tensor<3>) -> Tensor<3> + '_>> = Vec::new();
        for (index, step) in sampler.steps().iter().enumerate() {
            let seen = sampler.linearize_motion(&latent, &self.batch.prompt.context, index);
            let (x, output) = (latent.x.clone(), seen.output.clone());
            let prediction = sampler.clean(&latent, output.clone(), step);
            let next = sampler.advance(&latent, &prediction, output.clone(), step);
            let here = latent.clone();
            back.push(Box::new(move |gradient: Tensor<3>| {
                let [x, output] = [x, output].map(|leaf| leaf.autodiff().require_grad());
                let clean = sampler.clean_at(&here, x.clone(), output.clone(), step);
                let noise = sampler.noise(&here, x.clone(), &clean, output.clone(), step);
                let next = mix(&clean, noise, step);
                let mut gradients = (next * gradient.autodiff()).sum().backward();
                let [of_x, of_output] = [x, output].map(|leaf| {
                    let gradient = leaf.grad_remove(&mut gradients);
                    gradient.unwrap_or_else(|| leaf.inner().zeros_like())
                });
                of_x + seen.pull(of_output)
            }));
            latent.x = next;
        }
        MotionPath {
            leaf: latent.x,
            clean: Box::new(|motion| motion),
            pull: Box::new(move |gradient| {
                let steps = back.into_iter().rev();
                steps.fold(gradient, |gradient, step| step(gradient))
            }),
        }
    }
}

impl<D: Denoiser> Variable for Noise<'_, '_, D> {
    fn steps(&self) -> usize {
        self.iterations
    }

    fn timestep(&self, _: usize) -> usize {
        0
    }

    fn step(&mut self, index: usize) -> Result<StepOutput, NonFinite> {
        let found = { self.objective }.gradient(|| self.pass())?;
        let rate = self.guidance.rate(index, self.iterations);
        self.variable.update(found.gradient, rate);
        // Adam would let it grow, and noise of another size is none that the network knows.
        let noise = self.variable.value.clone();
        self.variable.value = noise.clone() * (self.length.clone() / length(&noise, &self.keep));
        Ok(StepOutput {
            loss: found.loss,
            gradient: None,
            prediction: found.leaf,
        })
    }

    fn embedding(&self) -> &Tensor<2> {
        &self.batch.prompt.embedding
    }

    fn finish(self: Box<Self>) -> Tensor<3> {
        let batch = Batch {
            noise: self.variable.value,
            ..self.batch.clone()
        };
        let passed = self.sampler.baseline(&batch, &mut ());
        passed.expect("nobody watches who could stop it")
    }
}

/// Returns the path of motions to themselves.
fn identity_path<'w>(motion: &Tensor<3>) -> MotionPath<'w, 3> {
    MotionPath {
        leaf: motion.clone(),
        clean: Box::new(|motion| motion),
        pull: Box::new(|gradient| gradient),
    }
}

/// Returns the Euclidean length of each motion's numbers, `[batch, 1, 1]`.
fn length(noise: &Tensor<3>, keep: &Option<Tensor<3>>) -> Tensor<3> {
    let squares = noise.clone().square().sum_dim(2);
    let squares = match keep {
        Some(keep) => squares * keep.clone(),
        None => squares,
    };
    squares.sum_dim(1).sqrt()
}
