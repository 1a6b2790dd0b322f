//! The feed-forward part of a block.

use burn::module::Module;
use burn::nn::{Linear, LinearConfig};
use burn::tensor::activation::gelu;
use burn::tensor::{Device, Tensor};

#[cfg(feature = "flex")]
use burn::optim::GradientsParams;

#[cfg(feature = "flex")]
use super::cpu::{self, Numbers};
use super::modulation::Modulation;
use super::stylization::Stylization;
use crate::checkpoint::{Keyed, Keys};
use crate::config::ModelConfig;

/// Two linear layers around a GELU, then stylization.
#[derive(Module, Debug)]
pub(super) struct FeedForward {
    expand: Linear,
    contract: Linear,
    output: Stylization,
}

impl FeedForward {
    pub(super) fn new(config: &ModelConfig, device: &Device) -> Self {
        let width = config.latent_dim;
        FeedForward {
            expand: LinearConfig::new(width, config.ff_size).init(device),
            contract: LinearConfig::new(config.ff_size, width).init(device),
            output: Stylization::new(width, device),
        }
    }

    /// # Shapes
    ///
    /// - `x` and output: `[batch, frames, latent]`
    pub(super) fn forward(&self, x: Tensor<3>, modulation: Modulation) -> Tensor<3> {
        let hidden = gelu(self.expand.forward(x.clone()));
        x + self
            .output
            .forward(self.contract.forward(hidden), modulation)
    }
}

#[cfg(feature = "flex")]
impl FeedForward {
    pub(super) fn cpu(&self) -> Option<lamogen_cpu::FeedForward<Numbers>> {
        Some(lamogen_cpu::FeedForward {
            expand: cpu::linear(&self.expand)?,
            contract: cpu::linear(&self.contract)?,
            output: self.output.cpu()?,
        })
    }

    pub(super) fn note(
        &self,
        gradient: lamogen_cpu::FeedForward<Vec<f32>>,
        notes: &mut GradientsParams,
    ) {
        cpu::note_linear(&self.expand, gradient.expand, notes);
        cpu::note_linear(&self.contract, gradient.contract, notes);
        self.output.note(gradient.output, notes);
    }
}

impl Keyed for FeedForward {
    fn keys(&mut self, keys: &mut Keys) {
        keys.linear("linear1", &mut self.expand);
        keys.linear("linear2", &mut self.contract);
        keys.nested("proj_out", &mut self.output);
    }
}
