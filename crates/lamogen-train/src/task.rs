//! The trait of everything that can be trained.

use std::path::Path;

use burn::module::Module;
use burn::optim::GradientsParams;
use burn::tensor::{Device, Tensor};

use crate::error::TrainError;
use crate::optimization::OptimizerConfig;

/// A training task: a network with its data, its loss and its validation.
///
/// The data of a step must depend on the number of the step alone, so that a run that was stopped can be resumed exactly.
pub trait TrainingTask {
    /// The network that is trained.
    type Network: Module;

    /// Returns the config of the optimiser.
    fn optimization(&self) -> &OptimizerConfig;

    /// Returns the network before the first step.
    fn initial_network(&self, device: &Device) -> Self::Network;

    /// Computes the loss and the gradients of one step. Autodiff tracks the network's weights.
    fn compute_gradients(&self, network: &Self::Network, step: u64) -> StepGradients;

    /// Computes the validation loss of a network on motions that it was not trained on: smaller is better. Returns `None` if there
    /// are no such motions.
    fn validate(&self, network: &Self::Network) -> Option<f64>;

    /// Writes a network to the folder of the finished model, which exists.
    ///
    /// # Errors
    ///
    /// If a file cannot be written.
    fn save(&self, network: &Self::Network, folder: &Path) -> Result<(), TrainError>;
}

/// The loss and the gradients of one training step.
pub struct StepGradients {
    /// The loss that is reported: one number, which autodiff does not track.
    pub loss: Tensor<1>,
    /// The loss whose gradients these are: the reported loss and the weighted other losses.
    pub total_loss: Tensor<1>,
    /// The gradients of all weights.
    pub gradients: GradientsParams,
    /// The number of motions in the batch.
    pub motions: usize,
    /// The number of their frames, without padding.
    pub frames: usize,
}
