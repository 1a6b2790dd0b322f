//! The feed-forward layers of a block.

use burn::module::Module;
use burn::nn::{Linear, LinearConfig};
use burn::tensor::activation::gelu;
use burn::tensor::{Device, Tensor};

#[cfg(feature = "flex")]
use burn::optim::GradientsParams;

#[cfg(feature = "flex")]
use super::cpu::{self, SharedFloats};
use super::modulation::Modulation;
use super::stylization::Stylization;
use crate::checkpoint::{NamedParameters, ParameterList};
use crate::config::ModelConfig;

/// Two linear layers with a GELU between them, followed by stylization.
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

    /// Applies the layers and adds the result to `x`.
    ///
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
    pub(super) fn to_kernel(&self) -> Option<lamogen_cpu::FeedForward<SharedFloats>> {
        Some(lamogen_cpu::FeedForward {
            expand: cpu::linear_kernel(&self.expand)?,
            contract: cpu::linear_kernel(&self.contract)?,
            output: self.output.to_kernel()?,
        })
    }

    pub(super) fn register_gradients(
        &self,
        gradient: lamogen_cpu::FeedForward<Vec<f32>>,
        gradients: &mut GradientsParams,
    ) {
        cpu::register_linear_gradients(&self.expand, gradient.expand, gradients);
        cpu::register_linear_gradients(&self.contract, gradient.contract, gradients);
        self.output.register_gradients(gradient.output, gradients);
    }
}

impl NamedParameters for FeedForward {
    fn keys(&mut self, keys: &mut ParameterList) {
        keys.linear("linear1", &mut self.expand);
        keys.linear("linear2", &mut self.contract);
        keys.nested("proj_out", &mut self.output);
    }
}
