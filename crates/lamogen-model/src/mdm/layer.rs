//! The transformer layer: attention among frames, attention to the text in a decoder, and feed-forward layers.

use burn::module::Module;
use burn::nn::{LayerNorm, Linear, LinearConfig};
#[cfg(feature = "flex")]
use burn::optim::GradientsParams;
use burn::tensor::activation::gelu;
use burn::tensor::{Device, Tensor};

use super::attention::{Attention, rowwise};
use super::conditioning::{NormOffset, normalize};
use super::config::{MdmArchitecture, MdmConfig};
use crate::checkpoint::{NamedParameters, ParameterList};
#[cfg(feature = "flex")]
use crate::network::cpu::{self, SharedFloats};
use crate::network::layer_norm;

/// A layer of the encoder or decoder, which normalises after each of its parts (`torch.nn.TransformerEncoderLayer` and
/// `TransformerDecoderLayer`).
#[derive(Module, Debug)]
pub(super) struct Layer {
    self_attention: Attention,
    text_attention: Option<Attention>,
    expand: Linear,
    contract: Linear,
    /// One norm after each part, in their order.
    norms: Vec<LayerNorm>,
}

/// The tokens of the text that a decoder attends to.
#[derive(Clone)]
pub(super) struct Memory {
    /// `[batch, tokens, latent]`
    pub(super) tokens: Tensor<3>,
    /// Subtracted from the scores of tokens that are padding, `[batch, 1, 1, tokens]`.
    pub(super) penalty: Option<Tensor<4>>,
}

impl Layer {
    pub(super) fn new(config: &MdmConfig, device: &Device) -> Self {
        let (latent, heads) = (config.latent_dim, config.heads);
        let text_attention = match config.arch {
            MdmArchitecture::Encoder => None,
            MdmArchitecture::Decoder => Some(Attention::new(latent, heads, device)),
        };
        let norms = match text_attention {
            None => 2,
            Some(_) => 3,
        };
        Layer {
            self_attention: Attention::new(latent, heads, device),
            text_attention,
            expand: LinearConfig::new(latent, config.ff_size).init(device),
            contract: LinearConfig::new(config.ff_size, latent).init(device),
            norms: (0..norms).map(|_| layer_norm(latent, device)).collect(),
        }
    }

    /// Applies the layer.
    ///
    /// # Shapes
    ///
    /// - `x` and output: `[batch, rows, latent]`
    /// - `penalty`: subtracted from the scores of rows that are padding, `[batch, 1, 1, rows]`
    ///
    /// # Panics
    ///
    /// If the layer attends to a text and there is no memory.
    pub(super) fn forward(
        &self,
        x: Tensor<3>,
        penalty: Option<Tensor<4>>,
        memory: Option<&Memory>,
        norm_offsets: Vec<NormOffset>,
    ) -> Tensor<3> {
        let (mut norms, mut offsets) = (self.norms.iter(), norm_offsets.into_iter());
        let mut add = |x: Tensor<3>, part: Tensor<3>| {
            let norm = norms.next().expect("a norm for each part");
            normalize(norm, x + part, offsets.next())
        };
        let attended = self.self_attention.attend_to_self(x.clone(), penalty);
        let mut x = add(x, attended);
        if let Some(attention) = &self.text_attention {
            let Memory { tokens, penalty } = memory.expect("a decoder has a memory").clone();
            let attended = attention.attend_to(x.clone(), tokens, penalty);
            x = add(x, attended);
        }
        let hidden = gelu(rowwise(&self.expand, x.clone()));
        let hidden = rowwise(&self.contract, hidden);
        add(x, hidden)
    }
}

#[cfg(feature = "flex")]
impl Layer {
    pub(super) fn to_kernel(&self) -> Option<lamogen_cpu::TransformerLayer<SharedFloats>> {
        let norms = self.norms.iter().map(cpu::norm_kernel);
        let text_attention = match &self.text_attention {
            Some(attention) => Some(attention.to_kernel()?),
            None => None,
        };
        Some(lamogen_cpu::TransformerLayer {
            self_attention: self.self_attention.to_kernel()?,
            text_attention,
            expand: cpu::linear_kernel(&self.expand)?,
            contract: cpu::linear_kernel(&self.contract)?,
            norms: norms.collect::<Option<_>>()?,
        })
    }

    pub(super) fn register_gradients(
        &self,
        gradient: lamogen_cpu::TransformerLayer<Vec<f32>>,
        gradients: &mut GradientsParams,
    ) {
        { &self.self_attention }.register_gradients(gradient.self_attention, gradients);
        let text = self.text_attention.as_ref().zip(gradient.text_attention);
        if let Some((attention, gradient)) = text {
            attention.register_gradients(gradient, gradients);
        }
        cpu::register_linear_gradients(&self.expand, gradient.expand, gradients);
        cpu::register_linear_gradients(&self.contract, gradient.contract, gradients);
        for (norm, gradient) in self.norms.iter().zip(gradient.norms) {
            cpu::register_norm_gradients(norm, gradient, gradients);
        }
    }
}

impl NamedParameters for Layer {
    fn keys(&mut self, keys: &mut ParameterList) {
        keys.nested("self_attn", &mut self.self_attention);
        if let Some(attention) = &mut self.text_attention {
            keys.nested("multihead_attn", attention);
        }
        keys.linear("linear1", &mut self.expand);
        keys.linear("linear2", &mut self.contract);
        for (index, norm) in self.norms.iter_mut().enumerate() {
            keys.norm(&format!("norm{}", index + 1), norm);
        }
    }
}
