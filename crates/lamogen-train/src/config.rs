//! The training config of a denoiser: the file that `lamogen train --config` reads.

use std::path::{Path, PathBuf};

use lamogen_model::ModelConfig;
use lamogen_motion::placeholder;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::losses::LossWeights;
use crate::mdm::MdmModelConfig;
use crate::network_config::NetworkConfig;
use crate::optimization::OptimizerConfig;

/// The config of a denoiser and of its training.
///
/// ```
/// use lamogen_train::TrainingConfig;
///
/// let config = TrainingConfig::compact();
/// assert_eq!(config.model.latent_dim, 128);
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainingConfig<M = ModelConfig> {
    /// The sizes of the network, and what it predicts.
    pub model: M,
    /// The data of each training step, and the losses.
    #[serde(default)]
    pub denoising: DenoisingConfig,
    /// The optimiser and its learning rate.
    #[serde(default)]
    pub optimization: OptimizerConfig,
}

/// The config of a denoiser of any family and of its training.
#[derive(Clone, Debug, PartialEq)]
pub enum AnyTrainingConfig {
    /// That of a network like MotionDiffuse.
    MotionDiffuse(TrainingConfig),
    /// That of an MDM.
    Mdm(TrainingConfig<MdmModelConfig>),
}

/// The training data and the losses of a denoiser. A field that a file leaves out has its default.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DenoisingConfig {
    /// The frames of a batch, padding included: a batch has as many motions as fit.
    pub frames_per_batch: usize,
    /// How often a batch contains each of its motions, each time with another timestep and other noise. The text encoder then
    /// encodes the motion's caption once for all of them.
    pub noises_per_motion: usize,
    /// The number of buckets into which the motions are divided by length. A batch comes from one bucket, so that little of it
    /// is padding.
    pub length_buckets: usize,
    /// The largest share of a motion's frames that is cut away at its ends each time the motion is drawn. What is left is never
    /// shorter than the model's shortest motion.
    pub crop: f64,
    /// The largest number of paraphrases that training uses of each caption (see [`Paraphrases`](crate::Paraphrases)), besides
    /// the caption itself.
    pub phrasings: usize,
    /// The scale of the classifier-free guidance that the network learns to reproduce without guidance (guidance distillation,
    /// Meng et al. 2023; the target is that of Tang et al. 2025). The network that training begins with supplies the effect of
    /// the guidance. The trained network then follows sentences as closely with one evaluation per step. 1 turns distillation
    /// off; any other scale needs a network to begin with that was trained with text dropout.
    #[serde(skip_serializing_if = "is_one")]
    pub text_scale: f64,
    /// The share of motions that the network sees without their caption, so that it also learns motion without text, which
    /// classifier-free guidance (Ho and Salimans 2022) needs.
    pub text_dropout: f64,
    /// The share of motions that the network sees with their Laban features as a further condition, which control without
    /// gradients needs. The statistics of the features are measured on the training split if the model's config has none.
    pub laban_share: f64,
    /// The exponent that balances sources: a motion is drawn in proportion to one over this power of the number of motions from
    /// its source. 0 ignores sources, 1 gives every source the same share.
    pub source_balance: f64,
    /// The number of sentences in each step from which the text encoder learns a sentence encoder's similarities; 0 turns this off.
    pub sentences_per_batch: usize,
    /// The weight of the loss on these sentences.
    pub sentence_weight: f64,
    /// The weights of the losses besides the loss of the prediction.
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

// serde passes a reference.
#[allow(clippy::trivially_copy_pass_by_ref)]
fn is_one(scale: &f64) -> bool {
    *scale == 1.0
}

/// The error of a training config that cannot be used.
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
    /// A value makes no sense.
    #[error("{path}: {problem}")]
    #[allow(missing_docs)]
    Value { path: PathBuf, problem: String },
}

impl TrainingConfig {
    /// Returns the recipe for a network of the embedded model's size.
    pub fn compact() -> Self {
        let file = include_bytes!("../configs/compact.json");
        Self::from_json(file, "compact.json").expect("checked by a test")
    }
}

impl AnyTrainingConfig {
    /// Reads a config from a file. The family is that of MDM if the sizes of the network have an `arch`.
    ///
    /// # Errors
    ///
    /// If the file cannot be read, is not a training config, or has a value that makes no sense.
    pub fn from_file(path: impl AsRef<Path>) -> Result<Self, TrainingConfigError> {
        /// The part of a config that tells the family.
        #[derive(Deserialize)]
        struct Family {
            model: serde_json::Map<String, serde_json::Value>,
        }
        let path = path.as_ref();
        let bytes = read_bytes(path)?;
        // A file that is no config is named by the reader of the larger family.
        let family = serde_json::from_slice::<Family>(&bytes);
        Ok(
            match family.is_ok_and(|family| family.model.contains_key("arch")) {
                true => AnyTrainingConfig::Mdm(TrainingConfig::from_json(&bytes, path)?),
                false => AnyTrainingConfig::MotionDiffuse(TrainingConfig::from_json(&bytes, path)?),
            },
        )
    }
}

impl<M: NetworkConfig> TrainingConfig<M> {
    /// Reads a config from a file such as [`compact.json`](TrainingConfig::compact).
    ///
    /// # Errors
    ///
    /// If the file cannot be read, is not a training config, or has a value that makes no sense.
    pub fn from_file(path: impl AsRef<Path>) -> Result<Self, TrainingConfigError> {
        read_file(path.as_ref(), Self::problem)
    }

    /// Reads a config from JSON. Error messages show `name` as its path.
    ///
    /// # Errors
    ///
    /// If the JSON is not a training config, or has a value that makes no sense.
    pub fn from_json(json: &[u8], name: impl AsRef<Path>) -> Result<Self, TrainingConfigError> {
        read_json(json, name.as_ref(), Self::problem)
    }

    /// Returns why a network cannot be trained with this config; `None` if it can.
    pub fn problem(&self) -> Option<String> {
        let timesteps = || self.model.noise_schedule().timesteps();
        { self.model.problem() }
            .map(|problem| format!("model.{problem}"))
            .or_else(|| self.denoising.problem(timesteps()))
            .or_else(|| self.model.unsupported(&self.denoising))
            .or_else(|| self.optimization.problem())
    }
}

/// Reads a config of any type from a file; `problem` returns what makes no sense in it.
pub(crate) fn read_file<C: DeserializeOwned>(
    path: &Path,
    problem: fn(&C) -> Option<String>,
) -> Result<C, TrainingConfigError> {
    read_json(&read_bytes(path)?, path, problem)
}

/// Reads the bytes of a config.
fn read_bytes(path: &Path) -> Result<Vec<u8>, TrainingConfigError> {
    std::fs::read(path).map_err(|reason| TrainingConfigError::Io {
        path: path.to_owned(),
        reason,
    })
}

/// Reads a config of any type from JSON; error messages show `name` as its path, and `problem` returns what makes no sense in it.
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
    /// Describes the first value that makes no sense for a network of that many timesteps; `None` if there is none.
    fn problem(&self, timesteps: usize) -> Option<String> {
        for (name, found) in [
            ("frames_per_batch", self.frames_per_batch),
            ("noises_per_motion", self.noises_per_motion),
            ("length_buckets", self.length_buckets),
        ] {
            if found == 0 {
                return Some(format!("denoising.{name} must be 1 or above, found 0"));
            }
        }
        if self.noises_per_motion > timesteps {
            let found = self.noises_per_motion;
            return Some(format!(
                "denoising.noises_per_motion must be at most the network's {timesteps} timesteps, found {found}"
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
