//! DDIM sampling: the first pass, and the steps that both passes are made of.

use burn::tensor::Tensor;
use lamogen_laban::Window;
use lamogen_model::{Denoiser, DenoiserInput, FrameMask, LinearizedEvaluation, Prediction, Prompt};
use lamogen_motion::Normalization;

use crate::error::GuideError;
use crate::observer::{Observer, Pass, Step};
use crate::schedule::{DdimStep, Schedule};
use crate::temporal_smoothing::TemporalSmoothing;

/// A deterministic DDIM sampler (Song et al. 2020; paper, section "Diffusion-Based Motion
/// Generation").
pub struct Sampler<'a, D> {
    pub(crate) model: &'a D,
    pub(crate) normalization: &'a Normalization,
    steps: Vec<DdimStep>,
    time: Tensor<2>,
    temporal_smoothing: Option<TemporalSmoothing>,
}

/// What the motions of a batch start from.
#[derive(Clone, Debug)]
pub struct Batch<C> {
    /// The encoded prompts.
    pub prompt: Prompt<C>,
    /// Start noise `[batch, frames, features]`; both passes start from it.
    pub noise: Tensor<3>,
    /// Frames of each motion; what is beyond them is padding.
    pub lengths: Vec<usize>,
}

/// A noisy batch on its way, with all else that the network is told.
#[derive(Clone)]
pub(crate) struct Latent<'a, C> {
    pub(crate) x: Tensor<3>,
    pub(crate) embedding: Tensor<2>,
    pub(crate) modulation: Option<Tensor<2>>,
    pub(crate) context: &'a C,
    pub(crate) mask: FrameMask,
    /// Smooths predictions along time, where that is asked for.
    window: Option<Window>,
}

impl<'a, D: Denoiser> Sampler<'a, D> {
    /// A sampler that makes `steps` steps a pass. `normalization` is that of the model's features.
    ///
    /// # Errors
    ///
    /// If there are no steps, or more than 1000.
    pub fn new(
        model: &'a D,
        normalization: &'a Normalization,
        steps: usize,
    ) -> Result<Self, GuideError> {
        let steps = Schedule::linear().ddim(steps)?;
        let timesteps: Vec<usize> = steps.iter().map(|step| step.timestep).collect();
        Ok(Sampler {
            model,
            normalization,
            time: model.embed_timesteps(&timesteps),
            steps,
            temporal_smoothing: None,
        })
    }

    /// Smooths predictions along time in both passes, or not.
    ///
    /// # Errors
    ///
    /// If the numbers make no sense (see [`TemporalSmoothing::check`]).
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

    /// The steps of a pass.
    pub fn steps(&self) -> &[DdimStep] {
        &self.steps
    }

    /// Pass 1: the motions that the text alone gives, normalised, `[batch, frames, features]`.
    ///
    /// # Errors
    ///
    /// If the observer stops the run.
    ///
    /// # Panics
    ///
    /// If noise, lengths and prompts are not of as many motions, or a length is 0 or beyond the
    /// noise's frames.
    pub fn baseline(
        &self,
        batch: &Batch<D::Context>,
        observer: &mut dyn Observer,
    ) -> Result<Tensor<3>, GuideError> {
        let mut latent = self.start(batch);
        for (index, step) in self.steps.iter().enumerate() {
            let output = self.evaluate(&latent, index);
            let prediction = self.clean(&latent, output.clone(), step);
            latent.x = self.advance(&latent, &prediction, output, step);
            let step = Step {
                pass: Pass::Baseline,
                index,
                steps: self.steps.len(),
                timestep: step.timestep,
                loss: None,
                gradient: None,
                embedding: &latent.embedding,
                prediction: &prediction,
            };
            if observer.step(&step).is_break() {
                return Err(GuideError::stopped(&step, &[]));
            }
        }
        Ok(latent.x)
    }

