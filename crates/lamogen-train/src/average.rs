//! The exponential moving average of a network's weights, which is the result of a training.

use burn::module::{Module, ModuleMapper, ModuleVisitor, Param, ParamId};
use burn::tensor::Tensor;
use burn::tensor::container::TensorContainer;

/// Moves an average towards the weights of a network: `average ← decay · average + (1 - decay) · weights`.
///
/// Both are versions of the same network; autodiff does not track the average.
pub(crate) fn update<M: Module>(average: M, network: &M, decay: f64) -> M {
    average.map(&mut AverageUpdater {
        weights: weights(network),
        decay,
    })
}

/// Returns the weights of a network, not tracked by autodiff.
pub(crate) fn weights<M: Module>(network: &M) -> TensorContainer<ParamId> {
    let mut collector = WeightCollector(TensorContainer::new());
    network.visit(&mut collector);
    collector.0
}

/// Collects the weights of a network by their ids.
struct WeightCollector(TensorContainer<ParamId>);

impl ModuleVisitor for WeightCollector {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        self.0.register(param.id, param.val().inner());
    }
}

/// Moves each weight of an average towards the weight of the same id.
struct AverageUpdater {
    weights: TensorContainer<ParamId>,
    decay: f64,
}

impl ModuleMapper for AverageUpdater {
    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        let weights = self.weights.remove::<Tensor<D>>(&param.id);
        let weights = weights.expect("both are the same network");
        let decay = self.decay;
        param.map(|average| average * decay + weights * (1.0 - decay))
    }
}
