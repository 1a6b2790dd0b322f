//! Softmax attention over tokens, with the weights stored as in `torch.nn.MultiheadAttention`.

use burn::module::Module;
use burn::nn::{Linear, LinearConfig};
use burn::tensor::activation::softmax;
use burn::tensor::{Device, Tensor};

use super::{merge_heads, split_heads};
use crate::checkpoint::{NamedParameters, ParameterList};

/// Multi-head self-attention with query, key and value in one projection.
#[derive(Module, Debug)]
pub(crate) struct TextAttention {
    pub(crate) in_proj: Linear,
    pub(crate) out_proj: Linear,
    heads: usize,
}

impl TextAttention {
    pub(crate) fn new(width: usize, heads: usize, device: &Device) -> Self {
        TextAttention {
            in_proj: LinearConfig::new(width, 3 * width).init(device),
            out_proj: LinearConfig::new(width, width).init(device),
            heads,
        }
    }

    /// Applies the attention.
    ///
    /// # Shapes
    ///
    /// - `x`: `[batch, tokens, width]`
    /// - `mask`: added to the scores, `[1, 1, tokens, tokens]` or `[batch, 1, 1, tokens]`
    /// - output: `[batch, tokens, width]`
    pub(crate) fn forward(&self, x: Tensor<3>, mask: Option<Tensor<4>>) -> Tensor<3> {
        let [query, key, value] = self
            .in_proj
            .forward(x)
            .chunk(3, 2)
            .try_into()
            .expect("three equal parts");
        let scale = ((query.dims()[2] / self.heads) as f64).powf(-0.5);
        let heads = |x| split_heads(x, self.heads);
        let mut scores = (heads(query) * scale).matmul(heads(key).swap_dims(2, 3));
        if let Some(mask) = mask {
            scores = scores + mask;
        }
        let y = softmax(scores, 3).matmul(heads(value));
        self.out_proj.forward(merge_heads(y))
    }
}

impl NamedParameters for TextAttention {
    fn keys(&mut self, keys: &mut ParameterList) {
        keys.linear_named("in_proj_weight", "in_proj_bias", &mut self.in_proj);
        keys.linear("out_proj", &mut self.out_proj);
    }
}
