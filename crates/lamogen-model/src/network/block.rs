//! The decoder block.

use burn::module::Module;
use burn::tensor::{Device, Tensor};

#[cfg(feature = "flex")]
use burn::optim::GradientsParams;

#[cfg(feature = "flex")]
use super::cpu::SharedFloats;
use super::cross_attention::CrossAttention;
use super::feed_forward::FeedForward;
use super::modulation::Modulation;
use super::self_attention::SelfAttention;
use crate::checkpoint::{NamedParameters, ParameterList};
use crate::config::ModelConfig;
use crate::denoiser::FrameMask;

/// The keys of the stylization layers of a block, in the order of their modulations.
pub(super) const STYLIZATIONS: [&str; 3] = ["sa_block", "ca_block", "ffn"];

/// A decoder block: self-attention, attention to the text, and feed-forward layers.
#[derive(Module, Debug)]
pub(super) struct DecoderBlock {
    self_attention: SelfAttention,
    pub(super) cross_attention: CrossAttention,
    feed_forward: FeedForward,
}

impl DecoderBlock {
    pub(super) fn new(config: &ModelConfig, device: &Device) -> Self {
        DecoderBlock {
            self_attention: SelfAttention::new(config, device),
            cross_attention: CrossAttention::new(config, device),
            feed_forward: FeedForward::new(config, device),
        }
    }

    /// Applies the block.
    ///
    /// # Shapes
    ///
    /// - `x` and output: `[batch, frames, latent]`
    /// - `context`: `[batch, heads, d, d]`
    pub(super) fn forward(
        &self,
        x: Tensor<3>,
        context: Tensor<4>,
        mask: &FrameMask,
        [first, second, third]: [Modulation; STYLIZATIONS.len()],
    ) -> Tensor<3> {
        let x = self.self_attention.forward(x, first, mask);
        let x = self.cross_attention.forward(x, context, second);
        self.feed_forward.forward(x, third)
    }
}

#[cfg(feature = "flex")]
impl DecoderBlock {
    pub(super) fn to_kernel(&self) -> Option<lamogen_cpu::DecoderBlock<SharedFloats>> {
        Some(lamogen_cpu::DecoderBlock {
            self_attention: self.self_attention.to_kernel()?,
            cross_attention: self.cross_attention.to_kernel()?,
            feed_forward: self.feed_forward.to_kernel()?,
        })
    }

    pub(super) fn register_gradients(
        &self,
        gradient: lamogen_cpu::DecoderBlock<Vec<f32>>,
        gradients: &mut GradientsParams,
    ) {
        self.self_attention
            .register_gradients(gradient.self_attention, gradients);
        self.cross_attention
            .register_gradients(gradient.cross_attention, gradients);
        self.feed_forward
            .register_gradients(gradient.feed_forward, gradients);
    }
}

impl NamedParameters for DecoderBlock {
    fn keys(&mut self, keys: &mut ParameterList) {
        keys.nested(STYLIZATIONS[0], &mut self.self_attention);
        keys.nested(STYLIZATIONS[1], &mut self.cross_attention);
        keys.nested(STYLIZATIONS[2], &mut self.feed_forward);
    }
}
