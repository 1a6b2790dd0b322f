//! A network in training, one step at a time.

use burn::module::Module;
use burn::tensor::{Device, Tensor};
use serde::{Deserialize, Serialize};

use crate::adam::{self, Moments};
use crate::average;
use crate::error::TrainError;
use crate::gradients;
use crate::task::TrainingTask;

/// A network in training, with the average of its weights and the optimiser's moments: everything that a step changes.
///
/// ```text
/// step ──TrainingTask::compute_gradients──▶ loss, gradients ──clip──▶ AdamW ──▶ weights ──▶ average
/// ```
pub struct Trainer<'a, T: TrainingTask> {
    pub(crate) task: &'a T,
    pub(crate) state: TrainerState<T::Network>,
}

/// The state that a run carries from step to step.
pub(crate) struct TrainerState<M> {
    /// The number of steps that have been made.
    pub(crate) step: u64,
    /// The network, which autodiff tracks.
    pub(crate) network: M,
    /// The moving average of the network's weights, which autodiff does not track.
    pub(crate) average: M,
    pub(crate) moments: Moments<M>,
}

/// The numbers of one training step.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct StepReport {
    /// The number of the step, from 1.
    pub step: u64,
    /// The main loss; for a denoiser, the squared error of its prediction.
    pub loss: f64,
    /// The main loss and the weighted other losses; equal to `loss` if there are no others.
    pub total_loss: f64,
    /// The norm of the gradient before clipping.
    pub gradient_norm: f64,
    /// The learning rate of AdamW.
    pub learning_rate: f64,
    /// The number of motions in the batch.
    pub motions: usize,
    /// The number of their frames, without padding.
    pub frames: usize,
}

impl<'a, T: TrainingTask> Trainer<'a, T> {
    /// Creates a trainer with the task's network before the first step.
    pub fn new(task: &'a T, device: &Device) -> Self {
        let average = task.initial_network(device).valid();
        Trainer {
            state: TrainerState {
                step: 0,
                network: with_autodiff(average.clone()),
                moments: adam::zeros(&average),
                average,
            },
            task,
        }
    }

    /// Returns the number of steps that have been made.
    pub fn step(&self) -> u64 {
        self.state.step
    }

    /// Returns the network with the moving average of the weights, which is the result of the training.
    pub fn average(&self) -> &T::Network {
        &self.state.average
    }

    /// Makes one step. The learning rate depends on `steps`, the number of all steps of the run, if it is known.
    ///
    /// # Errors
    ///
    /// If the loss or the gradient is not finite; the weights are then unchanged.
    pub fn advance(&mut self, steps: Option<u64>) -> Result<StepReport, TrainError> {
        let optimization = self.task.optimization();
        let step = self.state.step;
        let computed = self.task.compute_gradients(&self.state.network, step);
        let max_norm = optimization.gradient_norm;
        let (norm, gradients) = gradients::clip(computed.gradients, &self.state.network, max_norm);
        // The three numbers are read from the device together.
        let numbers = Tensor::cat(vec![computed.loss, computed.total_loss, norm], 0);
        let numbers: Vec<f32> = numbers.try_into_vec_as().expect("floats convert to f32");
        let report = StepReport {
            step: step + 1,
            loss: f64::from(numbers[0]),
            total_loss: f64::from(numbers[1]),
            gradient_norm: f64::from(numbers[2]),
            learning_rate: optimization.learning_rate_at(step, steps),
            motions: computed.motions,
            frames: computed.frames,
        };
        if numbers.iter().any(|number| !number.is_finite()) {
            return Err(TrainError::NotFinite {
                step: report.step,
                loss: report.total_loss,
                gradient_norm: report.gradient_norm,
            });
        }
        let TrainerState {
            network,
            average,
            moments,
            ..
        } = &mut self.state;
        (*network, *moments) = adam::step(
            network.clone(),
            moments.clone(),
            gradients,
            optimization.adam(),
            report.learning_rate,
            step,
        );
        *average = average::update(
            average.clone(),
            network,
            optimization.average_decay_at(step),
        );
        self.state.step += 1;
        Ok(report)
    }
}

/// Returns a network of which autodiff tracks all weights.
pub(crate) fn with_autodiff<M: Module>(network: M) -> M {
    network.train().set_require_grad(true)
}
