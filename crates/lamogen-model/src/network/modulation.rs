//! The modulation of the blocks by the condition: a scale and a shift for every stylization layer.

use burn::module::{Module, Param};
use burn::nn::{Linear, LinearConfig};
use burn::tensor::activation::silu;
use burn::tensor::{Device, Tensor};

/// The linear layer that computes the scales and shifts of all stylization layers in one matrix product.
#[derive(Module, Debug)]
pub(super) struct ModulationProjection {
    pub(super) project: Linear,
    latent: usize,
}

/// The scale and shift of one stylization layer, `[batch, 1, latent]` each.
#[derive(Clone, Debug)]
pub(super) struct Modulation {
    pub(super) scale: Tensor<3>,
    pub(super) shift: Tensor<3>,
}

impl ModulationProjection {
    pub(super) fn new(layers: usize, latent: usize, condition: usize, device: &Device) -> Self {
        ModulationProjection {
            project: LinearConfig::new(condition, layers * 2 * latent).init(device),
            latent,
        }
    }

    /// Returns the projection with the further layers of a wider one after its own.
    pub(super) fn extended(self, wider: ModulationProjection) -> Self {
        let own = self.width();
        let further = wider.width() - own;
        let weight = wider.project.weight.val().narrow(1, own, further);
        let bias = wider
            .project
            .bias
            .map(|bias| bias.val().narrow(0, own, further));
        let project = Linear {
            weight: Param::from_tensor(Tensor::cat(vec![self.project.weight.val(), weight], 1)),
            bias: { self.project.bias }
                .zip(bias)
                .map(|(own, further)| Param::from_tensor(Tensor::cat(vec![own.val(), further], 0))),
        };
        ModulationProjection { project, ..self }
    }

    /// Returns the number of scales and shifts of all layers together.
    pub(super) fn width(&self) -> usize {
        let [_, width] = self.project.weight.lazy_shape().dims();
        width
    }

    /// Computes the modulations in the order of the layers.
    ///
    /// # Shapes
    ///
    /// - `condition`: `[batch, d_condition]`, timestep plus sentence embedding
    /// - `added`: `[batch, width]`, an optional offset that is added to all scales and shifts
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
