//! Options of the guided pass.

use std::f64::consts::PI;
use std::str::FromStr;

use lamogen_body::FitOptions;
use lamogen_laban::{COMPONENTS, LabanOptions, LossDivisor};

use crate::error::GuideError;
use crate::loss_term::LossTerms;
use crate::schedule::TRAINING_STEPS;

/// Whose motion is measured, guided to its target and given.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Body {
    /// That of a rigid body, which the network's motion is fitted to: its bones keep their length, its feet stand where they stand, and
    /// files hold exactly its rotations. See [`Rig`](crate::Rig).
    #[default]
    Rig,
    /// That of the network, as in the paper: joints of the pose features, whose bones may stretch.
    Network,
}

/// When a step's update of the embedding or modulation takes effect.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum UpdateTiming {
    /// At once: the network is evaluated again with what was updated (paper, section "Step 2").
    #[default]
    Immediate,
    /// From the next step on: the evaluation that the gradient came from makes the step. Saves a
    /// third of the work.
    Lagged,
}

/// What guidance moves so that the motion reaches its target.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum GuidanceVariable {
    /// The sentence embedding, by Adam at every DDIM step of a second pass: the paper's method.
    #[default]
    Embedding,
    /// What is added to the scales and shifts that embedding and timestep become, in each stylization layer its own, by Adam
    /// at every DDIM step of a second pass; it begins with nothing. As the style space of image generators is to their latent code
    /// (Wu et al. 2021, "StyleSpace Analysis"): as many dimensions as the layers have channels, so that one property can be moved
    /// and the others kept.
    Modulation,
    /// The clean motion that the network predicts, down the gradient at every DDIM step of a second pass: the paper's rival
    /// "classifier guidance".
    Prediction,
    /// The finished motion of the first pass, by Adam and without the network: the paper's rival "raw frame update".
    Motion {
        /// How often.
        iterations: usize,
    },
    /// Nothing: the second pass runs as it is told ([`Guidance::laban_condition`]), without a gradient.
    Nothing,
    /// The start noise, by Adam, through all DDIM steps of a pass: as in DNO (Karunratanakul et al. 2024). Each iteration is
    /// a pass with its gradient, so it is one for few DDIM steps. The noise keeps its length.
    Noise {
        /// How often.
        iterations: usize,
    },
}

/// How the finished motion is moved by what is left to its target: by Adam and without the network, as
/// [`GuidanceVariable::Motion`] does it, but after something else has come near. Little is left then, and little is done to the motion.
/// Adam's betas are 0.9 and 0.999.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Finish {
    /// How often.
    pub iterations: usize,
    /// Adam's learning rate at first; it goes to 0 on half a cosine, so that the motion comes to rest.
    pub learning_rate: f64,
    /// Adam's epsilon. Where it is far above the gradients, numbers move in proportion to them, and what is smooth stays
    /// smooth.
    pub epsilon: f32,
}

impl Default for Finish {
    /// As in [`Guidance::precise`].
    fn default() -> Self {
        Finish {
            iterations: 100,
            learning_rate: 0.03,
            epsilon: 0.1,
        }
    }
}

impl Finish {
    /// The same updates with nothing before them: they move the motion of the first pass. LossDivisor, emphasis and what
    /// is measured are those of `others`.
    pub fn alone(self, others: &Guidance) -> Guidance {
        Guidance {
            variable: GuidanceVariable::Motion {
                iterations: self.iterations,
            },
            learning_rate: self.learning_rate,
            final_learning_rate: Some(0.0),
            betas: [0.9, 0.999],
            epsilon: self.epsilon,
            body: Body::Network,
            finish: None,
            ..others.clone()
        }
    }
}

