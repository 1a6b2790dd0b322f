//! The sizes of an evaluator network, as in its `config.json`.

use std::path::Path;

use lamogen_motion::placeholder;
use serde::{Deserialize, Serialize};

use crate::EvaluatorNetworkError;
use crate::vocabulary::PartOfSpeech;

/// The sizes of the text-motion matching network. The names are those of the public code's options.
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
    /// The number of pose features per frame. The network reads all but the last [`CONTACTS`](Self::CONTACTS).
    pub dim_pose: usize,
    /// The greatest length of a motion in frames. Shorter motions are padded with zeros, which the convolutions see.
    pub max_motion_length: usize,
    /// The number of channels between the two convolutions over frames.
    pub dim_movement_enc_hidden: usize,
    /// The width of a movement's vector. A movement is [`FRAMES_PER_MOVEMENT`](Self::FRAMES_PER_MOVEMENT) frames.
    pub dim_movement_latent: usize,
    /// The width of the recurrent network over movements, in each direction.
    pub dim_motion_hidden: usize,
    /// The width of the recurrent network over words or tokens, in each direction.
    pub dim_text_hidden: usize,
    /// The width of the space that texts and motions share.
    pub dim_coemb_hidden: usize,
    /// The form of the text encoder's input.
    pub text: TextForm,
}

/// The form of the input that an evaluator's text encoder reads.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase", deny_unknown_fields)]
pub enum TextForm {
    /// Word vectors and parts of speech (Guo et al. 2022).
    Words {
        /// The width of a word's vector.
        dim_word: usize,
        /// The number of parts of speech.
        dim_pos_ohot: usize,
    },
    /// Token ids of a tokenizer; the network learns a vector for each.
    Tokens {
        /// The number of token ids.
        vocab_size: usize,
        /// The greatest length of a text in tokens, including its start and its end. Longer texts are cut.
        context_length: usize,
        /// The width of a token's vector.
        dim_word: usize,
    },
}

impl TextForm {
    /// Returns the width of the vector of a word or a token.
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
    /// The number of foot contacts, which are the last pose features. The network does not read them.
    pub const CONTACTS: usize = 4;

    /// The number of frames that the two convolutions, each with stride 2, turn into one movement.
    pub const FRAMES_PER_MOVEMENT: usize = 4;

    /// Returns the number of pose features per frame that the network reads.
    pub fn movement_features(&self) -> usize {
        self.dim_pose - Self::CONTACTS
    }

    /// Reads a `config.json`.
    ///
    /// # Errors
    ///
    /// If the file cannot be read, is not an evaluator's config, or its sizes are not valid.
    pub fn from_file(path: impl AsRef<Path>) -> Result<Self, EvaluatorNetworkError> {
        let path = path.as_ref();
        let bytes = std::fs::read(path).map_err(|reason| EvaluatorNetworkError::Io {
            path: path.to_owned(),
            reason,
        })?;
        Self::from_json(&bytes, path)
    }

    /// Reads the content of a `config.json`, as [`from_file`](Self::from_file) does; `name` is the file's name in error
    /// messages.
    ///
    /// # Errors
    ///
    /// If the content is not an evaluator's config, or its sizes are not valid.
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

    /// Returns why the sizes are not valid, or `None` if they are.
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
                // The start, one token and the end.
                ("text.context_length", context_length, 3),
            ]),
        }
        let too_small = sizes.into_iter().find(|(_, size, least)| size < least);
        too_small.map(|(name, size, least)| {
            format!("expected `{name}` to be at least {least}, found {size}")
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_config_with_invalid_sizes_is_refused_with_its_name() {
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
