//! The variables that guidance can move towards the target, and one step of each.
//!
//! ```text
//! ConditioningVariable    e, or offsets in the layers  ──network at a step──▶ clean motion ──▶ loss    at every DDIM step
//! PredictionVariable                                                      clean motion ──▶ loss    at every DDIM step
//! MotionVariable                                                       finished motion ──▶ loss    at every iteration
//! NoiseVariable        z ──all steps of a pass───────────────────────▶ finished motion ──▶ loss    at every iteration
//! ```

use std::ops::Range;

use burn::tensor::Tensor;
use lamogen_model::Denoiser;

use super::adam_variable::AdamVariable;
use super::objective::{LossGradient, MotionPath, NonFinite, Objective};
use crate::guidance::{Guidance, GuidanceVariable, UpdateTiming};
use crate::sampler::{Batch, Sampler, SamplerState};
use crate::windows::WindowChain;

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

    /// Returns the timestep at which the network is evaluated in a step; 0 if it is evaluated at no timestep or at all
    /// of them.
    fn timestep(&self, index: usize) -> usize;

    /// Makes one step.
    fn step(&mut self, index: usize) -> Result<StepOutput, NonFinite>;

    /// Returns the current sentence embedding.
    fn embedding(&self) -> &Tensor<2>;

    /// Returns the motions after the last step, normalised.
    fn finish(self: Box<Self>) -> Tensor<3>;
}

/// The network's condition: the sentence embedding (the paper's method), or offsets of the scales and shifts that the
/// stylization layers compute from the embedding, or offsets of the tokens that carry it.
///
/// A network that continues motions makes all steps of a window before it begins with the next, and each window begins with
/// the prompt as it was. The loss is that of the whole motion, with the windows that are not made yet as in the baseline.
pub(super) struct ConditioningVariable<'s, 'a, D: Denoiser> {
    sampler: &'s Sampler<'a, D>,
    objective: &'s Objective<'a>,
    batch: &'s Batch<D::Context>,
    baseline: Tensor<3>,
    chain: WindowChain,
    state: SamplerState<'s, D::Context>,
    variable: AdamVariable<2>,
    part: ConditionPart,
    guidance: &'s Guidance,
}

/// The part of the condition that is moved.
#[derive(Clone, Copy, Debug)]
pub(super) enum ConditionPart {
    Embedding,
    Modulation,
    Tokens,
}

impl<'s, 'a, D: Denoiser> ConditioningVariable<'s, 'a, D> {
    pub(super) fn new(
        sampler: &'s Sampler<'a, D>,
        objective: &'s Objective<'a>,
        batch: &'s Batch<D::Context>,
        baseline: Tensor<3>,
        part: ConditionPart,
        guidance: &'s Guidance,
    ) -> Self {
        let state = sampler.initial_state(batch);
        let mut condition = ConditioningVariable {
            sampler,
            objective,
            batch,
            baseline,
            chain: sampler.chain(),
            variable: AdamVariable::new(part.start(sampler, &state), guidance),
            state,
            part,
            guidance,
        };
        condition.write_to_state();
        condition
    }

    /// Begins with the next window.
    fn begin_window(&mut self) {
        self.chain.push(self.state.x.clone());
        self.state = self.sampler.window_state(self.batch, &self.chain);
        let start = self.part.start(self.sampler, &self.state);
        self.variable = AdamVariable::new(start, self.guidance);
        self.write_to_state();
    }

    /// Updates the variable by a gradient.
    fn update(&mut self, gradient: Tensor<2>, index: usize) {
        let steps = self.sampler.steps().len();
        let rate = self.guidance.learning_rate_at(index, steps);
        self.variable.update(gradient, rate);
        self.write_to_state();
    }

    /// Writes the variable to the sampler's state, from which the network reads it.
    fn write_to_state(&mut self) {
        let value = self.variable.value.clone();
        match self.part {
            ConditionPart::Embedding => self.state.embedding = value,
            ConditionPart::Modulation | ConditionPart::Tokens => {
                let [batch, _] = value.dims();
                let zeros = |width| Tensor::zeros([batch, width], &value.device());
                let (range, width) = self.part.offsets(self.sampler.model);
                let parts = [
                    (range.start > 0).then(|| zeros(range.start)),
                    Some(value.clone()),
                    (range.end < width).then(|| zeros(width - range.end)),
                ];
                let parts: Vec<_> = parts.into_iter().flatten().collect();
                self.state.modulation = Some(Tensor::cat(parts, 1));
            }
        }
    }

