//! What can stop a run.

use std::fmt;

use burn::tensor::Tensor;

use crate::observer::{Pass, Step};

/// What can go wrong in a run.
#[derive(Debug, thiserror::Error)]
pub enum GuideError {
    /// A number of DDIM steps that there is no pass for.
    #[error("expected 1 to {largest} DDIM steps, found {found}")]
    #[allow(missing_docs)]
    Steps { found: usize, largest: usize },
    /// A smoothing that makes no sense.
    #[error("expected a smoothing by 0.01 to 100 frames, found {found}")]
    #[allow(missing_docs)]
    TemporalSmoothing { found: f32 },
    /// A guidance option that makes no sense.
    #[error("guidance: {0}")]
    Guidance(String),
    /// A network without stylization layers whose scales and shifts were to be moved.
    #[error(
        "guidance: expected a network whose stylization layers have scales and shifts to move, found one without; move its sentence embedding"
    )]
    NoModulation,
    /// A network that cannot be told Laban features.
    #[error(
        "guidance: expected a network that was trained with Laban features as a condition (laban_condition in its config.json), found one without; guide it by gradients"
    )]
    NoLabanCondition,
    /// A term of the loss whose values or target make no sense.
    #[error("loss term `{term}`: {reason}")]
    #[allow(missing_docs)]
    LossTerm { term: String, reason: String },
    /// The observer stopped the run.
    #[error("stopped by the observer after step {step} of {steps} of the {pass} pass", step = .0.index + 1, steps = .0.steps, pass = .0.pass)]
    Stopped(Box<StoppedPass>),
    /// Numbers left the range of 32-bit floats, or were never in it.
    #[error(
        "the {quantity} of {value} is not finite at step {step} of {steps} of the guided pass (timestep {timestep}); lower the learning rate or ask for a smaller change",
        step = .index + 1
    )]
    NotFinite {
        /// Loss or gradient.
        quantity: Quantity,
        /// The value it belongs to: a Laban component, or a value of another [`LossTerm`](crate::LossTerm).
        value: String,
        /// The step, from 0.
        index: usize,
        /// How many steps the pass has.
        steps: usize,
        /// The step's timestep.
        timestep: usize,
        /// The motion's place in the batch, from 0.
        motion: usize,
    },
}

impl GuideError {
    /// The end of a pass after a step, with the losses of the steps until then.
    pub(crate) fn stopped(step: &Step<'_>, loss: &[Vec<f32>]) -> Self {
        GuideError::Stopped(Box::new(StoppedPass {
            pass: step.pass,
            index: step.index,
            steps: step.steps,
            prediction: step.prediction.clone(),
            loss: loss.to_vec(),
        }))
    }

    /// The motion of the batch that the error is about, if it is about one.
    pub fn motion(&self) -> Option<usize> {
        match self {
            GuideError::NotFinite { motion, .. } => Some(*motion),
            _ => None,
        }
    }
}

/// A number that guidance follows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// The loss.
    Loss,
    /// Its gradient with respect to what guidance moves.
    Gradient,
}

impl fmt::Display for Quantity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Quantity::Loss => "loss",
            Quantity::Gradient => "gradient of the loss",
        })
    }
}

/// What a stopped run has.
#[derive(Clone, Debug)]
pub struct StoppedPass {
    /// The pass that was stopped.
    pub pass: Pass,
    /// The last step that was made, from 0.
    pub index: usize,
    /// How many steps the pass has.
    pub steps: usize,
    /// The clean motion as predicted at that step, normalised, `[batch, frames, features]`.
    pub prediction: Tensor<3>,
    /// The Laban loss of each motion at every step that was made; guided pass only.
    pub loss: Vec<Vec<f32>>,
}
