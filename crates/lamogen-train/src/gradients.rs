//! Gradients of a whole network.

use burn::module::{Module, ModuleVisitor, Param};
use burn::optim::GradientsParams;
use burn::tensor::Tensor;

/// Cuts a gradient to a length over all weights together. Also returns how long it was.
pub(crate) fn cut<M: Module>(
    gradients: GradientsParams,
    network: &M,
    longest: f64,
) -> (Tensor<1>, GradientsParams) {
    let mut squares = Squares {
        gradients: &gradients,
        sum: None,
    };
    network.visit(&mut squares);
    let norm = squares.sum.expect("a network has weights").sqrt();
    let mut scaled = Scaled {
        gradients,
        // At most 1: shorter gradients stay as they are.
        factor: (norm.clone() + 1e-6)
            .recip()
            .mul_scalar(longest)
            .clamp_max(1.0),
        out: GradientsParams::new(),
    };
    network.visit(&mut scaled);
    (norm, scaled.out)
}

struct Squares<'a> {
    gradients: &'a GradientsParams,
    sum: Option<Tensor<1>>,
}

impl ModuleVisitor for Squares<'_> {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        if let Some(gradient) = self.gradients.get::<D>(param.id) {
            // In two parts: a sum of millions of numbers at once runs in another order each time.
            let sum = gradient.square().sum_dim(0).sum();
            self.sum = Some(match self.sum.take() {
                Some(others) => others + sum,
                None => sum,
            });
        }
    }
}

struct Scaled {
    gradients: GradientsParams,
    factor: Tensor<1>,
    out: GradientsParams,
}

impl ModuleVisitor for Scaled {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        if let Some(gradient) = self.gradients.remove::<D>(param.id) {
            let factor = self.factor.clone().reshape([1; D]);
            self.out.register(param.id, gradient * factor);
        }
    }
}
