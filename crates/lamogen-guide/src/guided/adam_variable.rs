//! A tensor that Adam moves down a loss.

use burn::optim::{Adam, AdamConfig, AdamState, Optimizer};
use burn::tensor::Tensor;

use crate::guidance::Guidance;

/// A tensor that Adam moves, with its moments.
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
            // burn's own default is 1e-5.
            .with_epsilon(guidance.epsilon)
            .build();
        AdamVariable {
            value,
            adam,
            state: None,
        }
    }

    /// A step down a gradient.
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
