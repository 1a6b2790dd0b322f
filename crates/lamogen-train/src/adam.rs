//! One step of burn's AdamW on every weight of a network.
//!
//! The moments are stored as networks: the moment of a weight takes the place of the weight. They are therefore saved and read
//! in the same way as networks.

use burn::module::{Module, ModuleMapper, Param, ParamId};
use burn::optim::{AdamW, AdamWState, AdaptiveMomentumState, GradientsParams, Optimizer};
use burn::tensor::Tensor;
use burn::tensor::container::TensorContainer;

use crate::average::weights;
use crate::optimization::has_weight_decay;

/// The first and the second moments of all weights.
pub(crate) type Moments<M> = [M; 2];

/// Returns the moments before the first step, which are zeros.
pub(crate) fn zeros<M: Module>(network: &M) -> Moments<M> {
    struct Zeros;
    impl ModuleMapper for Zeros {
        fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
            param.map(|weights| weights.zeros_like())
        }
    }
    [(); 2].map(|()| network.valid().map(&mut Zeros))
}

/// Makes one step. `previous_steps` is the number of steps before it; `adam` is the optimiser of weights with weight decay, then
/// that of the other weights.
pub(crate) fn step<M: Module>(
    network: M,
    moments: Moments<M>,
    gradients: GradientsParams,
    adam: [AdamW; 2],
    rate: f64,
    previous_steps: u64,
) -> (M, Moments<M>) {
    let mut updater = AdamWUpdater {
        path: Vec::new(),
        gradients,
        moments: [weights(&moments[0]), weights(&moments[1])],
        adam,
        rate,
        previous_steps: previous_steps as usize,
    };
    let network = network.map(&mut updater);
    let [first, second] = updater.moments;
    let [old_first, old_second] = moments;
    let first = old_first.map(&mut WeightReplacer(first));
    (
        network,
        [first, old_second.map(&mut WeightReplacer(second))],
    )
}

/// Updates each weight of a network, and its moments.
struct AdamWUpdater {
    /// The names of the modules around the current weight.
    path: Vec<String>,
    gradients: GradientsParams,
    moments: [TensorContainer<ParamId>; 2],
    adam: [AdamW; 2],
    /// The learning rate.
    rate: f64,
    previous_steps: usize,
}

impl ModuleMapper for AdamWUpdater {
    fn enter_module(&mut self, name: &str, _: &str) {
        self.path.push(name.to_owned());
    }

    fn exit_module(&mut self, _: &str, _: &str) {
        self.path.pop();
    }

    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        let id = param.id;
        // A weight on which the loss does not depend keeps its value.
        let Some(gradient) = self.gradients.remove::<D>(id) else {
            return param;
        };
        let adam = match has_weight_decay(&self.path, D) {
            true => &self.adam[0],
            false => &self.adam[1],
        };
        let moments = &mut self.moments;
        let [first, second] = moments.each_mut().map(|moments| {
            let moments = moments.remove::<Tensor<D>>(&id);
            moments.expect("moments are of the same network")
        });
        let state = AdamWState::new(AdaptiveMomentumState::new(
            self.previous_steps,
            first,
            second,
        ));
        let rate = self.rate;
        let mut new_state = None;
        let param = param.map(|weights| {
            let (weights, state) = adam.step(rate, weights.inner(), gradient, Some(state));
            new_state = state;
            weights.autodiff().require_grad()
        });
        let new_moments = new_state.expect("AdamW has a state").momentum;
        moments[0].register(id, new_moments.moment_1);
        moments[1].register(id, new_moments.moment_2);
        param
    }
}

/// Replaces every weight by the value with the same id.
struct WeightReplacer(TensorContainer<ParamId>);

impl ModuleMapper for WeightReplacer {
    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        let value = self.0.remove::<Tensor<D>>(&param.id);
        let value = value.expect("values are of the same network");
        param.map(|_| value)
    }
}
