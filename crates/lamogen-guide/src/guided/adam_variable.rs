//! A tensor that Adam updates to lower a loss.

use burn::optim::{Adam, AdamConfig, AdamState, Optimizer};
use burn::tensor::Tensor;

use crate::guidance::Guidance;

/// A tensor that Adam updates, with Adam's moments.
pub(super) struct AdamVariable<const D: usize> {
    pub(super) value: Tensor<D>,
    adam: Adam,
    state: Option<AdamState<D>>,
}

impl<const D: usize> AdamVariable<D> {
    pub(super) fn new(value: Tensor<D>, guidance: &Guidance) -> Self {
        let [first, second] = guidance.betas;
        let adam = AdamConfig::new()
            .with_beta_1(first)
            .with_beta_2(second)
            // The default of burn is 1e-5.
            .with_epsilon(guidance.epsilon)
            .build();
        AdamVariable {
            value,
            adam,
            state: None,
        }
    }

    /// Makes one step of Adam.
    pub(super) fn update(&mut self, gradient: Tensor<D>, learning_rate: f64) {
        let (value, state) = self.adam.step(
            learning_rate,
            self.value.clone(),
            gradient,
            self.state.take(),
        );
        self.value = value;
        self.state = state;
    }
}
