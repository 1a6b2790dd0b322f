//! Efficient attention of the frames to the text.

use burn::module::Module;
use burn::nn::{LayerNorm, Linear, LinearConfig};
use burn::tensor::activation::softmax;
use burn::tensor::{Device, Tensor};

#[cfg(feature = "flex")]
use burn::optim::GradientsParams;

#[cfg(feature = "flex")]
use super::cpu::{self, SharedFloats};
use super::modulation::Modulation;
use super::self_attention::attention_context;
use super::stylization::Stylization;
use super::{layer_norm, merge_heads, split_heads};
use crate::checkpoint::{NamedParameters, ParameterList};
use crate::config::ModelConfig;

/// Linear attention to the tokens. The context, computed from the tokens, depends on the prompt alone.
#[derive(Module, Debug)]
pub(super) struct CrossAttention {
    norm: LayerNorm,
    text_norm: LayerNorm,
    query: Linear,
    key: Linear,
    value: Linear,
    output: Stylization,
    heads: usize,
}

/// The contexts of the attention to the text: one tensor `[batch, heads, d, d]` for each block.
#[derive(Clone, Debug)]
pub struct CrossAttentionContext(pub(super) Vec<Tensor<4>>);

impl CrossAttention {
    pub(super) fn new(config: &ModelConfig, device: &Device) -> Self {
        let (width, text) = (config.latent_dim, config.text_latent_dim);
        CrossAttention {
            norm: layer_norm(width, device),
            text_norm: layer_norm(text, device),
            query: LinearConfig::new(width, width).init(device),
            key: LinearConfig::new(text, width).init(device),
            value: LinearConfig::new(text, width).init(device),
            output: Stylization::new(width, device),
            heads: config.num_heads,
        }
    }

    /// Computes the context of the text, once per prompt.
    ///
    /// # Shapes
    ///
    /// - `text`: `[batch, tokens, text_latent_dim]`
    /// - output: `[batch, heads, d, d]`
    pub(super) fn context(&self, text: Tensor<3>) -> Tensor<4> {
        let text = self.text_norm.forward(text);
        let heads = |x| split_heads(x, self.heads);
        attention_context(
            heads(self.key.forward(text.clone())),
            heads(self.value.forward(text)),
        )
    }

    /// Applies the attention and adds the result to `x`.
    ///
    /// # Shapes
    ///
    /// - `x` and output: `[batch, frames, latent]`
    pub(super) fn forward(
        &self,
        x: Tensor<3>,
        context: Tensor<4>,
        modulation: Modulation,
    ) -> Tensor<3> {
        let query = self.query.forward(self.norm.forward(x.clone()));
        let y = softmax(split_heads(query, self.heads), 3).matmul(context);
        x + self.output.forward(merge_heads(y), modulation)
    }
}

#[cfg(feature = "flex")]
impl CrossAttention {
    pub(super) fn to_kernel(&self) -> Option<lamogen_cpu::CrossAttention<SharedFloats>> {
        Some(lamogen_cpu::CrossAttention {
            norm: cpu::norm_kernel(&self.norm)?,
            query: cpu::linear_kernel(&self.query)?,
            output: self.output.to_kernel()?,
        })
    }

    pub(super) fn register_gradients(
        &self,
        gradient: lamogen_cpu::CrossAttention<Vec<f32>>,
        gradients: &mut GradientsParams,
    ) {
        cpu::register_norm_gradients(&self.norm, gradient.norm, gradients);
        cpu::register_linear_gradients(&self.query, gradient.query, gradients);
        self.output.register_gradients(gradient.output, gradients);
    }
}

impl NamedParameters for CrossAttention {
    fn keys(&mut self, keys: &mut ParameterList) {
        keys.norm("norm", &mut self.norm);
        keys.norm("text_norm", &mut self.text_norm);
        keys.linear("query", &mut self.query);
        keys.linear("key", &mut self.key);
        keys.linear("value", &mut self.value);
        keys.nested("proj_out", &mut self.output);
    }
}