    pub(crate) fn start<'b>(&self, batch: &'b Batch<D::Context>) -> Latent<'b, D::Context> {
        let [size, frames, _] = batch.noise.dims();
        assert_eq!(
            [size, size],
            [batch.lengths.len(), batch.prompt.embedding.dims()[0]],
            "noise, lengths and prompts must be of as many motions"
        );
        Latent {
            x: batch.noise.clone(),
            embedding: batch.prompt.embedding.clone(),
            modulation: None,
            context: &batch.prompt.context,
            mask: FrameMask::new(&batch.lengths, frames, &batch.noise.device()),
            window: { self.temporal_smoothing }.map(|temporal_smoothing| {
                temporal_smoothing.window(&batch.lengths, frames, &batch.noise.device())
            }),
        }
    }

    /// What smooths the predictions of a step, if they are.
    fn window<'b>(
        &self,
        latent: &'b Latent<'_, D::Context>,
        step: &DdimStep,
    ) -> Option<&'b Window> {
        let temporal_smoothing = self.temporal_smoothing?;
        (step.timestep >= temporal_smoothing.until).then_some(latent.window.as_ref())?
    }

    /// The network's output at a step.
    pub(crate) fn evaluate(&self, latent: &Latent<'_, D::Context>, index: usize) -> Tensor<3> {
        self.model
            .denoise(self.input(latent, index), latent.context)
    }

    /// The network's output at a step, with the way back to the noisy motion.
    pub(crate) fn linearize_motion<'b>(
        &'b self,
        latent: &Latent<'_, D::Context>,
        context: &'b D::Context,
        index: usize,
    ) -> LinearizedEvaluation<'b, 3> {
        self.model
            .linearize_motion(self.input(latent, index), context)
    }

    /// The network's output at a step, with the way back to the embedding, or to the modulation where the latent has one.
    pub(crate) fn linearize<'b>(
        &'b self,
        latent: &'b Latent<'_, D::Context>,
        index: usize,
    ) -> LinearizedEvaluation<'b> {
        self.model
            .linearize(self.input(latent, index), latent.context)
    }

    fn input(&self, latent: &Latent<'_, D::Context>, index: usize) -> DenoiserInput {
        DenoiserInput {
            x_t: latent.x.clone(),
            time: self.time.clone().narrow(0, index, 1),
            embedding: latent.embedding.clone(),
            modulation: latent.modulation.clone(),
            mask: latent.mask.clone(),
        }
    }

    /// The clean motion that an output speaks of.
    pub(crate) fn clean(
        &self,
        latent: &Latent<'_, D::Context>,
        output: Tensor<3>,
        step: &DdimStep,
    ) -> Tensor<3> {
        self.clean_at(latent, latent.x.clone(), output, step)
    }

    /// As [`clean`](Self::clean), for an `x` of its own.
    pub(crate) fn clean_at(
        &self,
        latent: &Latent<'_, D::Context>,
        x: Tensor<3>,
        output: Tensor<3>,
        step: &DdimStep,
    ) -> Tensor<3> {
        let (signal, rest) = shares(step.alpha_cumprod);
        let clean = match self.model.prediction() {
            Prediction::Sample => output,
            Prediction::Epsilon => (x - output * rest) / signal,
            Prediction::V => x * signal - output * rest,
        };
        match self.window(latent, step) {
            Some(window) => window.smooth(clean),
            None => clean,
        }
    }

    /// The noise that an output speaks of, beside the clean motion that it speaks of.
    pub(crate) fn noise(
        &self,
        latent: &Latent<'_, D::Context>,
        x: Tensor<3>,
        clean: &Tensor<3>,
        output: Tensor<3>,
        step: &DdimStep,
    ) -> Tensor<3> {
        let (signal, rest) = shares(step.alpha_cumprod);
        match self.model.prediction() {
            // What is left of x beside the motion, now that it is another.
            _ if self.window(latent, step).is_some() => (x - clean.clone() * signal) / rest,
            Prediction::Epsilon => output,
            Prediction::Sample => (x - output * signal) / rest,
            Prediction::V => x * rest + output * signal,
        }
    }

    /// `x` at the next timestep.
    pub(crate) fn advance(
        &self,
        latent: &Latent<'_, D::Context>,
        clean: &Tensor<3>,
        output: Tensor<3>,
        step: &DdimStep,
    ) -> Tensor<3> {
        let noise = self.noise(latent, latent.x.clone(), clean, output, step);
        mix(clean, noise, step)
    }
}

/// A clean motion with as much noise as there is at the next timestep: none after the last.
pub(crate) fn mix(clean: &Tensor<3>, noise: Tensor<3>, step: &DdimStep) -> Tensor<3> {
    if step.next_alpha_cumprod == 1.0 {
        return clean.clone();
    }
    let (signal, rest) = shares(step.next_alpha_cumprod);
    clean.clone() * signal + noise * rest
}

/// The shares of motion and noise in `x`.
fn shares(alpha_cumprod: f64) -> (f64, f64) {
    (alpha_cumprod.sqrt(), (1.0 - alpha_cumprod).sqrt())
}
