//! What is trained, and how: the file that `lamogen train --config` reads.

use std::path::{Path, PathBuf};

use lamogen_model::ModelConfig;
use serde::{Deserialize, Serialize};

use crate::losses::Losses;

/// A network and the recipe to train it by.
///
/// ```
/// use lamogen_train::TrainingConfig;
///
/// let config = TrainingConfig::compact();
/// assert_eq!(config.model.latent_dim, 128);
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainingConfig {
    /// Sizes of the network, and what it predicts.
    pub model: ModelConfig,
    /// How it is trained.
    #[serde(default)]
    pub training: Recipe,
}

/// How a network is trained. What a file leaves out has the default.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Recipe {
    /// Of the weights at the start, and of all that is drawn.
    pub seed: u64,
    /// Frames of a batch with padding: as many motions are drawn as fit.
    pub frames_per_batch: usize,
    /// Motions are sorted by length and dealt into so many buckets; a batch comes from one of them, so that little of it is
    /// padding.
    pub length_buckets: usize,
    /// The share of a motion's frames that may be cut away, at its ends, at each visit; never below the model's shortest motion.
    pub crop: f64,
    /// Of AdamW, after the warm-up.
    pub learning_rate: f64,
    /// Steps over which the learning rate rises from 0.
    pub warm_up_steps: u64,
    /// The share of the learning rate that is left at the end of the cosine.
    pub last_learning_rate: f64,
    /// Of AdamW.
    pub betas: [f32; 2],
    /// Of AdamW; on matrices, not on biases, scales and embeddings.
    pub weight_decay: f32,
    /// Longer gradients, over all weights together, are cut to this length.
    pub gradient_norm: f64,
    /// How slowly the exponential moving average of the weights moves; at the start it moves faster.
    pub average_decay: f64,
    /// The share of captions that are replaced by an empty one, so that the network also learns motion without words.
    pub losses: Losses,
}

impl Default for Recipe {
    fn default() -> Self {
        Recipe {
            seed: 0,
            frames_per_batch: 6400,
            length_buckets: 8,
            crop: 0.0,
            learning_rate: 6e-4,
            warm_up_steps: 200,
            last_learning_rate: 0.01,
            betas: [0.9, 0.999],
            weight_decay: 0.01,
            gradient_norm: 1.0,
            average_decay: 0.999,
            losses: Losses::default(),
        }
    }
}

/// What is wrong with a training config.
#[derive(Debug, thiserror::Error)]
pub enum TrainingConfigError {
    /// The file cannot be read.
    #[error("{path}: {reason}")]
    #[allow(missing_docs)]
    Io {
        path: PathBuf,
        reason: std::io::Error,
    },
    /// The file is not a config in JSON.
    #[error("{path}: not a training config: {reason}")]
    #[allow(missing_docs)]
    Json {
        path: PathBuf,
        reason: serde_json::Error,
    },
    /// A value that makes no sense.
    #[error("{path}: {problem}")]
    #[allow(missing_docs)]
    Value { path: PathBuf, problem: String },
}

impl TrainingConfig {
    /// The recipe of the embedded model.
    pub fn compact() -> Self {
        let file = include_bytes!("../configs/compact.json");
        Self::from_json(file, "compact.json").expect("checked by a test")
    }

    /// Reads a file such as [`compact.json`](Self::compact).
    ///
    /// # Errors
    ///
    /// If it cannot be read, is no training config, or a value makes no sense.
    pub fn from_file(path: impl AsRef<Path>) -> Result<Self, TrainingConfigError> {
        let path = path.as_ref();
        let bytes = std::fs::read(path).map_err(|reason| TrainingConfigError::Io {
            path: path.to_owned(),
            reason,
        })?;
        Self::from_json(&bytes, path)
    }

    /// Reads a config from JSON; `name` stands in error messages.
    ///
    /// # Errors
    ///
    /// If it is no training config or a value makes no sense.
    pub fn from_json(json: &[u8], name: impl AsRef<Path>) -> Result<Self, TrainingConfigError> {
        let path = || name.as_ref().to_owned();
        let config: TrainingConfig =
            serde_json::from_slice(json).map_err(|reason| TrainingConfigError::Json {
                path: path(),
                reason,
            })?;
        match config.problem() {
            None => Ok(config),
            Some(problem) => Err(TrainingConfigError::Value {
                path: path(),
                problem,
            }),
        }
    }

    /// Why this cannot be trained, if it cannot.
    pub fn problem(&self) -> Option<String> {
        let recipe = &self.training;
        let above_zero = [
            ("frames_per_batch", recipe.frames_per_batch as f64),
            ("length_buckets", recipe.length_buckets as f64),
            ("learning_rate", recipe.learning_rate),
            ("gradient_norm", recipe.gradient_norm),
        ];
        let shares = [
            ("crop", recipe.crop),
            ("last_learning_rate", recipe.last_learning_rate),
            ("average_decay", recipe.average_decay),
            ("betas", f64::from(recipe.betas[0])),
            ("betas", f64::from(recipe.betas[1])),
        ];
        let above_zero = above_zero
            .into_iter()
            .find(|(_, value)| !(value.is_finite() && *value > 0.0))
            .map(|(name, found)| format!("training.{name} must be above 0, found {found}"));
        let shares = shares
            .into_iter()
            .find(|(_, value)| !(0.0..1.0).contains(value))
            .map(|(name, found)| {
                format!("training.{name} must be from 0 to below 1, found {found}")
            });
        let decay = (!(recipe.weight_decay.is_finite() && recipe.weight_decay >= 0.0)).then(|| {
            format!(
                "training.weight_decay must be 0 or above, found {}",
                recipe.weight_decay
            )
        });
        let model = self.model.problem();
        model
            .map(|problem| format!("model.{problem}"))
            .or(above_zero)
            .or(shares)
            .or(decay)
            .or_else(|| recipe.losses.problem())
    }
}
