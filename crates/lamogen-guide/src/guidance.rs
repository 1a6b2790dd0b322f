//! The options of the guided pass, and their presets.

use std::f64::consts::PI;
use std::str::FromStr;

use lamogen_body::FitOptions;
use lamogen_laban::{COMPONENTS, LabanOptions, LossDivisor};

use crate::error::GuideError;
use crate::loss_term::LossTerms;
use crate::places::{PlaceOrigin, Places};
use crate::schedule::TRAINING_STEPS;

/// The body on which motions are measured, guided and returned.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "lowercase"))]
pub enum Body {
    /// A rigid body that the network's motion is fitted to. Its bones keep their lengths, its feet do not slide while
    /// they stand, and files hold exactly its rotations. See [`Rig`](crate::Rig).
    #[default]
    Rig,
    /// The joints of the network's pose features, as in the paper. Bones may stretch.
    Network,
}

/// The time at which a step's update of the embedding or modulation takes effect.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum UpdateTiming {
    /// The update takes effect at the same step: the network is evaluated again with the updated variable (paper,
    /// section "Step 2").
    #[default]
    Immediate,
    /// The update takes effect at the next step: the step uses the evaluation that the gradient came from. This saves a
    /// third of the work.
    Lagged,
}

/// The variable that guidance moves so that the motion reaches its target.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum GuidanceVariable {
    /// The sentence embedding. Adam moves it at every DDIM step of a second pass (the paper's method).
    #[default]
    Embedding,
    /// Offsets that are added to the scales and shifts of the stylization layers, which the layers compute from
    /// embedding and timestep, or, in MDM, to the gains and biases of the norms. Each layer has its own. They start at 0, and Adam moves them at every DDIM step of a
    /// second pass. They relate to the embedding as the style space of image generators relates to their latent code
    /// (Wu et al. 2021, "StyleSpace Analysis"): they have as many dimensions as the layers have channels, so that one
    /// property of the motion can be moved and the others kept.
    Modulation,
    /// Offsets that are added to the tokens that carry sentence and timestep, at the input of each layer. Each layer has
    /// its own. They start at 0, and Adam moves them at every step of a second pass. This is for networks that have such
    /// tokens, as MDM has ([`Denoiser::token_offset_width`](lamogen_model::Denoiser::token_offset_width)).
    Tokens,
    /// The clean motion that the network predicts. It is moved down the gradient at every DDIM step of a second pass
    /// (the paper's comparison method "classifier guidance").
    Prediction,
    /// The finished motion of the first pass. Adam moves it without the network (the paper's comparison method "raw
    /// frame update").
    Motion {
        /// The number of updates.
        iterations: usize,
    },
    /// No variable. The second pass runs without a gradient, with the condition of [`Guidance::laban_condition`] if
    /// that is on.
    None,
    /// The start noise. Adam moves it through all DDIM steps of a pass, as in DNO (Karunratanakul et al. 2024). Each
    /// iteration is a whole pass with its gradient, so this variable is practical for few DDIM steps. The Euclidean
    /// length of the noise is kept.
    Noise {
        /// The number of updates.
        iterations: usize,
    },
}

/// Updates of the finished motion that remove the remaining distance to its target.
///
/// Adam moves the motion without the network, as with [`GuidanceVariable::Motion`], but after another variable has
/// brought the motion near its target. Little distance remains then, so the motion changes little. Adam's betas are 0.9
/// and 0.999.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Finish {
    /// The number of updates.
    pub iterations: usize,
    /// Adam's learning rate at the first update. It falls to 0 along half a cosine, so that the motion converges.
    pub learning_rate: f64,
    /// Adam's epsilon. Where it is far larger than the gradients, numbers move in proportion to their gradients, and a
    /// smooth motion stays smooth.
    pub epsilon: f32,
}

impl Default for Finish {
    /// Returns the finish of [`Guidance::precise`].
    fn default() -> Self {
        Finish {
            iterations: 100,
            learning_rate: 0.03,
            epsilon: 0.1,
        }
    }
}

impl Finish {
    /// Returns guidance that makes these updates alone: they move the motion of the first pass. Divisor, emphasis, loss
    /// terms and the options of the Laban features are those of `options`.
    pub fn alone(self, options: &Guidance) -> Guidance {
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
            ..options.clone()
        }
    }
}

