//! The configuration of a network, as stored in `config.json`.

use std::path::{Path, PathBuf};

use lamogen_io::placeholder;
use serde::{Deserialize, Serialize};

/// The quantity that a network predicts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Prediction {
    /// The noise in `x_t`, as in MotionDiffuse.
    #[default]
    Epsilon,
    /// The clean motion.
    Sample,
    /// `v = √ᾱ · noise - √(1 - ᾱ) · clean motion` (Salimans and Ho 2022, section 4).
    #[serde(rename = "v_prediction")]
    V,
}

/// The sizes of the CLIP text tower (Radford et al. 2021).
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClipTextConfig {
    /// The number of token ids.
    pub vocab_size: usize,
    /// The number of tokens of a padded prompt.
    pub context_length: usize,
    /// The width of the token features.
    pub width: usize,
    /// The number of attention heads.
    pub heads: usize,
    /// The number of transformer layers.
    pub layers: usize,
}

/// The statistics that normalise the Laban features of a motion for a network that is conditioned on them.
///
/// Such a network reads the natural logarithms of the means over time of Weight, Time, Flow and Shape. The logarithms are
/// normalised by their mean and standard deviation over the training clips.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LabanCondition {
    /// The mean of the logarithms over the training clips: Weight, Time, Flow, Shape.
    pub mean: [f32; LABAN_FEATURES],
    /// The standard deviation of the logarithms over the training clips.
    pub std: [f32; LABAN_FEATURES],
}

/// The number of Laban features: Weight, Time, Flow and Shape.
pub const LABAN_FEATURES: usize = 4;

impl LabanCondition {
    /// Computes the statistics of motions from the means over time of their features.
    ///
    /// If a feature is the same in all motions, its standard deviation is set to 1.
    pub fn of(means: impl IntoIterator<Item = [f32; LABAN_FEATURES]>) -> Self {
        let rows = { means.into_iter() }.map(|means| means.map(|mean| f64::from(log_mean(mean))));
        let rows: Vec<[f64; LABAN_FEATURES]> = rows.collect();
        let count = rows.len().max(1) as f64;
        let average = |value: &dyn Fn(&[f64; LABAN_FEATURES]) -> f64| {
            rows.iter().map(value).sum::<f64>() / count
        };
        let mean: [f64; LABAN_FEATURES] =
            std::array::from_fn(|feature| average(&|row| row[feature]));
        let deviation =
            |feature: usize| average(&|row| (row[feature] - mean[feature]).powi(2)).sqrt() as f32;
        LabanCondition {
            mean: mean.map(|mean| mean as f32),
            std: std::array::from_fn(|feature| match deviation(feature) {
                0.0 => 1.0,
                deviation => deviation,
            }),
        }
    }

    /// Encodes the features of a motion as the input of the network.
    ///
    /// First comes the normalised logarithm of each feature, limited to four standard deviations from the mean, or 0 if the
    /// feature is not given. Then comes, for each feature, 1 if the feature is given and 0 otherwise.
    ///
    /// `means` are the features' means over time, as `lamogen_laban::LabanFeatures` measures them by default. Negative means
    /// are treated as 0.
    pub fn encode(&self, means: &[Option<f32>; LABAN_FEATURES]) -> [f32; 2 * LABAN_FEATURES] {
        const MAX_DEVIATIONS: f32 = 4.0;
        std::array::from_fn(|place| {
            match (
                place.checked_sub(LABAN_FEATURES),
                means[place % LABAN_FEATURES],
            ) {
                (_, None) => 0.0,
                (Some(_), Some(_)) => 1.0,
                (None, Some(mean)) => ((log_mean(mean) - self.mean[place]) / self.std[place])
                    .clamp(-MAX_DEVIATIONS, MAX_DEVIATIONS),
            }
        })
    }

    /// Describes the first number that is not valid, if there is one.
    fn problem(&self) -> Option<String> {
        for (name, numbers, least) in [
            ("mean", &self.mean, f32::NEG_INFINITY),
            ("std", &self.std, 0.0),
        ] {
            if let Some(found) = numbers
                .iter()
                .find(|number| !(number.is_finite() && **number > least))
            {
                return Some(format!(
                    "laban_condition.{name} must be finite numbers{}, found {found}",
                    if least == 0.0 { " above 0" } else { "" }
                ));
            }
        }
        None
    }
}

