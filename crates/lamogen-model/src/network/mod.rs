//! The layers of MotionDiffuse and of its text encoder.

mod block;
pub(crate) mod clip;
#[cfg(feature = "flex")]
pub(crate) mod cpu;
mod cross_attention;
mod feed_forward;
mod initial;
#[cfg(feature = "flex")]
mod kept_modulations;
mod laban_embedding;
mod modulation;
mod motion_diffuse;
mod self_attention;
mod stylization;
pub(crate) mod text_attention;
mod text_encoder;
mod time_embedding;
mod training;

pub use cross_attention::CrossAttentionContext;
pub use initial::{WeightSampler, initialize};
pub use motion_diffuse::MotionDiffuse;

use burn::nn::{LayerNorm, LayerNormConfig};
use burn::tensor::{Device, Tensor};

/// The constant that layer normalization adds to the variance, as in PyTorch.
pub(crate) const NORM_EPSILON: f64 = 1e-5;

/// Creates a layer normalization with initial weights.
pub(crate) fn layer_norm(width: usize, device: &Device) -> LayerNorm {
    let config = LayerNormConfig::new(width).with_epsilon(NORM_EPSILON);
    config.init(device)
}

/// Splits the channels among heads: `[batch, positions, width]` → `[batch, heads, positions, width / heads]`.
pub(crate) fn split_heads(x: Tensor<3>, heads: usize) -> Tensor<4> {
    let [batch, positions, width] = x.dims();
    x.reshape([batch, positions, heads, width / heads])
        .swap_dims(1, 2)
}

/// Undoes [`split_heads`].
pub(crate) fn merge_heads(x: Tensor<4>) -> Tensor<3> {
    let [batch, heads, positions, width] = x.dims();
    x.swap_dims(1, 2).reshape([batch, positions, heads * width])
}
