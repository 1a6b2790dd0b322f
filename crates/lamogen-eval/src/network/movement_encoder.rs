//! The encoder from frames to movements.

use burn::module::{Initializer, Module};
use burn::nn::conv::{Conv1d, Conv1dConfig};
use burn::nn::{Linear, PaddingConfig1d};
use burn::tensor::{Device, Tensor};
use lamogen_model::{NamedParameters, ParameterList};

use super::{Dropout, WEIGHTS, leaky_relu, linear};
use crate::EvaluatorConfig;

/// The movement encoder: two convolutions over frames, each of which halves their number, and a linear layer.
///
/// In the public code it is the encoder of a motion autoencoder, which is trained first and not changed afterwards.
#[derive(Module, Debug)]
pub(crate) struct MovementEncoder {
    first: Conv1d,
    second: Conv1d,
    output: Linear,
}

impl MovementEncoder {
    pub(crate) fn new(config: &EvaluatorConfig, device: &Device) -> Self {
        let (hidden, latent) = (config.dim_movement_enc_hidden, config.dim_movement_latent);
        MovementEncoder {
            first: strided_convolution(config.movement_features(), hidden, device),
            second: strided_convolution(hidden, latent, device),
            output: linear(latent, latent, device),
        }
    }

    /// Encodes frames as movements.
    ///
    /// # Shapes
    ///
    /// - `features`: `[batch, frames, movement_features]`, normalised
    /// - output: `[batch, frames / 4, dim_movement_latent]`
    pub(crate) fn forward(
        &self,
        features: Tensor<3>,
        mut dropout: Option<Dropout<'_>>,
    ) -> Tensor<3> {
        let mut x = features.swap_dims(1, 2);
        for convolution in [&self.first, &self.second] {
            x = convolution.forward(x);
            if let Some(dropout) = &mut dropout {
                x = dropout.apply(x);
            }
            x = leaky_relu(x);
        }
        self.output.forward(x.swap_dims(1, 2))
    }
}

/// Returns a convolution over 4 frames with stride 2 and one frame of zeros on either side.
fn strided_convolution(input: usize, output: usize, device: &Device) -> Conv1d {
    let config = Conv1dConfig::new(input, output, 4)
        .with_stride(2)
        .with_padding(PaddingConfig1d::Explicit(1, 1))
        .with_initializer(WEIGHTS);
    let mut convolution = config.init(device);
    convolution.bias = Some(Initializer::Zeros.init([output], device));
    convolution
}

impl NamedParameters for MovementEncoder {
    fn keys(&mut self, keys: &mut ParameterList) {
        keys.conv1d("main.0", &mut self.first);
        keys.conv1d("main.3", &mut self.second);
        keys.linear("out_net", &mut self.output);
    }
}
