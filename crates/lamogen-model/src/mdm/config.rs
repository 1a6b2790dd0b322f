//! The configuration of an MDM, as its `args.json` states it.

use std::path::Path;

use lamogen_io::placeholder;
use serde::{Deserialize, Serialize};

use crate::checkpoint::{Checkpoint, CheckpointError};
use crate::config::{ConfigError, SamplingDefaults};
use crate::diffusion::{MotionWindow, NoiseSchedule};

/// The part that attends to the frames of a motion.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum MdmArchitecture {
    /// The frames and one token of sentence and timestep attend to each other.
    #[default]
    #[serde(rename = "trans_enc")]
    Encoder,
    /// The frames attend to each other and to the tokens of the text.
    #[serde(rename = "trans_dec")]
    Decoder,
}

/// The network that reads the text.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum TextEncoderKind {
    /// The text tower of CLIP ViT-B/32, which turns a sentence into one token.
    Clip,
    /// DistilBERT, which turns a sentence into a token for each of its word pieces.
    Bert,
}

/// The sizes and the training of an MDM.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MdmConfig {
    /// The part that attends to the frames.
    pub arch: MdmArchitecture,
    /// The network that reads the text.
    pub text_encoder_type: TextEncoderKind,
    /// The number of pose features per frame.
    pub features: usize,
    /// The width of the hidden state.
    pub latent_dim: usize,
    /// The width inside the feed-forward layers.
    pub ff_size: usize,
    /// The number of layers.
    pub layers: usize,
    /// The number of attention heads.
    pub heads: usize,
    /// The width of the text encoder's features.
    pub text_width: usize,
    /// The noise schedule.
    pub noise_schedule: NoiseSchedule,
    /// The share of the training's motions that were shown without their text. A network with 0 is not made for
    /// classifier-free guidance.
    pub text_dropout: f64,
    /// Whether frames past the end of a motion were masked in training.
    pub mask_frames: bool,
    /// Whether the average of the weights over the training is used where the checkpoint has it.
    pub use_ema: bool,
    /// The windows of a network that continues motions (DiP).
    pub window: Option<MotionWindow>,
    /// The recommended sampling settings, which `lamogen train` writes. `None` for networks of MDM's authors.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sampling: Option<SamplingDefaults>,
}

/// The keys of `args.json` that matter to the network. All others are options of its training, except `sampling`, which only
/// lamogen writes.
#[derive(Serialize, Deserialize)]
#[serde(default)]
struct Arguments {
    arch: String,
    text_encoder_type: String,
    layers: usize,
    latent_dim: usize,
    emb_trans_dec: bool,
    cond_mask_prob: f64,
    mask_frames: bool,
    use_ema: bool,
    pos_embed_max_len: usize,
    dataset: String,
    unconstrained: bool,
    noise_schedule: String,
    diffusion_steps: usize,
    sigma_small: bool,
    context_len: usize,
    pred_len: usize,
    emb_policy: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    sampling: Option<SamplingDefaults>,
}

impl Default for Arguments {
    /// Returns what a missing key means.
    fn default() -> Self {
        Arguments {
            arch: "trans_enc".into(),
            text_encoder_type: "clip".into(),
            layers: 8,
            latent_dim: 512,
            emb_trans_dec: false,
            cond_mask_prob: 0.1,
            mask_frames: false,
            use_ema: false,
            pos_embed_max_len: 5000,
            dataset: "humanml".into(),
            unconstrained: false,
            noise_schedule: "cosine".into(),
            diffusion_steps: 1000,
            sigma_small: true,
            context_len: 0,
            pred_len: 0,
            emb_policy: "add".into(),
            sampling: None,
        }
    }
}

/// The number of attention heads, which the public code fixes.
const HEADS: usize = 4;

/// The width inside the feed-forward layers, which the public code fixes.
const FF_SIZE: usize = 1024;

/// The length in frames of HumanML3D's longest clips.
const MAX_CLIP_FRAMES: usize = 196;

impl Default for MdmConfig {
    /// Returns the config of the paper's network, which is what an empty `args.json` means.
    fn default() -> Self {
        Self::from_arguments(Arguments::default()).expect("the paper's network is here")
    }
}

