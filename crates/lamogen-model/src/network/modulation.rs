//! How the condition reaches the blocks: a scale and a shift for every stylization layer.

use burn::module::Module;
use burn::nn::{Linear, LinearConfig};
use burn::tensor::activation::silu;
use burn::tensor::{Device, Tensor};

/// Scales and shifts of all stylization layers, in one matrix product instead of one a layer.
#[derive(Module, Debug)]
pub(super) struct Modulations {
    pub(super) project: Linear,
    latent: usize,
}

/// Scale and shift of one stylization layer, `[batch, 1, latent]` each.
#[derive(Clone, Debug)]
pub(super) struct Modulation {
    pub(super) scale: Tensor<3>,
    pub(super) shift: Tensor<3>,
}

impl Modulations {
    pub(super) fn new(layers: usize, latent: usize, condition: usize, device: &Device) -> Self {
        Modulations {
            project: LinearConfig::new(condition, layers * 2 * latent).init(device),
            latent,
        }
    }

    /// Scales and shifts of all layers.
    pub(super) fn width(&self) -> usize {
        let [_, width] = self.project.weight.lazy_shape().dims();
        width
    }

    /// Modulations in the order of the layers.
    ///
    /// # Shapes
    ///
    /// - `condition`: `[batch, d_condition]`, timestep plus sentence embedding
    /// - `added`: `[batch, width]`, to all scales and shifts
    pub(super) fn forward(
        &self,
        condition: Tensor<2>,
        added: Option<Tensor<2>>,
    ) -> impl Iterator<Item = Modulation> {
        let latent = self.latent;
        let mut all = self.project.forward(silu(condition));
        if let Some(added) = added {
            all = all + added;
        }
        let all = all.unsqueeze_dim::<3>(1);
        let [_, _, width] = all.dims();
        let part = move |start: usize| all.clone().narrow(2, start, latent);
        (0..width).step_by(2 * latent).map(move |start| Modulation {
            scale: part(start),
            shift: part(start + latent),
        })
    }
}