/// Computes the natural logarithm of a feature's mean, which is finite even for a motion at rest.
fn log_mean(mean: f32) -> f32 {
    const MIN_MEAN: f32 = 1e-12;
    mean.max(MIN_MEAN).ln()
}

/// The sizes of a denoiser with its text encoder. The names are those of MotionDiffuse's options.
///
/// ```
/// use lamogen_model::ModelConfig;
///
/// let config = ModelConfig::motion_diffuse();
/// let json = serde_json::to_string(&config).unwrap();
/// assert_eq!(ModelConfig::from_json(json.as_bytes(), "config.json").unwrap(), config);
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelConfig {
    /// The number of pose features per frame.
    pub input_feats: usize,
    /// The length of the longest motion, in frames.
    pub num_frames: usize,
    /// The length of the shortest motion that the network was trained on, in frames.
    ///
    /// The default is 40, as in HumanML3D, or 1 if `num_frames` is below 40.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub min_frames: Option<usize>,
    /// The width of the motion's hidden state.
    pub latent_dim: usize,
    /// The width inside the feed-forward layers.
    pub ff_size: usize,
    /// The number of decoder blocks.
    pub num_layers: usize,
    /// The number of attention heads of the decoder.
    pub num_heads: usize,
    /// The width of the text features that the decoder attends to.
    pub text_latent_dim: usize,
    /// The width inside the feed-forward layers of the text transformer.
    pub text_ff_size: usize,
    /// The number of attention heads of the text transformer.
    pub text_num_heads: usize,
    /// The number of layers of the text transformer.
    pub num_text_layers: usize,
    /// The sizes of the CLIP text tower.
    pub clip: ClipTextConfig,
    /// The quantity that the network predicts.
    #[serde(default)]
    pub prediction: Prediction,
    /// The normalisation of Laban features. Without it, the network cannot be conditioned on Laban features.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub laban_condition: Option<LabanCondition>,
    /// The recommended sampling settings. The default is the settings for MotionDiffuse's own networks.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sampling: Option<SamplingDefaults>,
}

/// The sampling settings that the trainers of a network recommend.
///
/// The settings do not change what the network computes. They are the defaults for generating motions with the network.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SamplingDefaults {
    /// The name of a preset for guidance and its steps: `precise`, `fast` or `paper`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub preset: Option<String>,
    /// The standard deviation, in frames, of the Gaussian that smooths predictions along time. 0 means no smoothing.
    #[serde(alias = "coherence", skip_serializing_if = "Option::is_none")]
    pub temporal_smoothing: Option<f32>,
    /// The scale of classifier-free guidance. With a scale of 1, the network is evaluated only once per step.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub text_scale: Option<f64>,
    /// The smallest timestep at which predictions are scaled by [`text_scale`](Self::text_scale). Below it, the network is evaluated only once per step.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub text_scale_until: Option<usize>,
    /// The sentence that replaces a prompt that says nothing in words that the network knows.
    ///
    /// Without the replacement, the motion for such a prompt would be arbitrary. With `None`, the prompt is used anyway. The
    /// replacement needs the network's list of words.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stand_in: Option<String>,
}

/// The length in frames of HumanML3D's shortest clips.
const MIN_CLIP_FRAMES: usize = 40;

/// An error of a config.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// The file cannot be read.
    #[error("{path}: {reason}")]
    #[allow(missing_docs)]
    Io {
        path: PathBuf,
        reason: std::io::Error,
    },
    /// The file is not a config in JSON.
    #[error("{path}: not a model config: {reason}")]
    #[allow(missing_docs)]
    Json {
        path: PathBuf,
        reason: serde_json::Error,
    },
    /// The sizes do not form a valid network.
    #[error("{path}: {problem}")]
    #[allow(missing_docs)]
    Size { path: PathBuf, problem: String },
}

impl ModelConfig {
    /// Returns the sizes of the public MotionDiffuse text-to-motion checkpoint (CLIP ViT-B/32).
    pub fn motion_diffuse() -> Self {
        ModelConfig {
            input_feats: 263,
            num_frames: 196,
            min_frames: None,
            latent_dim: 512,
            ff_size: 1024,
            num_layers: 8,
            num_heads: 8,
            text_latent_dim: 256,
            text_ff_size: 2048,
            text_num_heads: 4,
            num_text_layers: 4,
            clip: ClipTextConfig {
                vocab_size: 49408,
                context_length: 77,
                width: 512,
                heads: 8,
                layers: 12,
            },
            prediction: Prediction::Epsilon,
            laban_condition: None,
            sampling: None,
        }
    }