impl MdmConfig {
    /// Reads an `args.json`.
    ///
    /// # Errors
    ///
    /// If the file cannot be read, is not a JSON object, or describes a network that this crate does not have, such as one
    /// with the architecture `gru`.
    pub fn from_file(path: impl AsRef<Path>) -> Result<Self, ConfigError> {
        let path = path.as_ref();
        let bytes = std::fs::read(path).map_err(|reason| ConfigError::Io {
            path: path.to_owned(),
            reason,
        })?;
        Self::from_json(&bytes, path)
    }

    /// Reads the content of an `args.json`. `name` is used in error messages.
    ///
    /// # Errors
    ///
    /// In the same cases as [`from_file`](Self::from_file), except that nothing is read.
    pub fn from_json(json: &[u8], name: impl AsRef<Path>) -> Result<Self, ConfigError> {
        let problem = |problem: String| ConfigError::Size {
            path: name.as_ref().to_owned(),
            problem,
        };
        if let Some(found) = placeholder(json) {
            return Err(problem(found.to_owned()));
        }
        let arguments = serde_json::from_slice(json).map_err(|reason| ConfigError::Json {
            path: name.as_ref().to_owned(),
            reason,
        })?;
        Self::from_arguments(arguments).map_err(problem)
    }

    fn from_arguments(arguments: Arguments) -> Result<Self, String> {
        let arch = match &arguments.arch[..] {
            "trans_enc" => MdmArchitecture::Encoder,
            "trans_dec" => MdmArchitecture::Decoder,
            other => return Err(expected("arch", "trans_enc or trans_dec", other)),
        };
        let (text_encoder_type, text_width) = match &arguments.text_encoder_type[..] {
            "clip" => (TextEncoderKind::Clip, 512),
            "bert" if arch == MdmArchitecture::Decoder => (TextEncoderKind::Bert, 768),
            "bert" => return Err(expected("arch", "trans_dec beside bert", &arguments.arch)),
            other => return Err(expected("text_encoder_type", "clip or bert", other)),
        };
        if arguments.unconstrained {
            return Err(expected(
                "unconstrained",
                "false, a network that reads text",
                "true",
            ));
        }
        if arguments.emb_trans_dec {
            return Err(expected("emb_trans_dec", "false", "true"));
        }
        if !arguments.sigma_small {
            return Err(expected("sigma_small", "true", "false"));
        }
        if arguments.emb_policy != "add" {
            return Err(expected("emb_policy", "add", &arguments.emb_policy));
        }
        let features = match &arguments.dataset[..] {
            "humanml" => 263,
            "kit" => 251,
            other => return Err(expected("dataset", "humanml", other)),
        };
        for (name, least, most, found) in [
            ("layers", 1, 1024, arguments.layers),
            ("latent_dim", 1, 1 << 16, arguments.latent_dim),
            ("diffusion_steps", 1, 1_000_000, arguments.diffusion_steps),
        ] {
            if !(least..=most).contains(&found) {
                return Err(format!(
                    "{name} must be from {least} to {most}, found {found}"
                ));
            }
        }
        // Half of the channels of a position are sines and half are cosines.
        if !arguments.latent_dim.is_multiple_of(2 * HEADS) {
            let found = arguments.latent_dim;
            return Err(format!(
                "latent_dim must be a multiple of {}, found {found}",
                2 * HEADS
            ));
        }
        let timesteps = arguments.diffusion_steps;
        let noise_schedule = match &arguments.noise_schedule[..] {
            "cosine" => NoiseSchedule::Cosine { timesteps },
            "linear" => NoiseSchedule::Linear { timesteps },
            other => return Err(expected("noise_schedule", "cosine or linear", other)),
        };
        let window = match (arguments.context_len, arguments.pred_len) {
            (0, 0) => None,
            (prefix, frames @ 1..) if arch == MdmArchitecture::Decoder && prefix <= frames => {
                Some(MotionWindow { prefix, frames })
            }
            (prefix, frames) => {
                return Err(format!(
                    "expected context_len and pred_len to be 0, or a trans_dec with a pred_len of at least context_len; found {prefix} and {frames} with {}",
                    arguments.arch
                ));
            }
        };
        let config = MdmConfig {
            arch,
            text_encoder_type,
            features,
            latent_dim: arguments.latent_dim,
            ff_size: FF_SIZE,
            layers: arguments.layers,
            heads: HEADS,
            text_width,
            noise_schedule,
            text_dropout: arguments.cond_mask_prob,
            mask_frames: arguments.mask_frames,
            use_ema: arguments.use_ema,
            window,
            sampling: arguments.sampling,
        };
        let rows = config.position_rows();
        if arguments.pos_embed_max_len < rows {
            return Err(format!(
                "pos_embed_max_len must be at least {rows}, the positions of the longest motion; found {}",
                arguments.pos_embed_max_len
            ));
        }
        if arguments.pos_embed_max_len < timesteps {
            return Err(format!(
                "pos_embed_max_len must be at least diffusion_steps ({timesteps}), found {}",
                arguments.pos_embed_max_len
            ));
        }
        Ok(config)
    }

