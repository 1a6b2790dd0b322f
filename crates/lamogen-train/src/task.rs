//! What can be trained.

use std::path::Path;

use burn::module::Module;
use burn::optim::GradientsParams;
use burn::tensor::{Device, Tensor};

use crate::error::TrainError;
use crate::optimization::OptimizerConfig;

/// Something to compute_gradients: which network, from what, and how well it does.
///
/// What a step sees must depend on the step's number alone: a run that goes on where it was stopped relies on it.
pub trait TrainingTask {
    /// What learns.
    type Network: Module;

    /// How its weights move.
    fn optimization(&self) -> &OptimizerConfig;

    /// The network before the first step.
    fn start(&self, device: &Device) -> Self::Network;

    /// One step's loss and gradients. The network is followed by autodiff.
    fn compute_gradients(&self, network: &Self::Network, step: u64) -> StepGradients;

    /// How well a network does on what it has not seen: smaller is better. `None` if there is nothing to measure on.
    fn validate(&self, network: &Self::Network) -> Option<f64>;

    /// Writes a network to the folder of the finished model, which is there.
    ///
    /// # Errors
    ///
    /// If a file cannot be written.
    fn save(&self, network: &Self::Network, folder: &Path) -> Result<(), TrainError>;
}

/// What a step finds.
pub struct StepGradients {
    /// The loss that is reported, one number, not tracked.
    pub loss: Tensor<1>,
    /// The loss that the gradients are of: with other losses, weighted.
    pub total_loss: Tensor<1>,
    /// Of all weights.
    pub gradients: GradientsParams,
    /// How many motions were seen.
    pub motions: usize,
    /// How many frames of them, without padding.
    pub frames: usize,
}
