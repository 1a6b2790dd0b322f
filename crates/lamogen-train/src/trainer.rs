//! A network in training, step by step.

use burn::module::Module;
use burn::tensor::{Device, Tensor};
use serde::{Deserialize, Serialize};

use crate::adam::{self, Moments};
use crate::average;
use crate::error::TrainError;
use crate::gradients;
use crate::task::TrainingTask;

/// A network, the average of its weights, and the optimiser's moments: all that a step changes.
///
/// ```text
/// step ──TrainingTask::compute_gradients──▶ loss, gradients ──cut──▶ AdamW ──▶ weights ──▶ average
/// ```
pub struct Trainer<'a, T: TrainingTask> {
    pub(crate) task: &'a T,
    pub(crate) state: State<T::Network>,
}

/// What a run carries from step to step.
pub(crate) struct State<M> {
    /// How many steps have been made.
    pub(crate) step: u64,
    /// Followed by autodiff.
    pub(crate) network: M,
    /// The moving average of its weights; not followed.
    pub(crate) average: M,
    pub(crate) moments: Moments<M>,
}

/// What a step was like.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct StepReport {
    /// Which one, from 1.
    pub step: u64,
    /// What the network is trained to make small; of a denoiser the squared error of what it predicts.
    pub loss: f64,
    /// With the other losses, weighted; the same where there are none.
    pub total_loss: f64,
    /// RunLength of the gradient before it was cut.
    pub gradient_norm: f64,
    /// Of AdamW.
    pub learning_rate: f64,
    /// Motions seen.
    pub motions: usize,
    /// Frames seen, without padding.
    pub frames: usize,
}

impl<'a, T: TrainingTask> Trainer<'a, T> {
    /// A fresh network.
    pub fn new(task: &'a T, device: &Device) -> Self {
        let average = task.start(device).valid();
        Trainer {
            state: State {
                step: 0,
                network: tracked(average.clone()),
                moments: adam::zeros(&average),
                average,
            },
            task,
        }
    }

    /// How many steps have been made.
    pub fn step(&self) -> u64 {
        self.state.step
    }

    /// The moving average of the weights: the network that is kept.
    pub fn average(&self) -> &T::Network {
        &self.state.average
    }

    /// Makes a step of a run; of how many, the learning rate wants to know.
    ///
    /// # Errors
    ///
    /// If loss or gradient are not finite; the weights are as they were before.
    pub fn advance(&mut self, steps: Option<u64>) -> Result<StepReport, TrainError> {
        let optimization = self.task.optimization();
        let step = self.state.step;
        let found = self.task.compute_gradients(&self.state.network, step);
        let longest = optimization.gradient_norm;
        let (norm, gradients) = gradients::cut(found.gradients, &self.state.network, longest);
        let read = Tensor::cat(vec![found.loss, found.total_loss, norm], 0);
        let read: Vec<f32> = read.try_into_vec_as().expect("floats convert to f32");
        let report = StepReport {
            step: step + 1,
            loss: f64::from(read[0]),
            total_loss: f64::from(read[1]),
            gradient_norm: f64::from(read[2]),
            learning_rate: optimization.learning_rate(step, steps),
            motions: found.motions,
            frames: found.frames,
        };
        if read.iter().any(|number| !number.is_finite()) {
            return Err(TrainError::NotFinite {
                step: report.step,
                loss: report.total_loss,
                gradient_norm: report.gradient_norm,
            });
        }
        let State {
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
        *average = average::follow(average.clone(), network, optimization.decay(step));
        self.state.step += 1;
        Ok(report)
    }
}

/// The network with all its weights followed by autodiff.
pub(crate) fn tracked<M: Module>(network: M) -> M {
    network.train().set_require_grad(true)
}
