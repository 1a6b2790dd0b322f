//! How timestep and sentence act on a hidden state: they scale and shift it.

use burn::module::Module;
use burn::nn::{LayerNorm, Linear, LinearConfig};
use burn::tensor::activation::silu;
use burn::tensor::{Device, Tensor};

#[cfg(feature = "flex")]
use burn::optim::GradientsParams;

#[cfg(feature = "flex")]
use super::cpu::{self, Numbers};
use super::layer_norm;
use super::modulation::Modulation;
use crate::checkpoint::{Keyed, Keys};

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
    pub(super) fn cpu(&self) -> Option<lamogen_cpu::Stylization<Numbers>> {
        Some(lamogen_cpu::Stylization {
            norm: cpu::norm(&self.norm)?,
            output: cpu::linear(&self.output)?,
        })
    }

    pub(super) fn note(
        &self,
        gradient: lamogen_cpu::Stylization<Vec<f32>>,
        notes: &mut GradientsParams,
    ) {
        cpu::note_norm(&self.norm, gradient.norm, notes);
        cpu::note_linear(&self.output, gradient.output, notes);
    }
}

impl Keyed for Stylization {
    fn keys(&mut self, keys: &mut Keys) {
        keys.norm("norm", &mut self.norm);
        keys.linear("out_layers.2", &mut self.output);
    }
}
