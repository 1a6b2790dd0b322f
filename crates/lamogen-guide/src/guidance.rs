//! Options of the guided pass.

use lamogen_laban::{Divisor, LabanOptions};

use crate::error::GuideError;
use crate::schedule::TRAINING_STEPS;

/// When a step's update of the embedding takes effect.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Update {
    /// At once: the network is evaluated again with the new embedding (paper, section "Step 2").
    #[default]
    Immediate,
    /// From the next step on: the evaluation that the gradient came from makes the step. Saves a
    /// third of the work.
    Lagged,
}

/// What guidance moves so that the motion reaches its target.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Moved {
    /// The sentence embedding, by Adam at every DDIM step of a second pass: the paper's method.
    #[default]
    Embedding,
    /// The clean motion that the network predicts, down the gradient at every DDIM step of a second pass: the paper's rival
    /// "classifier guidance".
    Prediction,
    /// The finished motion of the first pass, by Adam and without the network: the paper's rival "raw frame update".
    Motion {
        /// How often.
        iterations: usize,
    },
    /// The start noise, by Adam, through all DDIM steps of a pass: as in DNO (Karunratanakul et al. 2024). Each iteration is
    /// a pass with its gradient, so it is one for few DDIM steps. The noise keeps its length.
    Noise {
        /// How often.
        iterations: usize,
    },
}

/// How what is moved, usually the sentence embedding, is moved. The default is [`Guidance::fast`].
#[derive(Clone, Debug, PartialEq)]
pub struct Guidance {
    /// What is moved.
    pub moved: Moved,
    /// Adam's learning rate; for [`Moved::Prediction`] the factor on the gradient.
    pub learning_rate: f64,
    /// Adam's decay of the first and second moment, which carry over from step to step.
    pub betas: [f32; 2],
    /// Adam's epsilon.
    pub epsilon: f32,
    /// Updates of the embedding or prediction at each DDIM step (the paper's K).
    pub updates_per_step: usize,
    /// When those of the embedding take effect.
    pub update: Update,
    /// What the loss divides by.
    pub divisor: Divisor,
    /// Weight in the loss of components that the scale changes at any moment; the others weigh 1. Above 1,
    /// targets are reached more exactly and the other components move more.
    pub emphasis: f32,
    /// How Laban features are measured.
    pub laban: LabanOptions,
}

/// Guidance options together with the number of DDIM steps that they were chosen for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Preset {
    /// The paper's numbers: 1000 steps, learning rate 0.005, loss relative to each frame.
    Paper,
    /// 100 steps, learning rate 0.05, loss relative to the mean over time: a tenth of the work, and
    /// on the embedded model more selective than the paper's numbers.
    #[default]
    Fast,
}

impl Preset {
    /// DDIM steps of each pass.
    pub fn steps(self) -> usize {
        match self {
            Preset::Paper => TRAINING_STEPS,
            Preset::Fast => 100,
        }
    }

    /// The guidance options.
    pub fn guidance(self) -> Guidance {
        match self {
            Preset::Paper => Guidance::paper(),
            Preset::Fast => Guidance::fast(),
        }
    }
}

impl Guidance {
    /// The paper's numbers (appendix, section "Hyperparameters"); meant for 1000 DDIM steps.
    pub fn paper() -> Self {
        Guidance {
            moved: Moved::Embedding,
            learning_rate: 0.005,
            betas: [0.7, 0.9],
            epsilon: 1e-8,
            updates_per_step: 1,
            update: Update::Immediate,
            divisor: Divisor::Frame,
            emphasis: 1.0,
            laban: LabanOptions::default(),
        }
    }

    /// Ten times fewer steps, ten times as long, with all frames weighing alike.
    pub fn fast() -> Self {
        Guidance {
            learning_rate: 0.05,
            divisor: Divisor::Mean,
            ..Guidance::paper()
        }
    }

    /// The paper's rival "classifier guidance" with the paper's numbers: the predicted motion moves by 0.005 of the gradient at each
    /// step.
    pub fn classifier() -> Self {
        Guidance {
            moved: Moved::Prediction,
            ..Guidance::paper()
        }
    }

    /// The paper's rival "raw frame update" with the paper's numbers: 100 updates of the finished motion, learning rate 0.05.
    pub fn raw_frame_update() -> Self {
        Guidance {
            moved: Moved::Motion { iterations: 100 },
            learning_rate: 0.05,
            ..Guidance::paper()
        }
    }

    /// The start noise, 100 times by a learning rate of 0.05 and the loss of [`fast`](Guidance::fast); meant for 10 DDIM steps.
    pub fn start_noise() -> Self {
        Guidance {
            moved: Moved::Noise { iterations: 100 },
            betas: [0.9, 0.999],
            ..Guidance::fast()
        }
    }

    /// How many steps a guided pass has beside a first pass of so many DDIM steps.
    pub fn steps(&self, ddim: usize) -> usize {
        match self.moved {
            Moved::Embedding | Moved::Prediction => ddim,
            Moved::Motion { iterations } | Moved::Noise { iterations } => iterations,
        }
    }

    /// Whether the options make sense.
    ///
    /// # Errors
    ///
    /// If a number is out of range; the message says which.
    pub fn check(&self) -> Result<(), GuideError> {
        let problem = |expected: &str, found: &dyn std::fmt::Debug| {
            Err(GuideError::Guidance(format!(
                "expected {expected}, found {found:?}"
            )))
        };
        if !self.learning_rate.is_finite() || self.learning_rate < 0.0 {
            return problem("a finite learning rate of at least 0", &self.learning_rate);
        }
        if !self.betas.iter().all(|beta| (0.0..1.0).contains(beta)) {
            return problem("betas from 0 to below 1", &self.betas);
        }
        if !self.epsilon.is_finite() || self.epsilon <= 0.0 {
            return problem("a finite epsilon above 0", &self.epsilon);
        }
        if self.updates_per_step == 0 {
            return problem("at least one update a step", &self.updates_per_step);
        }
        if let Moved::Motion { iterations: 0 } | Moved::Noise { iterations: 0 } = self.moved {
            return problem("at least one iteration", &self.moved);
        }
        if !self.emphasis.is_finite() || self.emphasis < 0.0 {
            return problem("a finite emphasis of at least 0", &self.emphasis);
        }
        Ok(())
    }
}

impl Default for Guidance {
    fn default() -> Self {
        Guidance::fast()
    }
}