    /// Reads a `config.json`.
    ///
    /// # Errors
    ///
    /// If the file cannot be read, is not a config, or its sizes do not form a valid network.
    pub fn from_file(path: impl AsRef<Path>) -> Result<Self, ConfigError> {
        let path = path.as_ref();
        let bytes = std::fs::read(path).map_err(|reason| ConfigError::Io {
            path: path.to_owned(),
            reason,
        })?;
        Self::from_json(&bytes, path)
    }

    /// Reads a config from JSON. `name` is used in error messages.
    ///
    /// # Errors
    ///
    /// If the JSON is not a config or its sizes do not form a valid network.
    pub fn from_json(json: &[u8], name: impl AsRef<Path>) -> Result<Self, ConfigError> {
        let path = || name.as_ref().to_owned();
        if let Some(problem) = placeholder(json) {
            return Err(ConfigError::Size {
                path: path(),
                problem: problem.to_owned(),
            });
        }
        let config: ModelConfig =
            serde_json::from_slice(json).map_err(|reason| ConfigError::Json {
                path: path(),
                reason,
            })?;
        match config.problem() {
            None => Ok(config),
            Some(problem) => Err(ConfigError::Size {
                path: path(),
                problem,
            }),
        }
    }

    /// Returns the length of the shortest motion that may be requested, in frames.
    pub fn shortest(&self) -> usize {
        let default = match self.num_frames {
            MIN_CLIP_FRAMES.. => MIN_CLIP_FRAMES,
            _ => 1,
        };
        self.min_frames.unwrap_or(default)
    }

    /// Returns the width of the condition, which is the width of the embeddings of the timestep and the sentence.
    pub fn condition_dim(&self) -> usize {
        4 * self.latent_dim
    }

    /// Checks the sizes. Returns a description of the problem if they do not form a valid network.
    pub fn problem(&self) -> Option<String> {
        let clip = &self.clip;
        let sizes = [
            ("input_feats", self.input_feats),
            ("num_frames", self.num_frames),
            ("latent_dim", self.latent_dim),
            ("ff_size", self.ff_size),
            ("num_heads", self.num_heads),
            ("text_latent_dim", self.text_latent_dim),
            ("text_ff_size", self.text_ff_size),
            ("text_num_heads", self.text_num_heads),
            ("clip.vocab_size", clip.vocab_size),
            ("clip.context_length", clip.context_length),
            ("clip.width", clip.width),
            ("clip.heads", clip.heads),
        ];
        /// The largest allowed size, which is beyond any network of this kind. The limit prevents products of sizes from
        /// overflowing.
        const MAX_SIZE: usize = 1 << 24;
        if let Some((name, found)) = sizes
            .into_iter()
            .find(|&(_, size)| size == 0 || size > MAX_SIZE)
        {
            return Some(format!(
                "{name} must be from 1 to {MAX_SIZE}, found {found}"
            ));
        }
        /// The largest allowed number of layers, which is beyond any transformer. The limit prevents a typing error from
        /// requesting all memory.
        const MAX_LAYERS: usize = 1024;
        for (name, least, found) in [
            ("num_layers", 1, self.num_layers),
            ("num_text_layers", 0, self.num_text_layers),
            ("clip.layers", 0, clip.layers),
        ] {
            if !(least..=MAX_LAYERS).contains(&found) {
                return Some(format!(
                    "{name} must be from {least} to {MAX_LAYERS}, found {found}"
                ));
            }
        }
        if !(1..=self.num_frames).contains(&self.shortest()) {
            return Some(format!(
                "min_frames must be from 1 to num_frames ({}), found {}",
                self.num_frames,
                self.shortest()
            ));
        }
        for (name, width, heads_name, heads) in [
            ("latent_dim", self.latent_dim, "num_heads", self.num_heads),
            (
                "text_latent_dim",
                self.text_latent_dim,
                "text_num_heads",
                self.text_num_heads,
            ),
            ("clip.width", clip.width, "clip.heads", clip.heads),
        ] {
            if width % heads != 0 {
                return Some(format!(
                    "{name} must be a multiple of {heads_name}, found {width} and {heads}"
                ));
            }
        }
        if !self.latent_dim.is_multiple_of(2) {
            return Some(format!(
                "latent_dim must be even (half cosines, half sines of the timestep), found {}",
                self.latent_dim
            ));
        }
        /// The largest allowed number of parameters, which is beyond any network of this kind: 16 GB in 32 bits.
        const MAX_PARAMETERS: f64 = 4e9;
        let parameters = self.approximate_parameters();
        if parameters > MAX_PARAMETERS {
            return Some(format!(
                "the sizes together ask for {:.0} million parameters; expected at most {:.0} million",
                parameters / 1e6,
                MAX_PARAMETERS / 1e6
            ));
        }
        { self.laban_condition.as_ref() }.and_then(LabanCondition::problem)
    }

