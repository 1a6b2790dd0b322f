//! Efficient attention of the frames to each other.

use burn::module::Module;
use burn::nn::{LayerNorm, Linear, LinearConfig};
use burn::tensor::activation::softmax;
use burn::tensor::{Device, Tensor};

#[cfg(feature = "flex")]
use burn::optim::GradientsParams;

#[cfg(feature = "flex")]
use super::cpu::{self, SharedFloats};
use super::modulation::Modulation;
use super::stylization::Stylization;
use super::{layer_norm, merge_heads, split_heads};
use crate::checkpoint::{NamedParameters, ParameterList};
use crate::config::ModelConfig;
use crate::denoiser::FrameMask;

/// Linear attention (Shen et al. 2021). The softmax is over channels for the queries and over frames for the keys, so that
/// the cost grows with the number of frames and not with its square.
#[derive(Module, Debug)]
pub(super) struct SelfAttention {
    norm: LayerNorm,
    query: Linear,
    key: Linear,
    value: Linear,
    output: Stylization,
    heads: usize,
}

impl SelfAttention {
    pub(super) fn new(config: &ModelConfig, device: &Device) -> Self {
        let width = config.latent_dim;
        let linear = || LinearConfig::new(width, width).init(device);
        SelfAttention {
            norm: layer_norm(width, device),
            query: linear(),
            key: linear(),
            value: linear(),
            output: Stylization::new(width, device),
            heads: config.num_heads,
        }
    }

    /// Applies the attention and adds the result to `x`.
    ///
    /// # Shapes
    ///
    /// - `x` and output: `[batch, frames, latent]`
    pub(super) fn forward(
        &self,
        x: Tensor<3>,
        modulation: Modulation,
        mask: &FrameMask,
    ) -> Tensor<3> {
        let normed = self.norm.forward(x.clone());
        let query = self.query.forward(normed.clone());
        let mut key = self.key.forward(normed.clone());
        let mut value = self.value.forward(normed);
        if let Some(padding) = mask.padding() {
            key = key - padding.penalty.clone();
            value = value * padding.keep.clone();
        }
        let heads = |x| split_heads(x, self.heads);
        let context = attention_context(heads(key), heads(value));
        let y = softmax(heads(query), 3).matmul(context);
        x + self.output.forward(merge_heads(y), modulation)
    }
}

#[cfg(feature = "flex")]
impl SelfAttention {
    pub(super) fn to_kernel(&self) -> Option<lamogen_cpu::SelfAttention<SharedFloats>> {
        Some(lamogen_cpu::SelfAttention {
            norm: cpu::norm_kernel(&self.norm)?,
            query: cpu::linear_kernel(&self.query)?,
            key: cpu::linear_kernel(&self.key)?,
            value: cpu::linear_kernel(&self.value)?,
            output: self.output.to_kernel()?,
        })
    }

    pub(super) fn register_gradients(
        &self,
        gradient: lamogen_cpu::SelfAttention<Vec<f32>>,
        gradients: &mut GradientsParams,
    ) {
        cpu::register_norm_gradients(&self.norm, gradient.norm, gradients);
        cpu::register_linear_gradients(&self.query, gradient.query, gradients);
        cpu::register_linear_gradients(&self.key, gradient.key, gradients);
        cpu::register_linear_gradients(&self.value, gradient.value, gradients);
        self.output.register_gradients(gradient.output, gradients);
    }
}

/// Computes the context of an attention, the sum of `softmax(key) · value` over positions: `[batch, heads, positions, d]`
/// twice → `[batch, heads, d, d]`.
pub(super) fn attention_context(key: Tensor<4>, value: Tensor<4>) -> Tensor<4> {
    softmax(key, 2).swap_dims(2, 3).matmul(value)
}

impl NamedParameters for SelfAttention {
    fn keys(&mut self, keys: &mut ParameterList) {
        keys.norm("norm", &mut self.norm);
        keys.linear("query", &mut self.query);
        keys.linear("key", &mut self.key);
        keys.linear("value", &mut self.value);
        keys.nested("proj_out", &mut self.output);
    }
}
