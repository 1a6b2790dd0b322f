//! Gradient clipping over a whole network.

use burn::module::{Module, ModuleVisitor, Param};
use burn::optim::GradientsParams;
use burn::tensor::Tensor;

/// Scales the gradients of all weights down so that their common norm is at most `max_norm`. Also returns the norm before that.
pub(crate) fn clip<M: Module>(
    gradients: GradientsParams,
    network: &M,
    max_norm: f64,
) -> (Tensor<1>, GradientsParams) {
    let mut squares = SquaredNorm {
        gradients: &gradients,
        sum: None,
    };
    network.visit(&mut squares);
    let norm = squares.sum.expect("a network has weights").sqrt();
    let mut scaler = GradientClipper {
        gradients,
        // At most 1, so that gradients with a smaller norm keep their values.
        factor: (norm.clone() + 1e-6)
            .recip()
            .mul_scalar(max_norm)
            .clamp_max(1.0),
        scaled: GradientsParams::new(),
    };
    network.visit(&mut scaler);
    (norm, scaler.scaled)
}

/// Sums the squares of the gradients of all weights.
struct SquaredNorm<'a> {
    gradients: &'a GradientsParams,
    sum: Option<Tensor<1>>,
}

impl ModuleVisitor for SquaredNorm<'_> {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        if let Some(gradient) = self.gradients.get::<D>(param.id) {
            // Summed in two stages: a single sum of millions of numbers adds them in a different order each time.
            let sum = gradient.square().sum_dim(0).sum();
            self.sum = Some(match self.sum.take() {
                Some(previous) => previous + sum,
                None => sum,
            });
        }
    }
}

/// Multiplies the gradients of all weights by a factor.
struct GradientClipper {
    gradients: GradientsParams,
    factor: Tensor<1>,
    scaled: GradientsParams,
}

impl ModuleVisitor for GradientClipper {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        if let Some(gradient) = self.gradients.remove::<D>(param.id) {
            let factor = self.factor.clone().reshape([1; D]);
            self.scaled.register(param.id, gradient * factor);
        }
    }
}
