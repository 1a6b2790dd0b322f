//! DistilBERT (Sanh et al. 2019): a transformer that turns word pieces into features.

use burn::module::{Module, Param};
use burn::nn::{Embedding, EmbeddingConfig, LayerNorm, LayerNormConfig, Linear, LinearConfig};
use burn::tensor::activation::gelu;
use burn::tensor::{Device, Int, Tensor};
use serde::Serialize;

use crate::checkpoint::{NamedParameters, ParameterList};
use crate::network::text_attention::TextAttention;

/// The sizes of a DistilBERT.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct DistilBertConfig {
    /// The number of token ids.
    pub vocab_size: usize,
    /// The number of positions, which is that of the tokens of the longest text.
    pub positions: usize,
    /// The width of the features.
    pub width: usize,
    /// The number of attention heads.
    pub heads: usize,
    /// The number of layers.
    pub layers: usize,
    /// The width inside the feed-forward layers.
    pub ff_size: usize,
}

/// The number of channels of an attention head in every public BERT.
pub(super) const HEAD_WIDTH: usize = 64;

/// The constant that the norms add to the variance.
const EPSILON: f64 = 1e-12;

/// The network.
#[derive(Module, Debug)]
pub(super) struct DistilBert {
    word_embedding: Embedding,
    position_embedding: Param<Tensor<2>>,
    norm: LayerNorm,
    layers: Vec<BertLayer>,
}

/// A layer, which normalises after each of its two parts.
#[derive(Module, Debug)]
struct BertLayer {
    attention: TextAttention,
    attention_norm: LayerNorm,
    expand: Linear,
    contract: Linear,
    output_norm: LayerNorm,
}

fn norm(width: usize, device: &Device) -> LayerNorm {
    LayerNormConfig::new(width)
        .with_epsilon(EPSILON)
        .init(device)
}

impl DistilBert {
    pub(super) fn new(config: &DistilBertConfig, device: &Device) -> Self {
        let width = config.width;
        let layer = |_| BertLayer {
            attention: TextAttention::new(width, config.heads, device),
            attention_norm: norm(width, device),
            expand: LinearConfig::new(width, config.ff_size).init(device),
            contract: LinearConfig::new(config.ff_size, width).init(device),
            output_norm: norm(width, device),
        };
        let positions = EmbeddingConfig::new(config.positions, width).init(device);
        DistilBert {
            word_embedding: EmbeddingConfig::new(config.vocab_size, width).init(device),
            position_embedding: positions.weight,
            norm: norm(width, device),
            layers: (0..config.layers).map(layer).collect(),
        }
    }

    /// Computes the features of tokens (the last hidden state).
    ///
    /// # Shapes
    ///
    /// - `tokens`: `[batch, tokens]`
    /// - `penalty`: a large number for tokens that are padding, else 0, `[batch, 1, 1, tokens]`
    /// - output: `[batch, tokens, width]`
    pub(super) fn forward(&self, tokens: Tensor<2, Int>, penalty: Option<&Tensor<4>>) -> Tensor<3> {
        let [_, count] = tokens.dims();
        let positions = self.position_embedding.val().narrow(0, 0, count);
        let x = self.word_embedding.forward(tokens) + positions.unsqueeze();
        let x = self.norm.forward(x);
        self.layers.iter().fold(x, |x, layer| {
            layer.forward(x, penalty.map(|penalty| -penalty.clone()))
        })
    }
}

impl BertLayer {
    fn forward(&self, x: Tensor<3>, mask: Option<Tensor<4>>) -> Tensor<3> {
        let attended = self.attention.forward(x.clone(), mask);
        let x = self.attention_norm.forward(x + attended);
        let hidden = self.contract.forward(gelu(self.expand.forward(x.clone())));
        self.output_norm.forward(x + hidden)
    }
}

impl NamedParameters for DistilBert {
    fn keys(&mut self, keys: &mut ParameterList) {
        keys.embedding("embeddings.word_embeddings", &mut self.word_embedding);
        keys.matrix(
            "embeddings.position_embeddings.weight",
            &mut self.position_embedding,
        );
        keys.norm("embeddings.LayerNorm", &mut self.norm);
        keys.each("transformer.layer", &mut self.layers);
    }
}

impl NamedParameters for BertLayer {
    fn keys(&mut self, keys: &mut ParameterList) {
        let parts = ["q", "k", "v"].map(|part| format!("attention.{part}_lin"));
        keys.linear_from_parts(&parts, &mut self.attention.in_proj);
        keys.linear("attention.out_lin", &mut self.attention.out_proj);
        keys.norm("sa_layer_norm", &mut self.attention_norm);
        keys.linear("ffn.lin1", &mut self.expand);
        keys.linear("ffn.lin2", &mut self.contract);
        keys.norm("output_layer_norm", &mut self.output_norm);
    }
}
