//! What is trained, and how: the file that `lamogen train --config` reads.

use std::path::{Path, PathBuf};

use lamogen_guide::TRAINING_STEPS;
use lamogen_model::ModelConfig;
use lamogen_motion::{POSE_FEATURES, placeholder};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::losses::LossWeights;
use crate::optimization::OptimizerConfig;

/// A denoiser and how it is trained.
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
    /// What it sees, and what it makes small.
    #[serde(default)]
    pub denoising: DenoisingConfig,
    /// How its weights move.
    #[serde(default)]
    pub optimization: OptimizerConfig,
}

/// What a denoiser sees, and what it makes small. What a file leaves out has the default.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DenoisingConfig {
    /// Frames of a batch with padding: as many motions are drawn as fit.
    pub frames_per_batch: usize,
    /// How often each motion of a batch is in it, at timesteps of its own: its caption is then read once for all of them.
    pub noises_per_motion: usize,
    /// Motions are sorted by length and dealt into so many buckets; a batch comes from one of them, so that little of it is
    /// padding.
    pub length_buckets: usize,
    /// The share of a motion's frames that may be cut away, at its ends, at each visit; never below the model's shortest motion.
    pub crop: f64,
    /// How often each caption is also known in other words (see [`Paraphrases`](crate::Paraphrases)), beside its own.
    pub phrasings: usize,
    /// What classifier-free guidance at this scale makes of the network that training begins with is learned as what the network itself says
    /// (guidance distillation, Meng et al. 2023; the target is that of Tang et al. 2025): it then follows sentences as closely in one evaluation a
    /// step. 1 learns none. Asks for a network to begin with that was trained with text dropout.
    #[serde(skip_serializing_if = "is_one")]
    pub text_scale: f64,
    /// The share of motions that are shown without their caption, so that the network knows motion of which nothing is said: what
    /// classifier-free guidance (Ho and Salimans 2022) needs.
    pub text_dropout: f64,
    /// The share of motions that are shown with their Laban features, as one more condition: what control without gradients needs. Their
    /// statistics are measured on the training split where the model's config has none.
    pub laban_share: f64,
    /// Motions are drawn by one over this power of how many have their source: 0 draws them as if all were from one, 1 each source alike.
    pub source_balance: f64,
    /// Sentences of a step that the text encoder learns from a sentence encoder; none at 0.
    pub sentences_per_batch: usize,
    /// Weight of what it learns from them.
    pub sentence_weight: f64,
    /// Weights of losses beside that of the prediction.
    pub losses: LossWeights,
}

impl Default for DenoisingConfig {
    fn default() -> Self {
        DenoisingConfig {
            frames_per_batch: 6400,
            noises_per_motion: 1,
            length_buckets: 8,
            crop: 0.0,
            phrasings: 0,
            text_dropout: 0.0,
            text_scale: 1.0,
            laban_share: 0.0,
            source_balance: 0.0,
            sentences_per_batch: 0,
            sentence_weight: 1.0,
            losses: LossWeights::default(),
        }
    }
}

// serde hands a reference.
#[allow(clippy::trivially_copy_pass_by_ref)]
fn is_one(scale: &f64) -> bool {
    *scale == 1.0
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
    /// A recipe for a network as large as the embedded one.
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
        read_file(path.as_ref(), Self::problem)
    }

    /// Reads a config from JSON; `name` stands in error messages.
    ///
    /// # Errors
    ///
    /// If it is no training config or a value makes no sense.
    pub fn from_json(json: &[u8], name: impl AsRef<Path>) -> Result<Self, TrainingConfigError> {
        read_json(json, name.as_ref(), Self::problem)
    }

    /// Why this cannot be trained, if it cannot.
    pub fn problem(&self) -> Option<String> {
        let found = self.model.input_feats;
        let features = (found != POSE_FEATURES).then(|| {
            format!("input_feats must be {POSE_FEATURES}, those of HumanML3D, found {found}")
        });
        let model = self.model.problem().or(features);
        model
            .map(|problem| format!("model.{problem}"))
            .or_else(|| self.denoising.problem())
            .or_else(|| self.optimization.problem())
    }
}

/// Reads a config of any kind from a file; `problem` says what makes no sense in it.
pub(crate) fn read_file<C: DeserializeOwned>(
    path: &Path,
    problem: fn(&C) -> Option<String>,
) -> Result<C, TrainingConfigError> {
    let bytes = std::fs::read(path).map_err(|reason| TrainingConfigError::Io {
        path: path.to_owned(),
        reason,
    })?;
    read_json(&bytes, path, problem)
}

/// Reads a config of any kind from JSON; `name` stands in error messages.
pub(crate) fn read_json<C: DeserializeOwned>(
    json: &[u8],
    name: &Path,
    problem: fn(&C) -> Option<String>,
) -> Result<C, TrainingConfigError> {
    let path = name.to_owned();
    if let Some(problem) = placeholder(json) {
        let problem = problem.to_owned();
        return Err(TrainingConfigError::Value { path, problem });
    }
    let config: C = match serde_json::from_slice(json) {
        Ok(config) => config,
        Err(reason) => return Err(TrainingConfigError::Json { path, reason }),
    };
    match problem(&config) {
        None => Ok(config),
        Some(problem) => Err(TrainingConfigError::Value { path, problem }),
    }
}

impl DenoisingConfig {
    /// Which value makes no sense.
    fn problem(&self) -> Option<String> {
        for (name, found) in [
            ("frames_per_batch", self.frames_per_batch),
            ("noises_per_motion", self.noises_per_motion),
            ("length_buckets", self.length_buckets),
        ] {
            if found == 0 {
                return Some(format!("denoising.{name} must be 1 or above, found 0"));
            }
        }
        if self.noises_per_motion > TRAINING_STEPS {
            let found = self.noises_per_motion;
            return Some(format!(
                "denoising.noises_per_motion must be at most {TRAINING_STEPS}, found {found}"
            ));
        }
        if !(0.0..1.0).contains(&self.crop) {
            let found = self.crop;
            return Some(format!(
                "denoising.crop must be from 0 to below 1, found {found}"
            ));
        }
        for (name, found) in [
            ("text_dropout", self.text_dropout),
            ("laban_share", self.laban_share),
            ("source_balance", self.source_balance),
        ] {
            if !(0.0..=1.0).contains(&found) {
                return Some(format!(
                    "denoising.{name} must be from 0 to 1, found {found}"
                ));
            }
        }
        if !(self.text_scale.is_finite() && self.text_scale >= 0.0) {
            let found = self.text_scale;
            return Some(format!(
                "denoising.text_scale must be 0 or above, found {found}"
            ));
        }
        if !(self.sentence_weight.is_finite() && self.sentence_weight >= 0.0) {
            let found = self.sentence_weight;
            return Some(format!(
                "denoising.sentence_weight must be 0 or above, found {found}"
            ));
        }
        if self.sentences_per_batch == 1 {
            return Some("denoising.sentences_per_batch must be 0, or 2 and above: sentences are compared with each other".to_owned());
        }
        self.losses.problem()
    }
}
