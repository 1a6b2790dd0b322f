//! Networks small enough to foresee what they do.

use std::ops::Deref;

use burn::tensor::{Device, Int, Tensor};
use lamogen_guide::Schedule;
use lamogen_model::{Denoiser, DenoiserInput, Prediction, Prompt};
use lamogen_motion::{Normalization, POSE_FEATURES};

/// What a toy says of a noisy motion. The embedding is the one token of a prompt, the time `ᾱ` of its timestep.
pub trait Says {
    /// What that is.
    fn prediction(&self) -> Prediction {
        Prediction::Sample
    }

    /// How many scales and shifts it has.
    fn modulations(&self) -> usize {
        0
    }

    fn says(&self, input: DenoiserInput) -> Tensor<3>;
}

/// A network that says so.
pub struct Toy<S>(pub S);

impl<S> Deref for Toy<S> {
    type Target = S;

    fn deref(&self) -> &S {
        &self.0
    }
}

impl<S: Says> Denoiser for Toy<S> {
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

    fn modulations(&self) -> usize {
        self.0.modulations()
    }

    fn encode(&self, tokens: Tensor<2, Int>) -> Prompt<()> {
        Prompt {
            embedding: tokens.float(),
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
        self.0.says(input)
    }
}

/// The same mean, 0, and deviation for all features.
pub fn normalization(std: f32) -> Normalization {
    let (mean, std) = ([0.0; POSE_FEATURES], [std; POSE_FEATURES]);
    Normalization::from_slices(&mean, &std, &Device::flex()).unwrap()
}
