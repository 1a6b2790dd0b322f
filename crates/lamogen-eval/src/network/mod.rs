//! The layers of the text-motion matching network.

mod dropout;
mod gru;
mod motion_encoder;
mod movement_encoder;
mod projection;
mod text_encoder;

pub use dropout::Dropout;
pub(crate) use motion_encoder::MotionEncoder;
pub(crate) use movement_encoder::MovementEncoder;
pub(crate) use text_encoder::TextEncoder;

use burn::module::Initializer;
use burn::nn::Linear;
use burn::tensor::{Device, Tensor, activation};

/// The slope of the leaky ReLU below 0.
const NEGATIVE_SLOPE: f64 = 0.2;

/// The initial weights of convolutions and linear layers in the public code. Their biases are 0 at first.
const WEIGHTS: Initializer = Initializer::XavierNormal { gain: 1.0 };

/// Returns a linear layer with initial weights.
fn linear(input: usize, output: usize, device: &Device) -> Linear {
    Linear {
        weight: WEIGHTS.init_with([input, output], Some(input), Some(output), device),
        bias: Some(Initializer::Zeros.init([output], device)),
    }
}

fn leaky_relu<const D: usize>(x: Tensor<D>) -> Tensor<D> {
    activation::leaky_relu(x, NEGATIVE_SLOPE)
}
