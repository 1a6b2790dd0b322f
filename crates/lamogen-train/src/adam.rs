//! burn's AdamW on every weight of a network.
//!
//! The moments are networks themselves, whose weights are the moments of the weights in their place: they are saved and read as networks are.

use burn::module::{Module, ModuleMapper, Param, ParamId};
use burn::optim::{AdamW, AdamWState, AdaptiveMomentumState, GradientsParams, Optimizer};
use burn::tensor::Tensor;
use burn::tensor::container::TensorContainer;

use crate::average::weights;
use crate::optimization::decays;

/// First and second moments of all weights.
pub(crate) type Moments<M> = [M; 2];

/// Moments before the first step: zeros.
pub(crate) fn zeros<M: Module>(network: &M) -> Moments<M> {
    struct Zeros;
    impl ModuleMapper for Zeros {
        fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
            param.map(|weights| weights.zeros_like())
        }
    }
    [(); 2].map(|()| network.valid().map(&mut Zeros))
}

/// One step. `made` is how many were made before, `adam` that of matrices and that of other weights.
pub(crate) fn step<M: Module>(
    network: M,
    moments: Moments<M>,
    gradients: GradientsParams,
    adam: [AdamW; 2],
    rate: f64,
    made: u64,
) -> (M, Moments<M>) {
    let mut step = Step {
        path: Vec::new(),
        gradients,
        moments: [weights(&moments[0]), weights(&moments[1])],
        adam,
        rate,
        made: made as usize,
    };
    let network = network.map(&mut step);
    let [first, second] = step.moments;
    let [old_first, old_second] = moments;
    let first = old_first.map(&mut Replaced(first));
    (network, [first, old_second.map(&mut Replaced(second))])
}

struct Step {
    path: Vec<String>,
    gradients: GradientsParams,
    moments: [TensorContainer<ParamId>; 2],
    adam: [AdamW; 2],
    rate: f64,
    made: usize,
}

impl ModuleMapper for Step {
    fn enter_module(&mut self, name: &str, _: &str) {
        self.path.push(name.to_owned());
    }

    fn exit_module(&mut self, _: &str, _: &str) {
        self.path.pop();
    }

    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        let id = param.id;
        // A weight that the loss does not depend on stays.
        let Some(gradient) = self.gradients.remove::<D>(id) else {
            return param;
        };
        let adam = match decays(&self.path, D) {
            true => &self.adam[0],
            false => &self.adam[1],
        };
        let moments = &mut self.moments;
        let [first, second] = moments.each_mut().map(|moments| {
            let moments = moments.remove::<Tensor<D>>(&id);
            moments.expect("moments are of the same network")
        });
        let state = AdamWState::new(AdaptiveMomentumState::new(self.made, first, second));
        let rate = self.rate;
        let mut after = None;
        let param = param.map(|weights| {
            let (weights, state) = adam.step(rate, weights.inner(), gradient, Some(state));
            after = state;
            weights.autodiff().require_grad()
        });
        let after = after.expect("AdamW has a state").momentum;
        moments[0].register(id, after.moment_1);
        moments[1].register(id, after.moment_2);
        param
    }
}

/// Gives every weight the value that is kept under its name.
struct Replaced(TensorContainer<ParamId>);

impl ModuleMapper for Replaced {
    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        let value = self.0.remove::<Tensor<D>>(&param.id);
        let value = value.expect("values are of the same network");
        param.map(|_| value)
    }
}
