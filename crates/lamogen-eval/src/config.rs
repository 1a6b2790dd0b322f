//! Sizes of an evaluator, as its `config.json` states them.

use std::path::Path;

use lamogen_motion::placeholder;
use serde::{Deserialize, Serialize};

use crate::EvaluatorNetworkError;
use crate::vocabulary::PartOfSpeech;

/// Sizes of the text-motion matching network. The names are those of the public code's options.
///
/// ```
/// use lamogen_eval::EvaluatorConfig;
///
/// let config = EvaluatorConfig::default();
/// let json = serde_json::to_string(&config).unwrap();
/// assert_eq!(EvaluatorConfig::from_json(json.as_bytes(), "config.json").unwrap(), config);
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EvaluatorConfig {
    /// Pose features a frame. The network reads all but the last [`CONTACTS`](Self::CONTACTS).
    pub dim_pose: usize,
    /// The longest motion, in frames. What is shorter is followed by zeros, which the convolutions see.
    pub max_motion_length: usize,
    /// Channels between the two convolutions over frames.
    pub dim_movement_enc_hidden: usize,
    /// Width of a movement, which is [`FRAMES_PER_MOVEMENT`](Self::FRAMES_PER_MOVEMENT) frames.
    pub dim_movement_latent: usize,
    /// Width of the recurrent network over movements, in each direction.
    pub dim_motion_hidden: usize,
    /// Width of the recurrent network over words, in each direction.
    pub dim_text_hidden: usize,
    /// Width of the space that texts and motions share.
    pub dim_coemb_hidden: usize,
    /// What the text side reads.
    pub text: TextForm,
}

/// What the text side of an evaluator reads.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase", deny_unknown_fields)]
pub enum TextForm {
    /// Vectors of words and their parts of speech (Guo et al. 2022).
    Words {
        /// Width of a word's vector.
        dim_word: usize,
        /// Number of parts of speech.
        dim_pos_ohot: usize,
    },
    /// Ids of a tokenizer, whose vectors are learned.
    Tokens {
        /// Number of token ids.
        vocab_size: usize,
        /// The longest text, in tokens with its start and end. Longer ones are cut.
        context_length: usize,
        /// Width of a token's vector.
        dim_word: usize,
    },
}

impl TextForm {
    /// Width of the vector that stands for a word or token.
    pub fn dim_word(&self) -> usize {
        match *self {
            TextForm::Words { dim_word, .. } | TextForm::Tokens { dim_word, .. } => dim_word,
        }
    }
}

/// The sizes of the public network for HumanML3D.
impl Default for EvaluatorConfig {
    fn default() -> Self {
        EvaluatorConfig {
            dim_pose: 263,
            max_motion_length: 196,
            dim_movement_enc_hidden: 512,
            dim_movement_latent: 512,
            dim_motion_hidden: 1024,
            dim_text_hidden: 512,
            dim_coemb_hidden: 512,
            text: TextForm::Words {
                dim_word: 300,
                dim_pos_ohot: PartOfSpeech::ALL.len(),
            },
        }
    }
}

impl EvaluatorConfig {
    /// Foot contacts, the last of the pose features: motions are not judged by them.
    pub const CONTACTS: usize = 4;

    /// Frames that the two convolutions, each with stride 2, make one movement of.
    pub const FRAMES_PER_MOVEMENT: usize = 4;

    /// Pose features that the network reads.
    pub fn movement_features(&self) -> usize {
        self.dim_pose - Self::CONTACTS
    }

    /// Reads a `config.json`.
    ///
    /// # Errors
    ///
    /// If the file cannot be read, is not such a config, or its sizes make no network.
    pub fn from_file(path: impl AsRef<Path>) -> Result<Self, EvaluatorNetworkError> {
        let path = path.as_ref();
        let bytes = std::fs::read(path).map_err(|reason| EvaluatorNetworkError::Io {
            path: path.to_owned(),
            reason,
        })?;
        Self::from_json(&bytes, path)
    }

    /// As [`from_file`](Self::from_file), from the file's content; `name` stands in error messages.
    ///
    /// # Errors
    ///
    /// If the content is not such a config, or its sizes make no network.
    pub fn from_json(json: &[u8], name: impl AsRef<Path>) -> Result<Self, EvaluatorNetworkError> {
        let path = name.as_ref();
        if let Some(problem) = placeholder(json) {
            return Err(EvaluatorNetworkError::Sizes {
                path: path.to_owned(),
                problem: problem.to_owned(),
            });
        }
        let config: Self =
            serde_json::from_slice(json).map_err(|reason| EvaluatorNetworkError::Config {
                path: path.to_owned(),
                reason,
            })?;
        match config.problem() {
            None => Ok(config),
            Some(problem) => Err(EvaluatorNetworkError::Sizes {
                path: path.to_owned(),
                problem,
            }),
        }
    }

    /// What keeps these sizes from making a network, if anything does.
    pub fn problem(&self) -> Option<String> {
        let mut sizes = vec![
            ("dim_movement_enc_hidden", self.dim_movement_enc_hidden, 1),
            ("dim_movement_latent", self.dim_movement_latent, 1),
            ("dim_motion_hidden", self.dim_motion_hidden, 1),
            ("dim_text_hidden", self.dim_text_hidden, 1),
            ("dim_coemb_hidden", self.dim_coemb_hidden, 1),
            ("dim_pose", self.dim_pose, Self::CONTACTS + 1),
            (
                "max_motion_length",
                self.max_motion_length,
                Self::FRAMES_PER_MOVEMENT,
            ),
            ("text.dim_word", self.text.dim_word(), 1),
        ];
        match self.text {
            TextForm::Words { dim_pos_ohot, .. } => {
                sizes.push(("text.dim_pos_ohot", dim_pos_ohot, 1));
            }
            TextForm::Tokens {
                vocab_size,
                context_length,
                ..
            } => sizes.extend([
                ("text.vocab_size", vocab_size, 1),
                // Start, a token, end.
                ("text.context_length", context_length, 3),
            ]),
        }
        let small = sizes.into_iter().find(|(_, size, least)| size < least);
        small.map(|(name, size, least)| {
            format!("expected `{name}` to be at least {least}, found {size}")
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_config_that_makes_no_network_is_refused_with_its_name() {
        let config = EvaluatorConfig {
            dim_pose: 4,
            ..EvaluatorConfig::default()
        };
        let json = serde_json::to_vec(&config).unwrap();
        let error = EvaluatorConfig::from_json(&json, "a/config.json").unwrap_err();
        assert_eq!(
            error.to_string(),
            "a/config.json: expected `dim_pose` to be at least 5, found 4"
        );
    }
}