/// The options of guidance: the variable that is moved, the optimiser that moves it, and the loss. The default is
/// [`Guidance::fast`].
#[derive(Clone, Debug, PartialEq)]
pub struct Guidance {
    /// The variable that is moved.
    pub variable: GuidanceVariable,
    /// Adam's learning rate; for [`GuidanceVariable::Prediction`] the factor on the gradient.
    pub learning_rate: f64,
    /// The learning rate at the last step, which is approached along half a cosine; `None` for a constant learning
    /// rate. With a rising learning rate, guidance changes the first steps less, which decide what the motion is, so
    /// that they follow the sentence; and it changes the last steps more, which decide how the motion is done, so that
    /// they reach the target more exactly.
    pub final_learning_rate: Option<f64>,
    /// The exponential decay rates of Adam's first and second moments. The moments carry over from step to step.
    pub betas: [f32; 2],
    /// Adam's epsilon. Numbers with gradients far below it hardly move. A tiny epsilon moves all numbers equally far,
    /// even those that hardly affect the loss.
    pub epsilon: f32,
    /// The number of updates of the embedding, modulation or prediction at each DDIM step (the paper's K).
    pub updates_per_step: usize,
    /// The time at which updates of the embedding or modulation take effect.
    pub update: UpdateTiming,
    /// The divisor of differences in the loss.
    pub divisor: LossDivisor,
    /// The weight in the loss of components that shall change at any time, in the order of
    /// [`Component::ALL`](lamogen_laban::Component::ALL). Components that shall not change have the weight 1. With a
    /// weight above 1, targets are reached more exactly and the other components move more.
    pub emphasis: [f32; COMPONENTS],
    /// Whether the network receives the Laban features to reach as the condition that it was trained with. The
    /// condition is the mean over time of the whole body's target. This works for networks with a `laban_condition` in
    /// their config.
    pub laban_condition: bool,
    /// The body on which motions are measured and returned: a rigid body by default, the network's in the paper.
    pub body: Body,
    /// The options of the fit that turns the network's motion into that of a rigid body and, where there are goals,
    /// moves it to its target; with [`Body::Rig`] only.
    pub fit: FitOptions,
    /// The updates of the network's finished motion after the last step; none in the paper. They are made with
    /// [`Body::Network`] only, because on a rigid body the fit moves the motion to its target.
    pub finish: Option<Finish>,
    /// The options of the measurement of Laban features.
    pub laban: LabanOptions,
    /// Further terms of the loss, which all motions of the run share: goals of your own.
    pub loss_terms: LossTerms,
    /// Places at which all bodies of the run shall be; motions of a run with places have the same length. Default: none.
    pub places: Places,
    /// Where the places are counted from, if some frames of the motions are known before they are made. Default: the start.
    pub place_origin: Option<PlaceOrigin>,
    /// The directions in which the own +Z of the baselines and of the guided motions points in the rooms where they will be put, in
    /// radians to the left. The box of Shape has the axes of the room. Default: 0.
    pub headings: [f32; 2],
}

/// Guidance options together with the number of DDIM steps that they were chosen for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "lowercase"))]
pub enum Preset {
    /// The paper's numbers: 1000 steps, learning rate 0.005, loss relative to each frame.
    Paper,
    /// 100 steps, learning rate 0.05, loss relative to the mean over time. This is a tenth of the work, and
    /// on the embedded model it moves the other components less than the paper's numbers.
    #[default]
    Fast,
    /// 12 steps (25 where a motion has to meet others), an update of the modulation at each, and a finish. Motions come
    /// nearest to what the tags ask for, and the other components move least. This preset is for networks with stylization layers, such as MotionDiffuse, and
    /// was chosen on the embedded model, which runs with it. MDM has norms to move instead.
    Precise,
}

impl Preset {
    /// All presets.
    pub const ALL: [Preset; 3] = [Preset::Precise, Preset::Fast, Preset::Paper];

    /// Returns the preset's name, such as `precise`.
    pub const fn name(self) -> &'static str {
        match self {
            Preset::Paper => "paper",
            Preset::Fast => "fast",
            Preset::Precise => "precise",
        }
    }

    /// Returns the number of DDIM steps of each pass.
    pub fn steps(self) -> usize {
        match self {
            Preset::Paper => TRAINING_STEPS,
            Preset::Fast => 100,
            Preset::Precise => 12,
        }
    }

    /// Returns the number of DDIM steps of each pass of a motion that has to arrive somewhere: at its own beginning in a
    /// loop, in another motion, or at places. The network needs more steps to make the frames between fit.
    pub fn meeting_steps(self) -> usize {
        match self {
            Preset::Paper | Preset::Fast => self.steps(),
            Preset::Precise => 25,
        }
    }

    /// Returns the guidance options.
    pub fn guidance(self) -> Guidance {
        match self {
            Preset::Paper => Guidance::paper(),
            Preset::Fast => Guidance::fast(),
            Preset::Precise => Guidance::precise(),
        }
    }
}

/// The error of a word that is not the name of a preset.
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

/// The largest number of updates of one kind. The limit keeps sums of them from overflowing, and no run needs as many.
const MAX_UPDATES: usize = 1_000_000;

