//! The training config of an evaluator: the file that `lamogen train --evaluator --config` reads.

use std::path::Path;

use lamogen_eval::{EvaluatorConfig, TextForm};
use serde::{Deserialize, Serialize};

use crate::config::{TrainingConfigError, read_file, read_json};
use crate::optimization::OptimizerConfig;

/// The config of an evaluator and of its training.
///
/// ```
/// use lamogen_train::EvaluatorTrainingConfig;
///
/// let config = EvaluatorTrainingConfig::compact();
/// assert_eq!(config.evaluator.dim_coemb_hidden, 512);
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EvaluatorTrainingConfig {
    /// The sizes of the network, which must read tokens.
    pub evaluator: EvaluatorConfig,
    /// The data of each training step, and the loss.
    #[serde(default)]
    pub matching: MatchingConfig,
    /// The optimiser and its learning rate.
    #[serde(default)]
    pub optimization: OptimizerConfig,
}

/// The training data and the loss of an evaluator. A field that a file leaves out has its default.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MatchingConfig {
    /// The number of pairs in each step; fewer if the data set does not have as many with different meanings.
    pub pairs_per_batch: usize,
    /// The margin of the contrastive loss: the distance at which a text and the motion of another text are far enough apart.
    pub margin: f64,
    /// The motions from which a text is pushed away.
    pub others: Negatives,
    /// The share of activations that dropout sets to 0 after each convolution.
    pub dropout: f64,
    /// The largest share of a motion's frames that is cut away at its ends each time the motion is drawn.
    pub crop: f64,
}

/// The motions from which a text is pushed away.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Negatives {
    /// All other motions of the batch ([`lamogen_eval::contrastive_loss_all_shifts`]).
    All,
    /// One other motion, as in the public trainer ([`lamogen_eval::contrastive_loss`]).
    One,
}

impl Default for MatchingConfig {
    fn default() -> Self {
        MatchingConfig {
            pairs_per_batch: 32,
            margin: 10.0,
            others: Negatives::All,
            dropout: 0.2,
            crop: 0.0,
        }
    }
}

impl EvaluatorTrainingConfig {
    /// Returns the recipe for about an hour of motion and two CPU cores. There 1000 steps, with a validation after every 100, are
    /// enough and take minutes.
    pub fn compact() -> Self {
        let file = include_bytes!("../../configs/evaluator-compact.json");
        Self::from_json(file, "evaluator-compact.json").expect("checked by a test")
    }

    /// Reads a config from a file such as [`evaluator-compact.json`](Self::compact).
    ///
    /// # Errors
    ///
    /// If the file cannot be read, is not a config of an evaluator's training, or has a value that makes no sense.
    pub fn from_file(path: impl AsRef<Path>) -> Result<Self, TrainingConfigError> {
        read_file(path.as_ref(), Self::problem)
    }

    /// Reads a config from JSON. Error messages show `name` as its path.
    ///
    /// # Errors
    ///
    /// If the JSON is not a config of an evaluator's training, or has a value that makes no sense.
    pub fn from_json(json: &[u8], name: impl AsRef<Path>) -> Result<Self, TrainingConfigError> {
        read_json(json, name.as_ref(), Self::problem)
    }

    /// Returns why an evaluator cannot be trained with this config; `None` if it can.
    pub fn problem(&self) -> Option<String> {
        let sizes = self.evaluator.problem();
        sizes
            .map(|problem| format!("evaluator: {problem}"))
            .or_else(|| match self.evaluator.text {
                TextForm::Tokens { .. } => None,
                TextForm::Words { .. } => Some("evaluator.text must be tokens, found words".into()),
            })
            .or_else(|| self.matching.problem())
            .or_else(|| self.optimization.problem())
    }
}

impl MatchingConfig {
    /// Describes the first value that makes no sense; `None` if there is none.
    fn problem(&self) -> Option<String> {
        let pairs = self.pairs_per_batch;
        if pairs < 2 {
            return Some(format!(
                "matching.pairs_per_batch must be 2 or above, found {pairs}"
            ));
        }
        let margin = self.margin;
        if !(margin.is_finite() && margin > 0.0) {
            return Some(format!("matching.margin must be above 0, found {margin}"));
        }
        let shares = [("dropout", self.dropout), ("crop", self.crop)];
        let wrong = shares.into_iter().find(|(_, x)| !(0.0..1.0).contains(x));
        wrong.map(|(name, found)| {
            format!("matching.{name} must be from 0 to below 1, found {found}")
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shipped_recipe_makes_sense() {
        let config = EvaluatorTrainingConfig::compact();
        assert_eq!(config.problem(), None);
        let json = serde_json::to_vec(&config).unwrap();
        let again = EvaluatorTrainingConfig::from_json(&json, "again.json").unwrap();
        assert_eq!(again, config);
    }

    #[test]
    fn what_cannot_be_trained_is_named() {
        let refused = |change: &dyn Fn(&mut serde_json::Value)| {
            let mut value = serde_json::to_value(EvaluatorTrainingConfig::compact()).unwrap();
            change(&mut value);
            let json = serde_json::to_vec(&value).unwrap();
            let error = EvaluatorTrainingConfig::from_json(&json, "mine.json").unwrap_err();
            error.to_string()
        };
        for (place, value, named) in [
            ("/matching/pairs_per_batch", 1.0, "matching.pairs_per_batch"),
            (
                "/matching/margin",
                0.0,
                "matching.margin must be above 0, found 0",
            ),
            ("/matching/dropout", 1.0, "matching.dropout"),
            ("/matching/crop", -0.1, "matching.crop"),
            ("/evaluator/text/tokens/vocab_size", 0.0, "text.vocab_size"),
            (
                "/optimization/learning_rate",
                0.0,
                "optimization.learning_rate",
            ),
        ] {
            let message = refused(&|config| {
                let old = config.pointer_mut(place).unwrap();
                *old = match old.is_u64() {
                    true => (value as u64).into(),
                    false => value.into(),
                };
            });
            assert!(message.starts_with("mine.json: "), "{message}");
            assert!(message.contains(named), "{message}");
        }
        let words = refused(&|config| {
            config["evaluator"]["text"] =
                serde_json::json!({"words": {"dim_word": 3, "dim_pos_ohot": 2}});
        });
        assert!(words.contains("must be tokens"), "{words}");
        let unknown = refused(&|config| config["matching"]["shift"] = 1.into());
        assert!(unknown.contains("shift"), "{unknown}");
    }
}