    /// Returns the content of an `args.json`, as far as it concerns the network. The sizes that an `args.json` does not state
    /// are left out (see [`with_sizes_of`](Self::with_sizes_of)).
    pub fn to_json(&self) -> Vec<u8> {
        serde_json::to_vec_pretty(&self.arguments()).expect("options are JSON")
    }

    fn arguments(&self) -> Arguments {
        let defaults = Arguments::default();
        let (noise_schedule, diffusion_steps) = match self.noise_schedule {
            NoiseSchedule::Linear { timesteps } => ("linear", timesteps),
            NoiseSchedule::Cosine { timesteps } => ("cosine", timesteps),
        };
        Arguments {
            arch: match self.arch {
                MdmArchitecture::Encoder => "trans_enc".into(),
                MdmArchitecture::Decoder => "trans_dec".into(),
            },
            text_encoder_type: match self.text_encoder_type {
                TextEncoderKind::Clip => "clip".into(),
                TextEncoderKind::Bert => "bert".into(),
            },
            layers: self.layers,
            latent_dim: self.latent_dim,
            cond_mask_prob: self.text_dropout,
            mask_frames: self.mask_frames,
            use_ema: self.use_ema,
            pos_embed_max_len: defaults.pos_embed_max_len.max(diffusion_steps),
            noise_schedule: noise_schedule.into(),
            diffusion_steps,
            context_len: self.window.map_or(0, |window| window.prefix),
            pred_len: self.window.map_or(0, |window| window.frames),
            sampling: self.sampling.clone(),
            ..defaults
        }
    }

    /// Checks what an `args.json` states. Returns a description of the problem if there is no network of these sizes.
    pub fn problem(&self) -> Option<String> {
        Self::from_arguments(self.arguments()).err()
    }

    /// Opens the weights: their average if [`use_ema`](Self::use_ema) is set and the file has it, otherwise the weights
    /// themselves. The constant tables of positions in the file are left alone.
    ///
    /// # Errors
    ///
    /// If the file cannot be read or is not a checkpoint.
    pub fn open_weights(&self, path: impl AsRef<Path>) -> Result<Checkpoint, CheckpointError> {
        let parts: &[&str] = match self.use_ema {
            true => &["model_avg", "model"],
            false => &["model"],
        };
        let mut checkpoint = Checkpoint::open_first_part(path, parts)?;
        checkpoint.retain(|key| !key.ends_with("sequence_pos_encoder.pe"));
        Ok(checkpoint)
    }

    /// Returns this config with the sizes that `args.json` does not state, from the shapes of the weights: the number of
    /// features and the widths of text and feed-forward layers.
    ///
    /// # Errors
    ///
    /// If the tensors that show these sizes are missing or are not matrices.
    pub fn with_sizes_of(self, weights: &Checkpoint) -> Result<Self, CheckpointError> {
        let [_, features] = weights.matrix_shape("input_process.poseEmbedding.weight")?;
        let [_, text_width] = weights.matrix_shape("embed_text.weight")?;
        let [ff_size, _] =
            weights.matrix_shape(&format!("{}.0.linear1.weight", self.layers_key()))?;
        Ok(MdmConfig {
            features,
            text_width,
            ff_size,
            ..self
        })
    }

    /// Returns the key under which the layers lie in a checkpoint.
    pub(super) fn layers_key(&self) -> &'static str {
        match self.arch {
            MdmArchitecture::Encoder => "seqTransEncoder.layers",
            MdmArchitecture::Decoder => "seqTransDecoder.layers",
        }
    }

    /// Returns the length of the longest motion of one evaluation, in frames, without a prefix.
    pub(super) fn frames(&self) -> usize {
        self.window.map_or(MAX_CLIP_FRAMES, |window| window.frames)
    }

    /// Returns the number of positions of an evaluation: the token of the encoder or the prefix, and the frames.
    pub(super) fn position_rows(&self) -> usize {
        let before = match self.arch {
            MdmArchitecture::Encoder => 1,
            MdmArchitecture::Decoder => self.window.map_or(0, |window| window.prefix),
        };
        before + self.frames()
    }
}