impl Guidance {
    /// Returns the paper's numbers (appendix, section "Hyperparameters"), which are meant for 1000 DDIM steps.
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
            places: Places::default(),
            place_origin: None,
            headings: [0.0; 2],
        }
    }

    /// Returns options for ten times fewer steps, with a ten times larger learning rate and the same weight for all
    /// frames. They are meant for 100 DDIM steps.
    pub fn fast() -> Self {
        Guidance {
            learning_rate: 0.05,
            divisor: LossDivisor::Mean,
            body: Body::Rig,
            ..Guidance::paper()
        }
    }

    /// Returns options that move the scales and shifts of each stylization layer instead of the embedding that they are
    /// computed from, with a small learning rate and a larger emphasis on Weight, Time and Flow where these shall change. A finish
    /// then removes the remaining distance. They are meant for 12 DDIM steps or more.
    pub fn precise() -> Self {
        Guidance {
            variable: GuidanceVariable::Modulation,
            learning_rate: 0.0025,
            final_learning_rate: Some(0.01),
            epsilon: 0.04,
            emphasis: [1.7, 3.0, 3.0, 1.0],
            finish: Some(Finish::default()),
            ..Guidance::fast()
        }
    }

    /// Returns the options of the paper's comparison method "classifier guidance" with the paper's numbers: the
    /// predicted motion moves by
    /// 0.005 times the gradient at each step.
    pub fn classifier() -> Self {
        Guidance {
            variable: GuidanceVariable::Prediction,
            ..Guidance::paper()
        }
    }

    /// Returns the options of the paper's comparison method "raw frame update" with the paper's numbers: 100 updates of
    /// the finished motion with a learning rate of 0.05.
    pub fn raw_frame_update() -> Self {
        Guidance {
            variable: GuidanceVariable::Motion { iterations: 100 },
            learning_rate: 0.05,
            ..Guidance::paper()
        }
    }

    /// Returns options that move the start noise in 100 updates with a learning rate of 0.05 and the loss of
    /// [`fast`](Guidance::fast). They are meant for 10 DDIM steps.
    pub fn start_noise() -> Self {
        Guidance {
            variable: GuidanceVariable::Noise { iterations: 100 },
            betas: [0.9, 0.999],
            body: Body::Network,
            ..Guidance::fast()
        }
    }

    /// Returns the number of steps of a guided pass of the network, for a first pass of `ddim` steps over all windows.
    pub fn steps(&self, ddim: usize) -> usize {
        let steps = match self.variable {
            GuidanceVariable::Embedding
            | GuidanceVariable::Modulation
            | GuidanceVariable::Tokens
            | GuidanceVariable::Prediction
            | GuidanceVariable::None => ddim,
            GuidanceVariable::Motion { iterations } | GuidanceVariable::Noise { iterations } => {
                iterations
            }
        };
        steps + self.network_finish().map_or(0, |finish| finish.iterations)
    }

    /// Returns the finish of the network's motion, if one is made: with [`Body::Network`] only.
    pub(crate) fn network_finish(&self) -> Option<Finish> {
        self.finish.filter(|_| self.body == Body::Network)
    }

    /// Returns the learning rate at a step of `steps`, counted from 0.
    pub(crate) fn learning_rate_at(&self, step: usize, steps: usize) -> f64 {
        let first = self.learning_rate;
        let last = self.final_learning_rate.unwrap_or(first);
        let progress = step as f64 / steps.saturating_sub(1).max(1) as f64;
        first + (last - first) * 0.5 * (1.0 - (PI * progress).cos())
    }

    /// Checks that the options are valid.
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
        let is_valid = |rate: &f64| rate.is_finite() && *rate >= 0.0;
        if let Some(rate) = rates.iter().flatten().find(|rate| !is_valid(rate)) {
            return problem("a finite learning rate of at least 0", rate);
        }
        if !self.betas.iter().all(|beta| (0.0..1.0).contains(beta)) {
            return problem("betas from 0 to below 1", &self.betas);
        }
        if !self.epsilon.is_finite() || self.epsilon <= 0.0 {
            return problem("a finite epsilon above 0", &self.epsilon);
        }
        if !(1..=MAX_UPDATES).contains(&self.updates_per_step) {
            let expected = format!("1 to {MAX_UPDATES} updates a step");
            return problem(&expected, &self.updates_per_step);
        }
        if let GuidanceVariable::Motion { iterations } | GuidanceVariable::Noise { iterations } =
            self.variable
            && !(1..=MAX_UPDATES).contains(&iterations)
        {
            let expected = format!("1 to {MAX_UPDATES} iterations");
            return problem(&expected, &self.variable);
        }
        let is_valid = |emphasis: &f32| emphasis.is_finite() && *emphasis >= 0.0;
        if !self.emphasis.iter().all(is_valid) {
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
    fn presets_are_parsed_from_their_names() {
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
    fn the_learning_rate_is_constant_or_approaches_its_last_value() {
        let fast = Guidance::fast();
        assert!((0..100).all(|step| fast.learning_rate_at(step, 100) == 0.05));
        let rising = Guidance {
            learning_rate: 0.01,
            final_learning_rate: Some(0.05),
            ..fast
        };
        let rates: Vec<f64> = (0..5)
            .map(|step| rising.learning_rate_at(step, 5))
            .collect();
        assert_eq!((rates[0], rising.learning_rate_at(0, 1)), (0.01, 0.01));
        assert!((rates[2] - 0.03).abs() < 1e-12 && (rates[4] - 0.05).abs() < 1e-12);
        assert!(rates.is_sorted());
    }
}
