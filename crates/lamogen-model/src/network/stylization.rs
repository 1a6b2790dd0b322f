//! Stylization: the timestep and the sentence scale and shift a hidden state.

use burn::module::Module;
use burn::nn::{LayerNorm, Linear, LinearConfig};
use burn::tensor::activation::silu;
use burn::tensor::{Device, Tensor};

#[cfg(feature = "flex")]
use burn::optim::GradientsParams;

#[cfg(feature = "flex")]
use super::cpu::{self, SharedFloats};
use super::layer_norm;
use super::modulation::Modulation;
use crate::checkpoint::{NamedParameters, ParameterList};

/// Feature-wise modulation (MotionDiffuse, Zhang et al. 2022, section 3.3):
///
/// `out = W · silu(norm(h) · (1 + scale) + shift)`
#[derive(Module, Debug)]
pub(super) struct Stylization {
    norm: LayerNorm,
    output: Linear,
}

impl Stylization {
    pub(super) fn new(latent: usize, device: &Device) -> Self {
        Stylization {
            norm: layer_norm(latent, device),
            output: LinearConfig::new(latent, latent).init(device),
        }
    }

    /// Applies the layer.
    ///
    /// # Shapes
    ///
    /// - `hidden` and output: `[batch, frames, latent]`
    pub(super) fn forward(&self, hidden: Tensor<3>, modulation: Modulation) -> Tensor<3> {
        let styled = self.norm.forward(hidden) * (modulation.scale + 1.0) + modulation.shift;
        self.output.forward(silu(styled))
    }
}

#[cfg(feature = "flex")]
impl Stylization {
    pub(super) fn to_kernel(&self) -> Option<lamogen_cpu::Stylization<SharedFloats>> {
        Some(lamogen_cpu::Stylization {
            norm: cpu::norm_kernel(&self.norm)?,
            output: cpu::linear_kernel(&self.output)?,
        })
    }

    pub(super) fn register_gradients(
        &self,
        gradient: lamogen_cpu::Stylization<Vec<f32>>,
        gradients: &mut GradientsParams,
    ) {
        cpu::register_norm_gradients(&self.norm, gradient.norm, gradients);
        cpu::register_linear_gradients(&self.output, gradient.output, gradients);
    }
}

impl NamedParameters for Stylization {
    fn keys(&mut self, keys: &mut ParameterList) {
        keys.norm("norm", &mut self.norm);
        keys.linear("out_layers.2", &mut self.output);
    }
}
