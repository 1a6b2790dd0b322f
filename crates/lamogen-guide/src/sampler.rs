//! Sampling: the first pass, and the steps of both passes.

use burn::tensor::Tensor;
use lamogen_laban::SmoothingWindow;
use lamogen_model::{Denoiser, DenoiserInput, FrameMask, LinearizedEvaluation, Prediction, Prompt};
use lamogen_motion::Normalization;

use crate::error::GuideError;
use crate::known::KnownFrames;
use crate::looped::HeadingClosure;
use crate::noise::StepNoise;
use crate::observer::{Observer, Pass, Step};
use crate::places::RootPlan;
use crate::schedule::{DdimStep, Schedule};
use crate::temporal_smoothing::TemporalSmoothing;
use crate::windows::{Continuation, WindowChain, window_count};

/// How often the network is asked at each step for the noise that a pass went through. The first answer is of a motion with the
/// noise of the step after.
const INVERSION_ITERATIONS: usize = 2;

/// A sampler that goes from noise to motions step by step.
///
/// It is a deterministic DDIM sampler (Song et al. 2020; paper, section "Diffusion-Based Motion
/// Generation"), or the stochastic sampler of the training (DDPM, Ho et al. 2020) for a batch with
/// [`step_noise`](Batch::step_noise).
pub struct Sampler<'a, D> {
    pub(crate) model: &'a D,
    pub(crate) normalization: &'a Normalization,
    steps: Vec<DdimStep>,
    /// The embedded timestep of each step, `[steps, d_condition]`.
    time: Tensor<2>,
    temporal_smoothing: Option<TemporalSmoothing>,
    /// Whether the motions are loops.
    samples_loops: bool,
    /// The change of predictions that leads bodies through their places, if there are any.
    root_plan: Option<RootPlan>,
}

/// The input of both passes: the prompts, the start noise and the lengths of the motions of a batch.
#[derive(Clone, Debug)]
pub struct Batch<C> {
    /// The encoded prompts: one for each motion, or one for each tile of a motion of [`Tiled`](crate::Tiled).
    pub prompt: Prompt<C>,
    /// The start noise of both passes, `[batch, frames, features]`.
    pub noise: Tensor<3>,
    /// The number of frames of each motion; further frames are padding.
    pub lengths: Vec<usize>,
    /// The noise that both passes add at each step; `None` for DDIM, which adds none.
    pub step_noise: Option<StepNoise>,
    /// What a network that continues motions a window at a time needs; `None` for other networks.
    pub continuation: Option<Continuation<C>>,
    /// The frames that are known before a motion is generated, if there are any. A batch with known frames is a single motion.
    pub known: Option<KnownFrames>,
}

/// The state of a pass between two steps: the noisy motions, and the other inputs of the network.
#[derive(Clone)]
pub(crate) struct SamplerState<'a, C> {
    /// The noisy motions, `[batch, frames, features]`.
    pub(crate) x: Tensor<3>,
    /// The sentence embeddings, `[batch, d_condition]`.
    pub(crate) embedding: Tensor<2>,
    /// The offsets of scales and shifts, `[batch, modulations]`, if there are any.
    pub(crate) modulation: Option<Tensor<2>>,
    pub(crate) context: C,
    step_noise: Option<&'a StepNoise>,
    /// The number of steps that were made in earlier windows.
    earlier_steps: usize,
    pub(crate) mask: FrameMask,
    /// The window that smooths predictions along time, if they are smoothed.
    window: Option<SmoothingWindow>,
    /// The closure of headings, if they are closed.
    heading_closure: Option<HeadingClosure>,
    known: Option<&'a KnownFrames>,
}

impl<'a, D: Denoiser> Sampler<'a, D> {
    /// Creates a sampler that makes `steps` steps in each pass. `normalization` is the normalisation of the model's
    /// features.
    ///
    /// # Errors
    ///
    /// If `steps` is 0 or above the number of timesteps that the model was trained with.
    pub fn new(
        model: &'a D,
        normalization: &'a Normalization,
        steps: usize,
    ) -> Result<Self, GuideError> {
        let steps = Schedule::new(model.noise_schedule()).ddim(steps)?;
        let timesteps: Vec<usize> = steps.iter().map(|step| step.timestep).collect();
        Ok(Sampler {
            model,
            normalization,
            time: model.embed_timesteps(&timesteps),
            steps,
            temporal_smoothing: None,
            samples_loops: false,
            root_plan: None,
        })
    }

