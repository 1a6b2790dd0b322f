//! Toy networks: small enough that their outputs are known in advance.

use std::ops::Deref;

use burn::tensor::{Device, Tensor};
use lamogen_guide::Schedule;
use lamogen_model::{Denoiser, DenoiserInput, Prediction, Prompt, TokenBatch};
use lamogen_motion::{Normalization, POSE_FEATURES};

/// A toy network. The embedding of a prompt is its one token; the embedded timestep is its `ᾱ`.
pub trait ToyNetwork {
    /// Returns the kind of the output: noise, clean motion or v.
    fn prediction(&self) -> Prediction {
        Prediction::Sample
    }

    /// Returns the number of scales and shifts.
    fn modulation_width(&self) -> usize {
        0
    }

    /// Returns the output for a noisy motion.
    fn output(&self, input: DenoiserInput) -> Tensor<3>;
}

/// A toy network as a denoiser.
pub struct ToyDenoiser<N>(pub N);

impl<N> Deref for ToyDenoiser<N> {
    type Target = N;

    fn deref(&self) -> &N {
        &self.0
    }
}

impl<N: ToyNetwork> Denoiser for ToyDenoiser<N> {
    type Context = ();

    fn prediction(&self) -> Prediction {
        self.0.prediction()
    }

    fn pose_features(&self) -> usize {
        POSE_FEATURES
    }

    fn max_frames(&self) -> usize {
        100
    }

    fn device(&self) -> Device {
        Device::flex()
    }

    fn modulation_width(&self) -> usize {
        self.0.modulation_width()
    }

    fn encode(&self, tokens: &TokenBatch) -> Prompt<()> {
        Prompt {
            embedding: tokens.ids.clone().float(),
            context: (),
        }
    }

    fn embed_timesteps(&self, timesteps: &[usize]) -> Tensor<2> {
        let schedule = Schedule::linear();
        let alphas = timesteps
            .iter()
            .map(|&t| schedule.alphas_cumprod()[t] as f32);
        let alphas: Vec<f32> = alphas.collect();
        Tensor::<1>::from_floats(&alphas[..], &self.device()).reshape([timesteps.len(), 1])
    }

    fn denoise(&self, input: DenoiserInput, (): &()) -> Tensor<3> {
        self.0.output(input)
    }
}

/// Returns a normalisation with the mean 0 and the same standard deviation for all features.
pub fn normalization(std: f32) -> Normalization {
    let (mean, std) = ([0.0; POSE_FEATURES], [std; POSE_FEATURES]);
    Normalization::from_slices(&mean, &std, &Device::flex()).unwrap()
}
