//! What guidance may add to the layers, beside the embedding: offsets of the norms and of the conditioning tokens.

use burn::nn::LayerNorm;
use burn::tensor::Tensor;

use super::config::{MdmArchitecture, MdmConfig};
use crate::network::NORM_EPSILON;

/// The numbers of offsets of a network, in the order in which they lie in the modulation: for each norm of each layer the
/// gains and then the biases, and after all of these a token's offset for each layer.
#[derive(Clone, Copy, Debug)]
pub(super) struct OffsetLayout {
    layers: usize,
    norms: usize,
    latent: usize,
}

/// What is added to the gain and the bias of a norm, `[batch, 1, latent]` each.
pub(super) struct NormOffset {
    gain: Tensor<3>,
    bias: Tensor<3>,
}

/// What is added in one layer.
pub(super) struct LayerOffsets {
    /// One for each norm of the layer.
    pub(super) norms: Vec<NormOffset>,
    /// The offset of the conditioning tokens at the layer's input, `[batch, 1, latent]`.
    pub(super) token: Tensor<3>,
}

impl OffsetLayout {
    pub(super) fn of(config: &MdmConfig) -> Self {
        OffsetLayout {
            layers: config.layers,
            norms: match config.arch {
                MdmArchitecture::Encoder => 2,
                MdmArchitecture::Decoder => 3,
            },
            latent: config.latent_dim,
        }
    }

    /// Returns the number of gains and biases.
    pub(super) fn norm_width(self) -> usize {
        self.layers * self.norms * 2 * self.latent
    }

    /// Returns the number of offsets of tokens.
    pub(super) fn token_width(self) -> usize {
        self.layers * self.latent
    }

    /// Returns the part of `[batch, norm_width + token_width]` that belongs to a layer.
    pub(super) fn layer(self, offsets: &Tensor<2>, layer: usize) -> LayerOffsets {
        let all = offsets.clone().unsqueeze_dim::<3>(1);
        let part = |start: usize| all.clone().narrow(2, start, self.latent);
        let norms = (0..self.norms).map(|norm| {
            let start = (layer * self.norms + norm) * 2 * self.latent;
            NormOffset {
                gain: part(start),
                bias: part(start + self.latent),
            }
        });
        LayerOffsets {
            norms: norms.collect(),
            token: part(self.norm_width() + layer * self.latent),
        }
    }
}

/// Normalises rows, `[batch, rows, latent]`, with what is added to the norm's gain and bias.
pub(super) fn normalize(norm: &LayerNorm, x: Tensor<3>, offset: Option<NormOffset>) -> Tensor<3> {
    let Some(NormOffset { gain, bias }) = offset else {
        return norm.forward(x);
    };
    let centered = x.clone() - x.mean_dim(2);
    let variance = centered.clone().square().mean_dim(2);
    let normalized = centered / (variance + NORM_EPSILON).sqrt();
    let beta = norm.beta.as_ref().expect("a norm with a bias");
    normalized * (norm.gamma.val().unsqueeze::<3>() + gain) + beta.val().unsqueeze::<3>() + bias
}