/// How what is moved, usually the sentence embedding, is moved. The default is [`Guidance::fast`].
#[derive(Clone, Debug, PartialEq)]
pub struct Guidance {
    /// What is moved.
    pub variable: GuidanceVariable,
    /// Adam's learning rate; for [`GuidanceVariable::Prediction`] the factor on the gradient.
    pub learning_rate: f64,
    /// What it becomes at the last step, on half a cosine; none where it stays. Where it rises, the first steps, which decide what
    /// the motion is, are left more to the sentence, and the last ones, which decide how it is done, follow more exactly.
    pub final_learning_rate: Option<f64>,
    /// Adam's decay of the first and second moment, which carry over from step to step.
    pub betas: [f32; 2],
    /// Adam's epsilon. What has gradients far below it hardly moves; a tiny one moves all numbers alike, those too that
    /// play no part.
    pub epsilon: f32,
    /// Updates of the embedding, modulation or prediction at each DDIM step (the paper's K).
    pub updates_per_step: usize,
    /// When those of the embedding or modulation take effect.
    pub update: UpdateTiming,
    /// What the loss divides by.
    pub divisor: LossDivisor,
    /// Weight in the loss of components that shall change at any moment, in the order of
    /// [`Component::ALL`](lamogen_laban::Component::ALL); those that shall not weigh 1. Above 1, targets are reached more exactly and the
    /// other components move more.
    pub emphasis: [f32; COMPONENTS],
    /// Whether the network is told the Laban features to reach, as the condition that it was trained with: the means over time of the target of
    /// the whole body. For networks whose config has a `laban_condition`.
    pub laban_condition: bool,
    /// Whose motion is measured and given: that of a rigid body by default, the network's in the paper.
    pub body: Body,
    /// How the network's motion becomes that of a rigid body and, where there are goals, reaches them on it; with [`Body::Rig`] only.
    pub fit: FitOptions,
    /// What is done to the network's finished motion after the last step; nothing in the paper. With [`Body::Network`] only: on a rigid
    /// body the fit does it.
    pub finish: Option<Finish>,
    /// How Laban features are measured.
    pub laban: LabanOptions,
    /// Further terms of the loss, which all motions of the run share: goals of your own.
    pub loss_terms: LossTerms,
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
    /// 50 steps, an update of the modulation at each, and a finish: nearest to what the tags ask for, with the least else
    /// moved. For networks with stylization layers, as MotionDiffuse; what the embedded model runs with.
    Precise,
}

impl Preset {
    /// All of them.
    pub const ALL: [Preset; 3] = [Preset::Precise, Preset::Fast, Preset::Paper];

    /// Its name, such as `precise`.
    pub const fn name(self) -> &'static str {
        match self {
            Preset::Paper => "paper",
            Preset::Fast => "fast",
            Preset::Precise => "precise",
        }
    }

    /// DDIM steps of each pass.
    pub fn steps(self) -> usize {
        match self {
            Preset::Paper => TRAINING_STEPS,
            Preset::Fast => 100,
            Preset::Precise => 50,
        }
    }

    /// The guidance options.
    pub fn guidance(self) -> Guidance {
        match self {
            Preset::Paper => Guidance::paper(),
            Preset::Fast => Guidance::fast(),
            Preset::Precise => Guidance::precise(),
        }
    }
}

/// A word that is the name of no preset.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected a preset (precise, fast, paper), found `{0}`")]
pub struct PresetError(pub String);

impl FromStr for Preset {
    type Err = PresetError;

    fn from_str(name: &str) -> Result<Self, PresetError> {
        { Preset::ALL.into_iter() }
            .find(|preset| preset.name() == name)
            .ok_or_else(|| PresetError(name.into()))
    }
}

/// Updates of one kind, beyond what anybody waits for; keeps sums of them from overflowing.
const MOST_UPDATES: usize = 1_000_000;

impl Guidance {
    /// The paper's numbers (appendix, section "Hyperparameters"); meant for 1000 DDIM steps.
    pub fn paper() -> Self {
        Guidance {
            variable: GuidanceVariable::Embedding,
            learning_rate: 0.005,
            final_learning_rate: None,
            betas: [0.7, 0.9],
            epsilon: 1e-8,
            updates_per_step: 1,
            update: UpdateTiming::Immediate,
            divisor: LossDivisor::Frame,
            emphasis: [1.0; COMPONENTS],
            laban_condition: false,
            body: Body::Network,
            fit: FitOptions::default(),
            finish: None,
            laban: LabanOptions::default(),
            loss_terms: LossTerms::default(),
        }
    }

    /// Ten times fewer steps, ten times as long, with all frames weighing alike.
    pub fn fast() -> Self {
        Guidance {
            learning_rate: 0.05,
            divisor: LossDivisor::Mean,
            body: Body::Rig,
            ..Guidance::paper()
        }
    }

    /// Every stylization layer's own scales and shifts instead of the embedding that they all come from, gently, with more weight on Time
    /// and Flow where they are asked for; and then the finished motion by what is left. Meant for 50 DDIM steps.
    pub fn precise() -> Self {
        Guidance {
            variable: GuidanceVariable::Modulation,
            learning_rate: 0.005,
            final_learning_rate: Some(0.02),
            epsilon: 0.04,
            emphasis: [1.0, 3.0, 3.0, 1.0],
            finish: Some(Finish::default()),
            ..Guidance::fast()
        }
    }

    /// The paper's rival "classifier guidance" with the paper's numbers: the predicted motion moves by 0.005 of the gradient at each
    /// step.
    pub fn classifier() -> Self {
        Guidance {
            variable: GuidanceVariable::Prediction,
            ..Guidance::paper()
        }
    }