    /// Computes the loss at a step and its gradient with respect to the variable.
    fn loss_gradient(&self, index: usize) -> Result<LossGradient<2>, NonFinite> {
        let ConditioningVariable {
            sampler,
            state,
            part,
            ..
        } = self;
        let step = &sampler.steps()[index];
        let (range, _) = part.offsets(sampler.model);
        self.objective.gradient(|| {
            let linearized = sampler.linearize(state, index);
            MotionPath {
                leaf: linearized.output.clone(),
                unconditional: linearized.unconditional.clone(),
                clean: Box::new(|output| {
                    let clean = sampler.clean_motion(state, output, step);
                    self.chain.within(clean, &self.baseline)
                }),
                pull: {
                    let range = range.clone();
                    Box::new(move |gradient| {
                        let gradient = linearized.pull(gradient);
                        match part {
                            ConditionPart::Embedding => gradient,
                            _ => gradient.narrow(1, range.start, range.len()),
                        }
                    })
                },
            }
        })
    }
}

impl ConditionPart {
    /// Returns the place of the part among all offsets that a network adds, and their number.
    fn offsets(self, model: &impl Denoiser) -> (Range<usize>, usize) {
        let modulations = model.modulation_width();
        let all = modulations + model.token_offset_width();
        let range = match self {
            ConditionPart::Embedding => 0..0,
            ConditionPart::Modulation => 0..modulations,
            ConditionPart::Tokens => modulations..all,
        };
        (range, all)
    }

    /// Returns the value that the part begins with.
    fn start<D: Denoiser>(
        self,
        sampler: &Sampler<'_, D>,
        state: &SamplerState<'_, D::Context>,
    ) -> Tensor<2> {
        match self {
            ConditionPart::Embedding => state.embedding.clone(),
            ConditionPart::Modulation | ConditionPart::Tokens => {
                let (range, _) = self.offsets(sampler.model);
                let [batch, _] = state.embedding.dims();
                Tensor::zeros([batch, range.len()], &state.embedding.device())
            }
        }
    }
}

impl<D: Denoiser> Variable for ConditioningVariable<'_, '_, D> {
    fn steps(&self) -> usize {
        self.sampler.steps().len() * self.sampler.windows(self.batch)
    }

    fn timestep(&self, index: usize) -> usize {
        let steps = self.sampler.steps();
        steps[index % steps.len()].timestep
    }

    fn step(&mut self, index: usize) -> Result<StepOutput, NonFinite> {
        let index = match index % self.sampler.steps().len() {
            0 if index > 0 => {
                self.begin_window();
                0
            }
            index => index,
        };
        let mut evaluation = self.loss_gradient(index)?;
        for _ in 1..self.guidance.updates_per_step {
            self.update(evaluation.gradient, index);
            evaluation = self.loss_gradient(index)?;
        }
        self.update(evaluation.gradient.clone(), index);
        let output = match self.guidance.update {
            UpdateTiming::Lagged => evaluation.leaf,
            UpdateTiming::Immediate => {
                let unconditional = evaluation.unconditional.take();
                self.sampler
                    .evaluate_again(&self.state, index, unconditional)
            }
        };
        let step = &self.sampler.steps()[index];
        let prediction = self.sampler.clean_motion(&self.state, output.clone(), step);
        self.state.x = { self.sampler }.advance(&self.state, &prediction, output, index);
        Ok(StepOutput {
            loss: evaluation.loss,
            gradient: Some(evaluation.gradient),
            prediction: self.chain.followed_by(prediction),
        })
    }

    fn embedding(&self) -> &Tensor<2> {
        &self.state.embedding
    }

    fn finish(self: Box<Self>) -> Tensor<3> {
        self.chain.followed_by(self.state.x)
    }
}

/// The clean motion that is predicted at each step (the paper's comparison method "classifier guidance"). With 0
/// updates, the pass is sampled without guidance.
pub(super) struct PredictionVariable<'s, 'a, D: Denoiser> {
    sampler: &'s Sampler<'a, D>,
    objective: &'s Objective<'a>,
    batch: &'s Batch<D::Context>,
    baseline: Tensor<3>,
    chain: WindowChain,
    state: SamplerState<'s, D::Context>,
    guidance: &'s Guidance,
    /// The number of updates at each step.
    updates: usize,
}

