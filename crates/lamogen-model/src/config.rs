//! Sizes of a network, as `config.json` states them.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

/// What the network's output is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Prediction {
    /// The noise in `x_t` (MotionDiffuse).
    #[default]
    Epsilon,
    /// The clean motion.
    Sample,
}

/// Sizes of the CLIP text tower (Radford et al. 2021).
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClipTextConfig {
    /// Number of token ids.
    pub vocab_size: usize,
    /// Number of tokens of a padded prompt.
    pub context_length: usize,
    /// Width of token features.
    pub width: usize,
    /// Attention heads.
    pub heads: usize,
    /// Transformer layers.
    pub layers: usize,
}

/// Sizes of a denoiser with its text encoder. The names are those of MotionDiffuse's options.
///
/// ```
/// use lamogen_model::ModelConfig;
///
/// let config = ModelConfig::motion_diffuse();
/// let json = serde_json::to_string(&config).unwrap();
/// assert_eq!(ModelConfig::from_json(json.as_bytes(), "config.json").unwrap(), config);
/// ```
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelConfig {
    /// Pose features a frame.
    pub input_feats: usize,
    /// The longest motion, in frames.
    pub num_frames: usize,
    /// The shortest motion the network was trained on, in frames.
    #[serde(default = "shortest_clip_of_humanml3d")]
    pub min_frames: usize,
    /// Width of the motion's hidden state.
    pub latent_dim: usize,
    /// Width inside the feed-forward layers.
    pub ff_size: usize,
    /// Decoder blocks.
    pub num_layers: usize,
    /// Attention heads of the decoder.
    pub num_heads: usize,
    /// Width of the text features that the decoder attends to.
    pub text_latent_dim: usize,
    /// Width inside the feed-forward layers of the text transformer.
    pub text_ff_size: usize,
    /// Attention heads of the text transformer.
    pub text_num_heads: usize,
    /// Layers of the text transformer.
    pub num_text_layers: usize,
    /// Sizes of the CLIP text tower.
    pub clip: ClipTextConfig,
    /// What the output is.
    #[serde(default)]
    pub prediction: Prediction,
}

fn shortest_clip_of_humanml3d() -> usize {
    40
}

/// What is wrong with a config.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// The file cannot be read.
    #[error("{path}: {source}")]
    #[allow(missing_docs)]
    Io {
        path: PathBuf,
        source: std::io::Error,
    },
    /// The file is not a config in JSON.
    #[error("{path}: not a model config: {source}")]
    #[allow(missing_docs)]
    Json {
        path: PathBuf,
        source: serde_json::Error,
    },
    /// Sizes that make no network.
    #[error("{path}: {problem}")]
    #[allow(missing_docs)]
    Size { path: PathBuf, problem: String },
}

impl ModelConfig {
    /// Sizes of the public MotionDiffuse text-to-motion checkpoint (CLIP ViT-B/32).
    pub fn motion_diffuse() -> Self {
        ModelConfig {
            input_feats: 263,
            num_frames: 196,
            min_frames: shortest_clip_of_humanml3d(),
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
        }
    }

    /// Reads a `config.json`.
    ///
    /// # Errors
    ///
    /// If the file cannot be read, is not a config, or its sizes make no network.
    pub fn from_file(path: impl AsRef<Path>) -> Result<Self, ConfigError> {
        let path = path.as_ref();
        let bytes = std::fs::read(path).map_err(|source| ConfigError::Io {
            path: path.to_owned(),
            source,
        })?;
        Self::from_json(&bytes, path)
    }

    /// Reads a config from JSON; `name` stands in error messages.
    ///
    /// # Errors
    ///
    /// If it is not a config or its sizes make no network.
    pub fn from_json(json: &[u8], name: impl AsRef<Path>) -> Result<Self, ConfigError> {
        let path = || name.as_ref().to_owned();
        let config: ModelConfig =
            serde_json::from_slice(json).map_err(|source| ConfigError::Json {
                path: path(),
                source,
            })?;
        match config.problem() {
            None => Ok(config),
            Some(problem) => Err(ConfigError::Size {
                path: path(),
                problem,
            }),
        }
    }

    /// Width of the condition: the timestep's and the sentence's embedding.
    pub fn condition_dim(&self) -> usize {
        4 * self.latent_dim
    }

    /// Why these sizes make no network, if they do not.
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
        /// Beyond any network of this kind; keeps products of sizes from overflowing.
        const LARGEST: usize = 1 << 24;
        if let Some((name, found)) = sizes
            .into_iter()
            .find(|&(_, size)| size == 0 || size > LARGEST)
        {
            return Some(format!("{name} must be from 1 to {LARGEST}, found {found}"));
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
        None
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
    fn sizes_that_make_no_network_are_named() {
        for (message, parts) in [
            (error(|c| c["num_heads"] = 7.into()), ["num_heads", "512"]),
            (
                error(|c| c["latent_dim"] = 0.into()),
                ["latent_dim", "found 0"],
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
