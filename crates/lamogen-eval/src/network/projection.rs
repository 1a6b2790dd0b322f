//! The projection of a recurrent network's states into the space of embeddings.

use burn::module::Module;
use burn::nn::{LayerNorm, LayerNormConfig, Linear};
use burn::tensor::{Device, Tensor};
use lamogen_model::{NamedParameters, ParameterList};

use super::{leaky_relu, linear};

/// The projection: a linear layer, a layer normalisation and a second linear layer.
#[derive(Module, Debug)]
pub(super) struct Projection {
    input: Linear,
    norm: LayerNorm,
    output: Linear,
}

impl Projection {
    /// Returns a projection of the states of both directions, each of width `hidden`.
    pub(super) fn new(hidden: usize, output: usize, device: &Device) -> Self {
        Projection {
            input: linear(2 * hidden, hidden, device),
            // The epsilon is PyTorch's default.
            norm: LayerNormConfig::new(hidden).with_epsilon(1e-5).init(device),
            output: linear(hidden, output, device),
        }
    }

    /// Projects states into the space of embeddings.
    ///
    /// # Shapes
    ///
    /// - `states`: `[batch, 2 * hidden]`
    /// - output: `[batch, output]`
    pub(super) fn forward(&self, states: Tensor<2>) -> Tensor<2> {
        let x = self.norm.forward(self.input.forward(states));
        self.output.forward(leaky_relu(x))
    }
}

impl NamedParameters for Projection {
    fn keys(&mut self, keys: &mut ParameterList) {
        keys.linear("0", &mut self.input);
        keys.norm("1", &mut self.norm);
        keys.linear("3", &mut self.output);
    }
}