impl<'s, 'a, D: Denoiser> PredictionVariable<'s, 'a, D> {
    pub(super) fn new(
        sampler: &'s Sampler<'a, D>,
        objective: &'s Objective<'a>,
        batch: &'s Batch<D::Context>,
        baseline: Tensor<3>,
        guidance: &'s Guidance,
    ) -> Self {
        PredictionVariable {
            sampler,
            objective,
            batch,
            baseline,
            chain: sampler.chain(),
            state: sampler.initial_state(batch),
            guidance,
            updates: match guidance.variable {
                GuidanceVariable::None => 0,
                _ => guidance.updates_per_step,
            },
        }
    }
}

impl<D: Denoiser> Variable for PredictionVariable<'_, '_, D> {
    fn steps(&self) -> usize {
        self.sampler.steps().len() * self.sampler.windows(self.batch)
    }

    fn timestep(&self, index: usize) -> usize {
        let steps = self.sampler.steps();
        steps[index % steps.len()].timestep
    }

    fn step(&mut self, index: usize) -> Result<StepOutput, NonFinite> {
        let index = match index % self.sampler.steps().len() {
            0 if index > 0 => {
                self.chain.push(self.state.x.clone());
                self.state = self.sampler.window_state(self.batch, &self.chain);
                0
            }
            index => index,
        };
        let (sampler, state) = (self.sampler, &mut self.state);
        let step = &sampler.steps()[index];
        let output = sampler.evaluate(state, index);
        let mut prediction = sampler.clean_motion(state, output.clone(), step);
        // The step keeps the noise that belongs to the network's own prediction.
        let noise = sampler.predicted_noise(state, state.x.clone(), &prediction, output, step);
        let mut loss = match self.updates {
            0 => {
                let motion = self.chain.within(prediction.clone(), &self.baseline);
                self.objective.loss_of_motions(motion)
            }
            _ => Vec::new(),
        };
        let rate = self.guidance.learning_rate_at(index, sampler.steps().len());
        for _ in 0..self.updates {
            let evaluation = { self.objective }.gradient(|| MotionPath {
                clean: Box::new(|window| self.chain.within(window, &self.baseline)),
                ..identity_path(&prediction)
            })?;
            prediction = prediction - evaluation.gradient * rate;
            loss = evaluation.loss;
        }
        state.x = sampler.add_noise(state, &prediction, noise, index);
        Ok(StepOutput {
            loss,
            gradient: None,
            prediction: self.chain.followed_by(prediction),
        })
    }

    fn embedding(&self) -> &Tensor<2> {
        &self.state.embedding
    }

    fn finish(self: Box<Self>) -> Tensor<3> {
        self.chain.followed_by(self.state.x)
    }
}

/// The finished motion (the paper's comparison method "raw frame update").
pub(super) struct MotionVariable<'s, 'a> {
    objective: &'s Objective<'a>,
    variable: AdamVariable<3>,
    embedding: &'s Tensor<2>,
    iterations: usize,
    guidance: &'s Guidance,
}

impl<'s, 'a> MotionVariable<'s, 'a> {
    pub(super) fn new(
        objective: &'s Objective<'a>,
        baseline: Tensor<3>,
        embedding: &'s Tensor<2>,
        iterations: usize,
        guidance: &'s Guidance,
    ) -> Self {
        MotionVariable {
            objective,
            variable: AdamVariable::new(baseline, guidance),
            embedding,
            iterations,
            guidance,
        }
    }
}

impl Variable for MotionVariable<'_, '_> {
    fn steps(&self) -> usize {
        self.iterations
    }

    fn timestep(&self, _: usize) -> usize {
        0
    }

