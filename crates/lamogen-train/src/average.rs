//! The exponential moving average of a network's weights, which is what is kept of a training.

use burn::module::{Module, ModuleMapper, ModuleVisitor, Param, ParamId};
use burn::tensor::Tensor;
use burn::tensor::container::TensorContainer;

/// Moves an average towards the weights of a network: `average ← decay · average + (1 - decay) · weights`.
///
/// Both are the same network; the average is not tracked by autodiff.
pub(crate) fn follow<M: Module>(average: M, network: &M, decay: f64) -> M {
    average.map(&mut Follow {
        weights: weights(network),
        decay,
    })
}

/// The weights of a network, not followed by autodiff.
pub(crate) fn weights<M: Module>(network: &M) -> TensorContainer<ParamId> {
    let mut weights = Weights(TensorContainer::new());
    network.visit(&mut weights);
    weights.0
}

struct Weights(TensorContainer<ParamId>);

impl ModuleVisitor for Weights {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        self.0.register(param.id, param.val().inner());
    }
}

struct Follow {
    weights: TensorContainer<ParamId>,
    decay: f64,
}

impl ModuleMapper for Follow {
    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        let weights = self.weights.remove::<Tensor<D>>(&param.id);
        let weights = weights.expect("both are the same network");
        let decay = self.decay;
        param.map(|average| average * decay + weights * (1.0 - decay))
    }
}