/// Describes a value of `args.json` that this crate has no network for.
fn expected(key: &str, expected: &str, found: &str) -> String {
    format!("{key}: expected {expected}, found {found}")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(json: &str) -> Result<MdmConfig, String> {
        let config = MdmConfig::from_json(json.as_bytes(), "folder/args.json");
        config.map_err(|error| error.to_string())
    }

    #[test]
    fn missing_keys_mean_the_paper_s_network() {
        let config = parse("{}").unwrap();
        assert_eq!(
            (config.arch, config.text_encoder_type),
            (MdmArchitecture::Encoder, TextEncoderKind::Clip)
        );
        let schedule = NoiseSchedule::Cosine { timesteps: 1000 };
        assert_eq!((config.noise_schedule, config.layers), (schedule, 8));
        assert!(config.text_dropout == 0.1 && config.window.is_none());
        assert_eq!(config.position_rows(), 197);
    }

    #[test]
    fn options_of_the_training_are_ignored_and_dip_has_windows() {
        let json = r#"{"arch": "trans_dec", "text_encoder_type": "bert", "diffusion_steps": 10, "context_len": 20,
            "pred_len": 40, "lambda_vel": 0.0, "gen_during_training": true, "keyframe_x": null, "cond_mask_prob": 0}"#;
        let config = parse(json).unwrap();
        let window = MotionWindow {
            prefix: 20,
            frames: 40,
        };
        assert_eq!(config.window, Some(window));
        assert_eq!((config.text_width, config.position_rows()), (768, 60));
        assert_eq!(config.text_dropout, 0.0);
    }

    #[test]
    fn what_is_written_is_read_again() {
        let config = MdmConfig {
            latent_dim: 64,
            layers: 3,
            text_dropout: 0.2,
            mask_frames: true,
            noise_schedule: NoiseSchedule::Linear { timesteps: 6000 },
            sampling: Some(SamplingDefaults {
                text_scale: Some(2.0),
                ..SamplingDefaults::default()
            }),
            ..MdmConfig::default()
        };
        let decoder = MdmConfig {
            arch: MdmArchitecture::Decoder,
            text_encoder_type: TextEncoderKind::Bert,
            text_width: 768,
            window: Some(MotionWindow {
                prefix: 20,
                frames: 40,
            }),
            use_ema: true,
            ..MdmConfig::default()
        };
        for config in [config, decoder, MdmConfig::default()] {
            let json = config.to_json();
            assert_eq!(MdmConfig::from_json(&json, "args.json").unwrap(), config);
        }
    }

    #[test]
    fn networks_that_are_not_here_are_named() {
        for (json, parts) in [
            (r#"{"arch": "gru"}"#, ["arch", "found gru"]),
            (
                r#"{"text_encoder_type": "t5"}"#,
                ["text_encoder_type", "t5"],
            ),
            (
                r#"{"text_encoder_type": "bert"}"#,
                ["trans_dec", "trans_enc"],
            ),
            (r#"{"unconstrained": true}"#, ["unconstrained", "true"]),
            (r#"{"dataset": "humanact12"}"#, ["dataset", "humanact12"]),
            (r#"{"emb_policy": "concat"}"#, ["emb_policy", "concat"]),
            (r#"{"latent_dim": 30}"#, ["latent_dim", "30"]),
            (r#"{"layers": 0}"#, ["layers", "found 0"]),
            (r#"{"diffusion_steps": 0}"#, ["diffusion_steps", "found 0"]),
            (
                r#"{"pos_embed_max_len": 100}"#,
                ["pos_embed_max_len", "197"],
            ),
            (r#"{"pred_len": 40}"#, ["pred_len", "trans_enc"]),
            (r#"[1]"#, ["not a model config", "args.json"]),
        ] {
            let message = parse(json).unwrap_err();
            assert!(message.contains("folder/args.json"), "{message}");
            assert!(parts.iter().all(|part| message.contains(part)), "{message}");
        }
    }
}