    /// Estimates the number of parameters of the network by counting those of its matrices.
    fn approximate_parameters(&self) -> f64 {
        let [latent, inner, text, text_inner] = [
            self.latent_dim,
            self.ff_size,
            self.text_latent_dim,
            self.text_ff_size,
        ]
        .map(|size| size as f64);
        let clip = &self.clip;
        let width = clip.width as f64;
        let embedding = 4.0 * latent;
        // A block has three stylizations, the attention to frames and to words, and the feed-forward layers.
        let block = 3.0 * (2.0 * embedding * latent + latent * latent)
            + 4.0 * latent * latent
            + 2.0 * latent * text
            + 2.0 * latent * inner;
        let decoder = self.num_layers as f64 * block
            + embedding * (latent + embedding + text)
            + latent * (self.num_frames + 2 * self.input_feats) as f64;
        let tower = width * (clip.vocab_size + clip.context_length) as f64
            + clip.layers as f64 * 12.0 * width * width;
        let encoder = width * text
            + self.num_text_layers as f64 * (4.0 * text * text + 2.0 * text * text_inner);
        decoder + tower + encoder
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn error(change: impl Fn(&mut serde_json::Value)) -> String {
        let mut json = serde_json::to_value(ModelConfig::motion_diffuse()).unwrap();
        change(&mut json);
        ModelConfig::from_json(json.to_string().as_bytes(), "folder/config.json")
            .unwrap_err()
            .to_string()
    }

    #[test]
    fn parameters_are_about_as_many_as_there_are() {
        // The checkpoint has 600 MB in 32 bits, including CLIP's text tower.
        let million = ModelConfig::motion_diffuse().approximate_parameters() / 1e6;
        assert!((145.0..155.0).contains(&million), "{million}");
    }

    #[test]
    fn sizes_that_make_no_network_are_named() {
        for (message, parts) in [
            (
                error(|c| c["latent_dim"] = 1_000_000.into()),
                ["million parameters", "at most 4000 million"],
            ),
            (
                error(|c| c["clip"]["vocab_size"] = 16_000_000.into()),
                ["million parameters", "at most 4000 million"],
            ),
            (error(|c| c["num_heads"] = 7.into()), ["num_heads", "512"]),
            (
                error(|c| c["latent_dim"] = 0.into()),
                ["latent_dim", "found 0"],
            ),
            (
                error(|c| c["num_layers"] = 0.into()),
                ["num_layers", "found 0"],
            ),
            (
                error(|c| c["clip"]["layers"] = u64::MAX.into()),
                ["clip.layers", "1024"],
            ),
            (
                error(|c| c["min_frames"] = 197.into()),
                ["min_frames", "(196), found 197"],
            ),
            (
                error(|c| c["min_frames"] = 0.into()),
                ["min_frames", "found 0"],
            ),
            (
                error(|c| c["clip"]["width"] = 500.into()),
                ["clip.width", "clip.heads"],
            ),
        ] {
            assert!(message.contains("folder/config.json"), "{message}");
            assert!(parts.iter().all(|part| message.contains(part)), "{message}");
        }
    }

    #[test]
    fn a_missing_a_misspelt_and_an_unknown_value_are_named() {
        let message = error(|c| {
            c.as_object_mut().unwrap().remove("ff_size");
        });
        assert!(message.contains("ff_size"), "{message}");
        let message = error(|c| c["predicton"] = "sample".into());
        assert!(message.contains("predicton"), "{message}");
        let message = error(|c| c["prediction"] = "velocity".into());
        assert!(
            message.contains("velocity") && message.contains("sample"),
            "{message}"
        );
    }

    #[test]
    fn a_missing_file_is_named() {
        let message = ModelConfig::from_file("no/config.json").unwrap_err();
        assert!(message.to_string().contains("no/config.json"));
    }
}