    /// Sets the smoothing of predictions along time in both passes, or turns it off.
    ///
    /// # Errors
    ///
    /// If the numbers of the smoothing are invalid (see [`TemporalSmoothing::check`]).
    pub fn with_temporal_smoothing(
        self,
        temporal_smoothing: Option<TemporalSmoothing>,
    ) -> Result<Self, GuideError> {
        if let Some(temporal_smoothing) = temporal_smoothing {
            temporal_smoothing.check()?;
        }
        Ok(Sampler {
            temporal_smoothing,
            ..self
        })
    }

    /// Sets whether the motions are loops, which the network must support ([`Looped`](crate::Looped)). In the predictions of both
    /// passes, the ends of a motion are then neighbours for the temporal smoothing, and the body faces at the end as at the
    /// beginning, or has turned round whole times.
    pub fn with_loops(self, samples_loops: bool) -> Self {
        Sampler {
            samples_loops,
            ..self
        }
    }

    /// Returns the sampler with a change of its predictions that leads bodies through their places.
    pub(crate) fn with_root_plan(&self, root_plan: Option<RootPlan>) -> Self {
        Sampler {
            steps: self.steps.clone(),
            time: self.time.clone(),
            root_plan,
            ..*self
        }
    }

    /// Returns the steps of a pass.
    pub fn steps(&self) -> &[DdimStep] {
        &self.steps
    }

    /// Returns the number of windows in which the network makes the motions of a batch: 1 unless it continues motions.
    pub fn windows(&self, batch: &Batch<D::Context>) -> usize {
        window_count(self.model.window(), batch.noise.dims()[1])
    }

    /// Runs pass 1. Returns the motions from the text alone, normalised, `[batch, frames, features]`.
    ///
    /// A network that continues motions makes all steps of a window before it begins with the next.
    ///
    /// # Errors
    ///
    /// If the observer stops the run.
    ///
    /// # Panics
    ///
    /// If noise, lengths and prompts differ in the number of motions, a length is 0 or larger than the number of frames of
    /// the noise, or, with a network that continues motions, there is no prefix or the frames of the noise are not whole
    /// windows.
    pub fn baseline(
        &self,
        batch: &Batch<D::Context>,
        observer: &mut dyn Observer,
    ) -> Result<Tensor<3>, GuideError> {
        let mut chain = self.chain();
        let windows = self.windows(batch);
        loop {
            let mut state = self.window_state(batch, &chain);
            for (index, step) in self.steps.iter().enumerate() {
                let output = self.evaluate(&state, index);
                let prediction = self.clean_motion(&state, output.clone(), step);
                state.x = self.advance(&state, &prediction, output, index);
                let step = Step {
                    pass: Pass::Baseline,
                    index: state.earlier_steps + index,
                    steps: windows * self.steps.len(),
                    timestep: step.timestep,
                    loss: None,
                    gradient: None,
                    embedding: &state.embedding,
                    prediction: &chain.followed_by(prediction),
                };
                if observer.step(&step).is_break() {
                    return Err(GuideError::stopped(&step, &[]));
                }
            }
            if chain.index() + 1 == windows {
                return Ok(chain.followed_by(state.x));
            }
            chain.push(state.x);
        }
    }

    /// Finds the noisy motions that a pass goes through on its way to given motions (Song et al. 2020, section 4.3): for each
    /// step, the one at which the network is evaluated, `[batch, frames, features]`. `motions` are normalised, and `batch` has
    /// their prompts and lengths.
    ///
    /// # Panics
    ///
    /// If the batch has known frames, or its noise is of another shape than the motions.
    pub fn invert(&self, batch: &Batch<D::Context>, motions: &Tensor<3>) -> Vec<Tensor<3>> {
        assert!(batch.known.is_none(), "known frames are inverted alone");
        let mut state = self.initial_state(batch);
        assert_eq!(state.x.dims(), motions.dims());
        let mut after = motions.clone();
        let mut noise = motions.zeros_like();
        let mut noisy = Vec::new();
        for (index, step) in self.steps.iter().enumerate().rev() {
            let (signal_scale, noise_scale) = coefficients(step.alpha_cumprod);
            let (next_signal, next_noise) = coefficients(step.next_alpha_cumprod);
            for _ in 0..INVERSION_ITERATIONS {
                let clean = (after.clone() - noise.clone() * next_noise) / next_signal;
                state.x = clean * signal_scale + noise * noise_scale;
                let output = self.evaluate(&state, index);
                let clean = self.clean_motion(&state, output.clone(), step);
                noise = self.predicted_noise(&state, state.x.clone(), &clean, output, step);
            }
            let clean = (after - noise.clone() * next_noise) / next_signal;
            after = clean * signal_scale + noise.clone() * noise_scale;
            noisy.push(after.clone());
        }
        noisy.reverse();
        noisy
    }

