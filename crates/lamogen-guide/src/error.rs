//! The errors of a run.

use std::fmt;

use burn::tensor::Tensor;

use crate::observer::{Pass, Step};

/// The reason why a run failed or was stopped.
#[derive(Debug, thiserror::Error)]
pub enum GuideError {
    /// The number of DDIM steps is 0 or larger than the number of training timesteps.
    #[error("expected 1 to {largest} DDIM steps, found {found}")]
    #[allow(missing_docs)]
    Steps { found: usize, largest: usize },
    /// The standard deviation of a temporal smoothing is out of range.
    #[error("expected a smoothing by 0.01 to 100 frames, found {found}")]
    #[allow(missing_docs)]
    TemporalSmoothing { found: f32 },
    /// A guidance option is invalid.
    #[error("guidance: {0}")]
    Guidance(String),
    /// Guidance shall move scales and shifts, but the network has none.
    #[error(
        "guidance: expected a network whose stylization layers have scales and shifts to move, found one without; move its sentence embedding"
    )]
    NoModulation,
    /// Guidance shall move offsets of tokens, but the network has no tokens that carry sentence and timestep.
    #[error(
        "guidance: expected a network with tokens of sentence and timestep to move, such as an MDM, found one without; move its sentence embedding"
    )]
    NoTokens,
    /// Guidance shall move the start noise of a network that makes motions in several passes.
    #[error(
        "guidance: expected a network that makes whole motions for moving their start noise, found one that continues motions a window at a time; move its sentence embedding"
    )]
    NoStartNoise,
    /// The network was not trained with Laban features as a condition.
    #[error(
        "guidance: expected a network that was trained with Laban features as a condition (laban_condition in its config.json), found one without; guide it by gradients"
    )]
    NoLabanCondition,
    /// The values or the target of a loss term are invalid.
    #[error("loss term `{term}`: {reason}")]
    #[allow(missing_docs)]
    LossTerm {
        term: String,
        reason: String,
        /// The index in the batch of the motion that caused it, if a single motion did.
        motion: Option<usize>,
    },
    /// The loss of the motions that were to be guided on the rigid body is not finite.
    #[error("on the rigid body, the loss of {value} is not finite; ask for a smaller change")]
    Rig {
        /// The value it belongs to: a Laban component, or a value of another [`LossTerm`](crate::LossTerm).
        value: String,
        /// The index of the motion in the batch.
        motion: usize,
    },
    /// The observer stopped the run.
    #[error("stopped by the observer after step {step} of {steps} of the {pass} pass", step = .0.index + 1, steps = .0.steps, pass = .0.pass)]
    Stopped(Box<StoppedPass>),
    /// A loss or gradient is infinite or NaN.
    #[error(
        "the {quantity} of {value} is not finite at step {step} of {steps} of the guided pass (timestep {timestep}); lower the learning rate or ask for a smaller change",
        step = .index + 1
    )]
    NotFinite {
        /// The loss or the gradient.
        quantity: Quantity,
        /// The name of the value: a Laban component, or a value of another [`LossTerm`](crate::LossTerm).
        value: String,
        /// The step, counted from 0.
        index: usize,
        /// The number of steps of the pass.
        steps: usize,
        /// The step's timestep.
        timestep: usize,
        /// The motion's index in the batch, counted from 0.
        motion: usize,
    },
}

impl GuideError {
    /// Creates the error of a pass that was stopped after `step`. `loss` holds the losses of the steps until then.
    pub(crate) fn stopped(step: &Step<'_>, loss: &[Vec<f32>]) -> Self {
        GuideError::Stopped(Box::new(StoppedPass {
            pass: step.pass,
            index: step.index,
            steps: step.steps,
            prediction: step.prediction.clone(),
            loss: loss.to_vec(),
        }))
    }

    /// Returns the index in the batch of the motion that caused the error, if a single motion caused it.
    pub fn motion(&self) -> Option<usize> {
        match self {
            GuideError::NotFinite { motion, .. } | GuideError::Rig { motion, .. } => Some(*motion),
            GuideError::LossTerm { motion, .. } => *motion,
            _ => None,
        }
    }
}

/// The quantity that is not finite in [`GuideError::NotFinite`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// The loss.
    Loss,
    /// The gradient of the loss with respect to the variable that guidance moves.
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

/// The state of a pass that the observer stopped.
#[derive(Clone, Debug)]
pub struct StoppedPass {
    /// The pass that was stopped.
    pub pass: Pass,
    /// The last step that was made, counted from 0.
    pub index: usize,
    /// The number of steps of the pass.
    pub steps: usize,
    /// The clean motions that were predicted at that step, normalised, `[batch, frames, features]`.
    pub prediction: Tensor<3>,
    /// The loss of each motion at every step that was made, `[step][motion]`; guided pass only.
    pub loss: Vec<Vec<f32>>,
}