    fn step(&mut self, index: usize) -> Result<StepOutput, NonFinite> {
        let evaluation = { self.objective }.gradient(|| identity_path(&self.variable.value))?;
        let rate = self.guidance.learning_rate_at(index, self.iterations);
        self.variable.update(evaluation.gradient, rate);
        Ok(StepOutput {
            loss: evaluation.loss,
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
pub(super) struct NoiseVariable<'s, 'a, D: Denoiser> {
    sampler: &'s Sampler<'a, D>,
    objective: &'s Objective<'a>,
    batch: &'s Batch<D::Context>,
    variable: AdamVariable<3>,
    /// 1 where a frame is part of its motion, else 0; `None` where no motion is padded.
    mask: Option<Tensor<3>>,
    /// The Euclidean norm of each motion's noise, `[batch, 1, 1]`, which guidance keeps.
    norm: Tensor<3>,
    iterations: usize,
    guidance: &'s Guidance,
}

impl<'s, 'a, D: Denoiser> NoiseVariable<'s, 'a, D> {
    pub(super) fn new(
        sampler: &'s Sampler<'a, D>,
        objective: &'s Objective<'a>,
        batch: &'s Batch<D::Context>,
        iterations: usize,
        guidance: &'s Guidance,
    ) -> Self {
        let mask = sampler.initial_state(batch).mask.keep();
        NoiseVariable {
            norm: norm(&batch.noise, &mask),
            mask,
            variable: AdamVariable::new(batch.noise.clone(), guidance),
            sampler,
            objective,
            batch,
            iterations,
            guidance,
        }
    }

    /// Runs a whole pass from the noise. Returns the path from the noise to the finished motions.
    fn pass(&self) -> MotionPath<'_, 3> {
        let sampler = self.sampler;
        let mut state = sampler.initial_state(self.batch);
        state.x = self.variable.value.clone();
        // Each function turns the gradient with respect to a step's result into that with respect to its noisy motion.
        let mut pullbacks: Vec<Box<dyn FnOnce(Tensor<3>) -> Tensor<3> + '_>> = Vec::new();
        for (index, step) in sampler.steps().iter().enumerate() {
            let linearized = sampler.linearize_motion(&state, &self.batch.prompt.context, index);
            let (x, output) = (state.x.clone(), linearized.output.clone());
            let prediction = sampler.clean_motion(&state, output.clone(), step);
            let next = sampler.advance(&state, &prediction, output.clone(), index);
            let before = state.clone();
            pullbacks.push(Box::new(move |gradient: Tensor<3>| {
                let [x, output] = [x, output].map(|leaf| leaf.autodiff().require_grad());
                let clean = sampler.clean_motion_at(&before, x.clone(), output.clone(), step);
                let noise =
                    sampler.predicted_noise(&before, x.clone(), &clean, output.clone(), step);
                let next = sampler.add_noise(&before, &clean, noise, index);
                let mut gradients = (next * gradient.autodiff()).sum().backward();
                let [x_gradient, output_gradient] = [x, output].map(|leaf| {
                    let gradient = leaf.grad_remove(&mut gradients);
                    gradient.unwrap_or_else(|| leaf.inner().zeros_like())
                });
                x_gradient + linearized.pull(output_gradient)
            }));
            state.x = next;
        }
        MotionPath {
            leaf: state.x,
            unconditional: None,
            clean: Box::new(|motion| motion),
            pull: Box::new(move |gradient| {
                let pullbacks = pullbacks.into_iter().rev();
                pullbacks.fold(gradient, |gradient, pull| pull(gradient))
            }),
        }
    }
}

impl<D: Denoiser> Variable for NoiseVariable<'_, '_, D> {
    fn steps(&self) -> usize {
        self.iterations
    }

    fn timestep(&self, _: usize) -> usize {
        0
    }

    fn step(&mut self, index: usize) -> Result<StepOutput, NonFinite> {
        let evaluation = { self.objective }.gradient(|| self.pass())?;
        let rate = self.guidance.learning_rate_at(index, self.iterations);
        self.variable.update(evaluation.gradient, rate);
        // Adam alone would let the noise grow, and the network was not trained with noise of another norm.
        let noise = self.variable.value.clone();
        self.variable.value = noise.clone() * (self.norm.clone() / norm(&noise, &self.mask));
        Ok(StepOutput {
            loss: evaluation.loss,
            gradient: None,
            prediction: evaluation.leaf,
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
        let motions = self.sampler.baseline(&batch, &mut ());
        motions.expect("no observer can stop the pass")
    }
}

/// Returns the path of a variable that is the motions themselves.
fn identity_path<'w>(motion: &Tensor<3>) -> MotionPath<'w, 3> {
    MotionPath {
        leaf: motion.clone(),
        unconditional: None,
        clean: Box::new(|motion| motion),
        pull: Box::new(|gradient| gradient),
    }
}

/// Computes the Euclidean norm of each motion's noise, `[batch, 1, 1]`, without padding frames.
fn norm(noise: &Tensor<3>, mask: &Option<Tensor<3>>) -> Tensor<3> {
    let squares = noise.clone().square().sum_dim(2);
    let squares = match mask {
        Some(mask) => squares * mask.clone(),
        None => squares,
    };
    squares.sum_dim(1).sqrt()
}
