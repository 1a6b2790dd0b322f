//! The text tower of CLIP (Radford et al. 2021).

use burn::module::{Initializer, Module, Param};
use burn::nn::{Embedding, EmbeddingConfig, LayerNorm, Linear, LinearConfig};
use burn::tensor::activation::sigmoid;
use burn::tensor::{Device, Int, Tensor};

use super::layer_norm;
use super::text_attention::TextAttention;
use crate::checkpoint::{NamedParameters, ParameterList};
use crate::config::ClipTextConfig;

/// The text tower, which turns token ids into token features. Each token attends to itself and to the tokens before it.
#[derive(Module, Debug)]
pub(crate) struct ClipText {
    token_embedding: Embedding,
    positional_embedding: Param<Tensor<2>>,
    blocks: Vec<ClipBlock>,
    norm: LayerNorm,
}

/// A transformer layer of the text tower.
#[derive(Module, Debug)]
struct ClipBlock {
    attention: TextAttention,
    attention_norm: LayerNorm,
    expand: Linear,
    contract: Linear,
    mlp_norm: LayerNorm,
}

impl ClipText {
    pub(crate) fn new(config: &ClipTextConfig, device: &Device) -> Self {
        let normal = |std| Initializer::Normal { mean: 0.0, std };
        let width = config.width;
        ClipText {
            token_embedding: EmbeddingConfig::new(config.vocab_size, width)
                .with_initializer(normal(0.02))
                .init(device),
            positional_embedding: normal(0.01).init([config.context_length, width], device),
            blocks: (0..config.layers)
                .map(|_| ClipBlock {
                    attention: TextAttention::new(width, config.heads, device),
                    attention_norm: layer_norm(width, device),
                    expand: LinearConfig::new(width, 4 * width).init(device),
                    contract: LinearConfig::new(4 * width, width).init(device),
                    mlp_norm: layer_norm(width, device),
                })
                .collect(),
            norm: layer_norm(width, device),
        }
    }

    /// Computes the token features.
    ///
    /// # Shapes
    ///
    /// - `tokens`: `[batch, tokens]`
    /// - output: `[batch, tokens, width]`, normalised
    pub(crate) fn forward(&self, tokens: Tensor<2, Int>) -> Tensor<3> {
        let [_, count] = tokens.dims();
        let positions = self.positional_embedding.val().narrow(0, 0, count);
        let mask = causal_mask(count, &tokens.device());
        let mut x = self.token_embedding.forward(tokens) + positions.unsqueeze();
        for block in &self.blocks {
            x = block.forward(x, mask.clone());
        }
        self.norm.forward(x)
    }
}

impl ClipBlock {
    fn forward(&self, x: Tensor<3>, mask: Tensor<4>) -> Tensor<3> {
        let attended = self
            .attention
            .forward(self.attention_norm.forward(x.clone()), Some(mask));
        let x = x + attended;
        let hidden = self.expand.forward(self.mlp_norm.forward(x.clone()));
        let hidden = hidden.clone() * sigmoid(hidden * 1.702);
        x + self.contract.forward(hidden)
    }
}

/// Creates the mask of causal attention: minus infinity above the diagonal, so that no token attends to a later one.
fn causal_mask(count: usize, device: &Device) -> Tensor<4> {
    let rows: Vec<f32> = (0..count * count)
        .map(|i| match i % count > i / count {
            true => f32::NEG_INFINITY,
            false => 0.0,
        })
        .collect();
    Tensor::<1>::from_data(rows.as_slice(), device).reshape([1, 1, count, count])
}

impl NamedParameters for ClipText {
    fn keys(&mut self, keys: &mut ParameterList) {
        keys.embedding("token_embedding", &mut self.token_embedding);
        keys.matrix("positional_embedding", &mut self.positional_embedding);
        keys.each("transformer.resblocks", &mut self.blocks);
        keys.norm("ln_final", &mut self.norm);
    }
}

impl NamedParameters for ClipBlock {
    fn keys(&mut self, keys: &mut ParameterList) {
        keys.nested("attn", &mut self.attention);
        keys.norm("ln_1", &mut self.attention_norm);
        keys.linear("mlp.c_fc", &mut self.expand);
        keys.linear("mlp.c_proj", &mut self.contract);
        keys.norm("ln_2", &mut self.mlp_norm);
    }
}

/// The text tower with the keys of Hugging Face's `transformers`, relative to `text_model`.
pub(crate) struct HuggingFaceClip<'a>(pub(crate) &'a mut ClipText);

/// A layer of [`HuggingFaceClip`].
struct HuggingFaceBlock<'a>(&'a mut ClipBlock);

impl NamedParameters for HuggingFaceClip<'_> {
    fn keys(&mut self, keys: &mut ParameterList) {
        let ClipText {
            token_embedding,
            positional_embedding,
            blocks,
            norm,
        } = self.0;
        keys.embedding("embeddings.token_embedding", token_embedding);
        keys.matrix("embeddings.position_embedding.weight", positional_embedding);
        let mut blocks: Vec<_> = blocks.iter_mut().map(HuggingFaceBlock).collect();
        keys.each("encoder.layers", &mut blocks);
        keys.norm("final_layer_norm", norm);
    }
}

impl NamedParameters for HuggingFaceBlock<'_> {
    fn keys(&mut self, keys: &mut ParameterList) {
        let parts = ["q", "k", "v"].map(|part| format!("self_attn.{part}_proj"));
        keys.linear_from_parts(&parts, &mut self.0.attention.in_proj);
        keys.linear("self_attn.out_proj", &mut self.0.attention.out_proj);
        keys.norm("layer_norm1", &mut self.0.attention_norm);
        keys.linear("mlp.fc1", &mut self.0.expand);
        keys.linear("mlp.fc2", &mut self.0.contract);
        keys.norm("layer_norm2", &mut self.0.mlp_norm);
    }
}
