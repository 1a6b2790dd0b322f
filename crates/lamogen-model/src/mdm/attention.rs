//! Softmax attention of frames, with the weights stored as in `torch.nn.MultiheadAttention`.

use burn::module::Module;
use burn::nn::{Linear, LinearConfig};
#[cfg(feature = "flex")]
use burn::optim::GradientsParams;
use burn::tensor::activation::softmax;
use burn::tensor::{Device, Tensor};

use crate::checkpoint::{NamedParameters, ParameterList};
#[cfg(feature = "flex")]
use crate::network::cpu::{self, SharedFloats};
use crate::network::{merge_heads, split_heads};

/// Multi-head attention with query, key and value in one projection.
#[derive(Module, Debug)]
pub(super) struct Attention {
    in_proj: Linear,
    out_proj: Linear,
    heads: usize,
}

impl Attention {
    pub(super) fn new(width: usize, heads: usize, device: &Device) -> Self {
        Attention {
            in_proj: LinearConfig::new(width, 3 * width).init(device),
            out_proj: LinearConfig::new(width, width).init(device),
            heads,
        }
    }

    /// Lets the rows of `x` attend to each other.
    ///
    /// # Shapes
    ///
    /// - `x` and output: `[batch, rows, width]`
    /// - `penalty`: subtracted from the scores of keys, `[batch, 1, 1, rows]`
    pub(super) fn attend_to_self(&self, x: Tensor<3>, penalty: Option<Tensor<4>>) -> Tensor<3> {
        let [query, key, value] = rowwise(&self.in_proj, x)
            .chunk(3, 2)
            .try_into()
            .expect("three equal parts");
        self.combine(query, key, value, penalty)
    }

    /// Lets the rows of `x` attend to those of `memory`.
    ///
    /// # Shapes
    ///
    /// - `x` and output: `[batch, rows, width]`
    /// - `memory`: `[batch, tokens, width]`
    /// - `penalty`: subtracted from the scores of keys, `[batch, 1, 1, tokens]`
    pub(super) fn attend_to(
        &self,
        x: Tensor<3>,
        memory: Tensor<3>,
        penalty: Option<Tensor<4>>,
    ) -> Tensor<3> {
        let [_, _, width] = x.dims();
        let query = rowwise(self.part(0, width), x);
        let [key, value] = rowwise(self.part(width, 2 * width), memory)
            .chunk(2, 2)
            .try_into()
            .expect("two equal parts");
        self.combine(query, key, value, penalty)
    }

    /// Returns the projection to some of the outputs.
    fn part(&self, from: usize, count: usize) -> Projection {
        let bias = self.in_proj.bias.as_ref().expect("a layer with a bias");
        Projection {
            weight: self.in_proj.weight.val().narrow(1, from, count),
            bias: bias.val().narrow(0, from, count),
        }
    }

    fn combine(
        &self,
        query: Tensor<3>,
        key: Tensor<3>,
        value: Tensor<3>,
        penalty: Option<Tensor<4>>,
    ) -> Tensor<3> {
        let scale = ((query.dims()[2] / self.heads) as f64).powf(-0.5);
        let heads = |x| split_heads(x, self.heads);
        let mut scores = heads(query * scale).matmul(heads(key).swap_dims(2, 3));
        if let Some(penalty) = penalty {
            scores = scores - penalty;
        }
        let y = softmax(scores, 3).matmul(heads(value));
        rowwise(&self.out_proj, merge_heads(y))
    }
}

/// The weight and the bias of a linear layer, or of a part of one.
pub(super) struct Projection {
    weight: Tensor<2>,
    bias: Tensor<1>,
}

impl From<&Linear> for Projection {
    fn from(linear: &Linear) -> Self {
        let bias = linear.bias.as_ref().expect("a layer with a bias");
        Projection {
            weight: linear.weight.val(),
            bias: bias.val(),
        }
    }
}

impl From<&Projection> for Projection {
    fn from(projection: &Projection) -> Self {
        Projection {
            weight: projection.weight.clone(),
            bias: projection.bias.clone(),
        }
    }
}

/// Applies a linear layer to all rows of a batch in one product of matrices: `[batch, rows, input]` → `[batch, rows, output]`.
pub(super) fn rowwise(projection: impl Into<Projection>, x: Tensor<3>) -> Tensor<3> {
    let Projection { weight, bias } = projection.into();
    let [batch, rows, input] = x.dims();
    let [_, output] = weight.dims();
    let y = x.reshape([batch * rows, input]).matmul(weight) + bias.unsqueeze();
    y.reshape([batch, rows, output])
}

#[cfg(feature = "flex")]
impl Attention {
    pub(super) fn to_kernel(&self) -> Option<lamogen_cpu::SoftmaxAttention<SharedFloats>> {
        Some(lamogen_cpu::SoftmaxAttention {
            in_proj: cpu::linear_kernel(&self.in_proj)?,
            out_proj: cpu::linear_kernel(&self.out_proj)?,
        })
    }

    pub(super) fn register_gradients(
        &self,
        gradient: lamogen_cpu::SoftmaxAttention<Vec<f32>>,
        gradients: &mut GradientsParams,
    ) {
        cpu::register_linear_gradients(&self.in_proj, gradient.in_proj, gradients);
        cpu::register_linear_gradients(&self.out_proj, gradient.out_proj, gradients);
    }
}

impl NamedParameters for Attention {
    fn keys(&mut self, keys: &mut ParameterList) {
        keys.linear_named("in_proj_weight", "in_proj_bias", &mut self.in_proj);
        keys.linear("out_proj", &mut self.out_proj);
    }
}