    /// Returns the windows of a pass before its first step.
    pub(crate) fn chain(&self) -> WindowChain {
        WindowChain::new(self.model.window())
    }

    /// Returns the state before the first step of the first window.
    pub(crate) fn initial_state<'b>(
        &self,
        batch: &'b Batch<D::Context>,
    ) -> SamplerState<'b, D::Context> {
        self.window_state(batch, &self.chain())
    }

    /// Returns the state before the first step of the window after those of `chain`: its start noise with its prompts.
    pub(crate) fn window_state<'b>(
        &self,
        batch: &'b Batch<D::Context>,
        chain: &WindowChain,
    ) -> SamplerState<'b, D::Context> {
        let [size, frames, _] = batch.noise.dims();
        assert_eq!(
            size,
            batch.lengths.len(),
            "noise and lengths must be of as many motions"
        );
        let (window, device) = (chain.frames(frames), batch.noise.device());
        let prompt = chain.prompt(batch);
        // A window is made whole, however many of its frames a motion needs.
        let (context, lengths) = match chain.prefix(batch) {
            None => (prompt.context.clone(), batch.lengths.clone()),
            Some(prefix) => {
                let context = self.model.with_prefix(prompt.context.clone(), prefix);
                (context, vec![window.len(); size])
            }
        };
        SamplerState {
            x: batch.noise.clone().narrow(1, window.start, window.len()),
            embedding: prompt.embedding.clone(),
            modulation: None,
            context,
            step_noise: batch.step_noise.as_ref(),
            earlier_steps: chain.index() * self.steps.len(),
            mask: FrameMask::new(&lengths, window.len(), &device),
            window: { self.temporal_smoothing }.map(|temporal_smoothing| {
                temporal_smoothing.window(&lengths, window.len(), self.samples_loops, &device)
            }),
            heading_closure: self
                .samples_loops
                .then(|| HeadingClosure::new(&lengths, window.len(), self.normalization, &device)),
            known: batch.known.as_ref(),
        }
    }

    /// Returns the window that smooths the predictions of a step; `None` if they are not smoothed.
    fn smoothing_window<'b>(
        &self,
        state: &'b SamplerState<'_, D::Context>,
        step: &DdimStep,
    ) -> Option<&'b SmoothingWindow> {
        let temporal_smoothing = self.temporal_smoothing?;
        (step.timestep >= temporal_smoothing.until).then_some(state.window.as_ref())?
    }

    /// Returns the network's output at a step.
    pub(crate) fn evaluate(&self, state: &SamplerState<'_, D::Context>, index: usize) -> Tensor<3> {
        self.model.denoise(self.input(state, index), &state.context)
    }

    /// Returns the network's output at a step of which the condition has changed since a linearized evaluation, which kept
    /// its unconditional output.
    pub(crate) fn evaluate_again(
        &self,
        state: &SamplerState<'_, D::Context>,
        index: usize,
        unconditional: Option<Tensor<3>>,
    ) -> Tensor<3> {
        let input = self.input(state, index);
        self.model
            .denoise_again(input, &state.context, unconditional)
    }

    /// Returns the network's output at a step, with its derivative with respect to the noisy motion.
    pub(crate) fn linearize_motion<'b>(
        &'b self,
        state: &SamplerState<'_, D::Context>,
        context: &'b D::Context,
        index: usize,
    ) -> LinearizedEvaluation<'b, 3> {
        self.model
            .linearize_motion(self.input(state, index), context)
    }

    /// Returns the network's output at a step, with its derivative with respect to the embedding, or to the modulation
    /// if the state has one.
    pub(crate) fn linearize<'b>(
        &'b self,
        state: &'b SamplerState<'_, D::Context>,
        index: usize,
    ) -> LinearizedEvaluation<'b> {
        self.model
            .linearize(self.input(state, index), &state.context)
    }

    /// Returns the input of the network at a step.
    fn input(&self, state: &SamplerState<'_, D::Context>, index: usize) -> DenoiserInput {
        let x = state.x.clone();
        DenoiserInput {
            x_t: match state.known {
                Some(known) => known.at_step(x, index),
                None => x,
            },
            timesteps: vec![self.steps[index].timestep],
            time: self.time.clone().narrow(0, index, 1),
            embedding: state.embedding.clone(),
            modulation: state.modulation.clone(),
            mask: state.mask.clone(),
        }
    }

    /// Computes the clean motion from the network's output, `[batch, frames, features]`; it is smoothed if the step's
    /// predictions are.
    pub(crate) fn clean_motion(
        &self,
        state: &SamplerState<'_, D::Context>,
        output: Tensor<3>,
        step: &DdimStep,
    ) -> Tensor<3> {
        self.clean_motion_at(state, state.x.clone(), output, step)
    }

    /// Computes the clean motion as [`clean_motion`](Self::clean_motion), for noisy motions `x` other than those of the
    /// state.
    pub(crate) fn clean_motion_at(
        &self,
        state: &SamplerState<'_, D::Context>,
        x: Tensor<3>,
        output: Tensor<3>,
        step: &DdimStep,
    ) -> Tensor<3> {
        let (signal_scale, noise_scale) = coefficients(step.alpha_cumprod);
        let clean = match self.model.prediction() {
            Prediction::Sample => output,
            Prediction::Epsilon => (x - output * noise_scale) / signal_scale,
            Prediction::V => x * signal_scale - output * noise_scale,
        };
        let clean = match self.smoothing_window(state, step) {
            Some(window) => window.smooth(clean),
            None => clean,
        };
        let clean = match &state.heading_closure {
            Some(closure) => closure.close(clean),
            None => clean,
        };
        let clean = match state.known {
            Some(known) => known.replace(clean),
            None => clean,
        };
        match (&self.root_plan, state.known) {
            (None, _) => clean,
            (Some(plan), None) => plan.apply(clean),
            // The plan leads on from where the known frames end, so that no jump is left to be spread.
            (Some(plan), Some(known)) => known.restore(plan.apply(clean)),
        }
    }

    /// Returns whether [`clean_motion`](Self::clean_motion) changes what the network predicts at a step.
    fn changes_predictions(&self, state: &SamplerState<'_, D::Context>, step: &DdimStep) -> bool {
        state.heading_closure.is_some()
            || state.known.is_some()
            || self.root_plan.is_some()
            || self.smoothing_window(state, step).is_some()
    }

    /// Computes the noise from the network's output, so that `x` is the sum of the clean motion and this noise, each
    /// times its coefficient.
    pub(crate) fn predicted_noise(
        &self,
        state: &SamplerState<'_, D::Context>,
        x: Tensor<3>,
        clean: &Tensor<3>,
        output: Tensor<3>,
        step: &DdimStep,
    ) -> Tensor<3> {
        let (signal_scale, noise_scale) = coefficients(step.alpha_cumprod);
        match self.model.prediction() {
            // The clean motion has been changed, so the noise is the rest of x.
            _ if self.changes_predictions(state, step) => {
                (x - clean.clone() * signal_scale) / noise_scale
            }
            Prediction::Epsilon => output,
            Prediction::Sample => (x - output * signal_scale) / noise_scale,
            Prediction::V => x * noise_scale + output * signal_scale,
        }
    }

    /// Returns the noisy motions at the next timestep.
    pub(crate) fn advance(
        &self,
        state: &SamplerState<'_, D::Context>,
        clean: &Tensor<3>,
        output: Tensor<3>,
        index: usize,
    ) -> Tensor<3> {
        let step = &self.steps[index];
        let noise = self.predicted_noise(state, state.x.clone(), clean, output, step);
        self.add_noise(state, clean, noise, index)
    }

    /// Adds the noise of the next timestep to a clean motion; after the last timestep there is none. `noise` is the noise
    /// that the network found. If the sampler draws noise at each step, a part of it is replaced by fresh noise, so that
    /// the motion is distributed as in training.
    pub(crate) fn add_noise(
        &self,
        state: &SamplerState<'_, D::Context>,
        clean: &Tensor<3>,
        noise: Tensor<3>,
        index: usize,
    ) -> Tensor<3> {
        let step = &self.steps[index];
        if step.next_alpha_cumprod == 1.0 {
            return clean.clone();
        }
        let (signal_scale, noise_scale) = coefficients(step.next_alpha_cumprod);
        let signal = clean.clone() * signal_scale;
        let Some(step_noise) = state.step_noise else {
            return signal + noise * noise_scale;
        };
        let [_, frames, features] = clean.dims();
        let place = state.earlier_steps + index;
        let fresh = step_noise.at(place, [frames, features], &clean.device());
        let variance = step.posterior_variance();
        let kept = (1.0 - step.next_alpha_cumprod - variance).max(0.0).sqrt();
        signal + noise * kept + fresh * variance.sqrt()
    }
}

/// Returns the coefficients of the clean motion and of the noise in `x`: `√ᾱ` and `√(1 - ᾱ)`.
fn coefficients(alpha_cumprod: f64) -> (f64, f64) {
    (alpha_cumprod.sqrt(), (1.0 - alpha_cumprod).sqrt())
}
