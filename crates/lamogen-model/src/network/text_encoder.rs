//! MotionDiffuse's text encoder: a small transformer on CLIP's token features.

use burn::module::Module;
use burn::nn::{LayerNorm, Linear, LinearConfig};
use burn::tensor::activation::gelu;
use burn::tensor::{Device, Int, Tensor};

use super::clip::ClipText;
use super::layer_norm;
use super::text_attention::TextAttention;
use crate::checkpoint::{NamedParameters, ParameterList};
use crate::config::ModelConfig;

/// The text encoder, which turns token ids into the projected sentence embedding and the token features.
#[derive(Module, Debug)]
pub(super) struct TextEncoder {
    clip: ClipText,
    narrow: Option<Linear>,
    layers: Vec<TextLayer>,
    norm: LayerNorm,
    project: Linear,
}

/// A transformer encoder layer that normalises after each of its two parts (`torch.nn.TransformerEncoderLayer`).
#[derive(Module, Debug)]
struct TextLayer {
    attention: TextAttention,
    attention_norm: LayerNorm,
    expand: Linear,
    contract: Linear,
    mlp_norm: LayerNorm,
}

impl TextEncoder {
    pub(super) fn new(config: &ModelConfig, device: &Device) -> Self {
        let width = config.text_latent_dim;
        TextEncoder {
            clip: ClipText::new(&config.clip, device),
            narrow: (width != config.clip.width)
                .then(|| LinearConfig::new(config.clip.width, width).init(device)),
            layers: (0..config.num_text_layers)
                .map(|_| TextLayer {
                    attention: TextAttention::new(width, config.text_num_heads, device),
                    attention_norm: layer_norm(width, device),
                    expand: LinearConfig::new(width, config.text_ff_size).init(device),
                    contract: LinearConfig::new(config.text_ff_size, width).init(device),
                    mlp_norm: layer_norm(width, device),
                })
                .collect(),
            norm: layer_norm(width, device),
            project: LinearConfig::new(width, config.condition_dim()).init(device),
        }
    }

    /// Computes the token features.
    ///
    /// # Shapes
    ///
    /// - `tokens`: `[batch, tokens]`
    /// - token features: `[batch, tokens, text_latent_dim]`
    pub(super) fn forward(&self, tokens: Tensor<2, Int>) -> Tensor<3> {
        let mut x = self.clip.forward(tokens);
        if let Some(narrow) = &self.narrow {
            x = narrow.forward(x);
        }
        for layer in &self.layers {
            x = layer.forward(x);
        }
        self.norm.forward(x)
    }

    /// Returns the features of each sentence's end token, which has the largest id of its row: `[batch, text_latent_dim]`.
    pub(super) fn sentence_features(features: &Tensor<3>, tokens: Tensor<2, Int>) -> Tensor<2> {
        let [batch, _, width] = features.dims();
        let end = tokens.argmax(1).reshape([batch, 1, 1]).repeat_dim(2, width);
        features.clone().gather(1, end).reshape([batch, width])
    }

    /// Computes the sentence embeddings, `[batch, d_condition]`.
    pub(super) fn project(&self, features: &Tensor<3>, tokens: Tensor<2, Int>) -> Tensor<2> {
        self.project
            .forward(Self::sentence_features(features, tokens))
    }
}

impl TextLayer {
    fn forward(&self, x: Tensor<3>) -> Tensor<3> {
        let attended = self.attention.forward(x.clone(), None);
        let x = self.attention_norm.forward(x + attended);
        let hidden = self.contract.forward(gelu(self.expand.forward(x.clone())));
        self.mlp_norm.forward(x + hidden)
    }
}

impl NamedParameters for TextEncoder {
    fn keys(&mut self, keys: &mut ParameterList) {
        keys.nested("clip", &mut self.clip);
        if let Some(narrow) = &mut self.narrow {
            keys.linear("text_pre_proj", narrow);
        }
        keys.each("textTransEncoder.layers", &mut self.layers);
        keys.norm("text_ln", &mut self.norm);
        keys.linear("text_proj.0", &mut self.project);
    }
}

impl NamedParameters for TextLayer {
    fn keys(&mut self, keys: &mut ParameterList) {
        keys.nested("self_attn", &mut self.attention);
        keys.norm("norm1", &mut self.attention_norm);
        keys.linear("linear1", &mut self.expand);
        keys.linear("linear2", &mut self.contract);
        keys.norm("norm2", &mut self.mlp_norm);
    }
}