    /// The paper's rival "raw frame update" with the paper's numbers: 100 updates of the finished motion, learning rate 0.05.
    pub fn raw_frame_update() -> Self {
        Guidance {
            variable: GuidanceVariable::Motion { iterations: 100 },
            learning_rate: 0.05,
            ..Guidance::paper()
        }
    }

    /// The start noise, 100 times by a learning rate of 0.05 and the loss of [`fast`](Guidance::fast); meant for 10 DDIM steps.
    pub fn start_noise() -> Self {
        Guidance {
            variable: GuidanceVariable::Noise { iterations: 100 },
            betas: [0.9, 0.999],
            body: Body::Network,
            ..Guidance::fast()
        }
    }

    /// How many steps a guided pass of the network has beside a first pass of so many DDIM steps.
    pub fn steps(&self, ddim: usize) -> usize {
        let moves = match self.variable {
            GuidanceVariable::Embedding
            | GuidanceVariable::Modulation
            | GuidanceVariable::Prediction
            | GuidanceVariable::Nothing => ddim,
            GuidanceVariable::Motion { iterations } | GuidanceVariable::Noise { iterations } => {
                iterations
            }
        };
        moves + self.network_finish().map_or(0, |finish| finish.iterations)
    }

    /// What is done to the network's finished motion.
    pub(crate) fn network_finish(&self) -> Option<Finish> {
        self.finish.filter(|_| self.body == Body::Network)
    }

    /// The learning rate at a step, from 0, of so many.
    pub(crate) fn rate(&self, step: usize, steps: usize) -> f64 {
        let first = self.learning_rate;
        let last = self.final_learning_rate.unwrap_or(first);
        let way = step as f64 / steps.saturating_sub(1).max(1) as f64;
        first + (last - first) * 0.5 * (1.0 - (PI * way).cos())
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
        let rates = [Some(self.learning_rate), self.final_learning_rate];
        let makes_sense = |rate: &f64| rate.is_finite() && *rate >= 0.0;
        if let Some(rate) = rates.iter().flatten().find(|rate| !makes_sense(rate)) {
            return problem("a finite learning rate of at least 0", rate);
        }
        if !self.betas.iter().all(|beta| (0.0..1.0).contains(beta)) {
            return problem("betas from 0 to below 1", &self.betas);
        }
        if !self.epsilon.is_finite() || self.epsilon <= 0.0 {
            return problem("a finite epsilon above 0", &self.epsilon);
        }
        if !(1..=MOST_UPDATES).contains(&self.updates_per_step) {
            let expected = format!("1 to {MOST_UPDATES} updates a step");
            return problem(&expected, &self.updates_per_step);
        }
        if let GuidanceVariable::Motion { iterations } | GuidanceVariable::Noise { iterations } =
            self.variable
            && !(1..=MOST_UPDATES).contains(&iterations)
        {
            let expected = format!("1 to {MOST_UPDATES} iterations");
            return problem(&expected, &self.variable);
        }
        let makes_sense = |emphasis: &f32| emphasis.is_finite() && *emphasis >= 0.0;
        if !self.emphasis.iter().all(makes_sense) {
            return problem("a finite emphasis of at least 0", &self.emphasis);
        }
        if let Err(problem) = self.fit.check() {
            return Err(GuideError::Guidance(problem.to_string()));
        }
        if let Some(finish) = self.finish {
            let checked = finish.alone(self).check();
            checked.map_err(|problem| match problem {
                GuideError::Guidance(text) => GuideError::Guidance(format!("finish: {text}")),
                other => other,
            })?;
        }
        Ok(())
    }
}

impl Default for Guidance {
    fn default() -> Self {
        Guidance::fast()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn presets_go_by_their_names() {
        for preset in Preset::ALL {
            assert_eq!(preset.name().parse(), Ok(preset));
        }
        let error = "Precise".parse::<Preset>().unwrap_err().to_string();
        assert!(
            error.contains("`Precise`")
                && Preset::ALL
                    .iter()
                    .all(|preset| error.contains(preset.name()))
        );
    }

    #[test]
    fn the_learning_rate_stays_or_goes_to_its_last_value() {
        let fast = Guidance::fast();
        assert!((0..100).all(|step| fast.rate(step, 100) == 0.05));
        let rising = Guidance {
            learning_rate: 0.01,
            final_learning_rate: Some(0.05),
            ..fast
        };
        let rates: Vec<f64> = (0..5).map(|step| rising.rate(step, 5)).collect();
        assert_eq!((rates[0], rising.rate(0, 1)), (0.01, 0.01));
        assert!((rates[2] - 0.03).abs() < 1e-12 && (rates[4] - 0.05).abs() < 1e-12);
        assert!(rates.is_sorted());
    }
}
