//! The text encoders of MDM, and the files that hold them.

use std::collections::HashMap;
use std::path::Path;

use burn::module::Module;
use burn::tensor::{Device, Tensor};
use serde::Serialize;

use super::config::TextEncoderKind;
use super::distilbert::{DistilBert, DistilBertConfig, HEAD_WIDTH};
use super::sentence::{ClipSentence, HuggingFaceSentence};
use crate::checkpoint::{Checkpoint, CheckpointError, NamedParameters, ParameterList, Precision};
use crate::config::ClipTextConfig;
use crate::tokens::TokenBatch;

/// The frozen network that reads the text. It is not part of MDM's checkpoints.
#[derive(Module, Debug)]
pub struct MdmText {
    encoder: TextEncoder,
    #[module(skip)]
    config: MdmTextConfig,
}

/// The sizes of a text encoder.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(untagged)]
pub enum MdmTextConfig {
    /// The text tower of a CLIP.
    Clip {
        /// The sizes of the tower.
        #[serde(flatten)]
        tower: ClipTextConfig,
        /// The width of the sentence embedding.
        output: usize,
    },
    /// A DistilBERT.
    DistilBert(DistilBertConfig),
}

#[derive(Module, Debug)]
#[allow(clippy::large_enum_variant)]
enum TextEncoder {
    Clip(ClipSentence),
    DistilBert(DistilBert),
}

/// The features of a batch of texts.
pub(super) struct TextFeatures {
    /// `[batch, tokens, width]`: a token for each word piece, or one for the whole sentence.
    pub(super) tokens: Tensor<3>,
    /// A large number for tokens that are padding, else 0, `[batch, 1, 1, tokens]`. `None` if there is no padding.
    pub(super) penalty: Option<Tensor<4>>,
}

impl MdmText {
    /// Creates a text encoder with random weights.
    pub fn new(config: &MdmTextConfig, device: &Device) -> Self {
        let encoder = match config {
            MdmTextConfig::Clip { tower, output } => {
                TextEncoder::Clip(ClipSentence::new(tower, *output, device))
            }
            MdmTextConfig::DistilBert(config) => {
                TextEncoder::DistilBert(DistilBert::new(config, device))
            }
        };
        MdmText {
            encoder,
            config: config.clone(),
        }
    }

    /// Returns the sizes.
    pub fn config(&self) -> &MdmTextConfig {
        &self.config
    }

    /// Loads the text tower of a CLIP.
    ///
    /// The file is a state dict of OpenAI's code or of Hugging Face's `transformers`, in safetensors or written by
    /// `torch.save`, or MotionDiffuse's `latest.tar`, which has the tower inside. The image tower is not read.
    ///
    /// # Errors
    ///
    /// If the file cannot be read, has no text tower or no `text_projection`, or is damaged.
    pub fn clip(path: impl AsRef<Path>, device: &Device) -> Result<Self, CheckpointError> {
        let checkpoint = Checkpoint::open_any(path)?;
        let form = ClipForm::of(&checkpoint)?;
        let config = form.config(&checkpoint)?;
        let mut text = MdmText::new(&config, device);
        let TextEncoder::Clip(sentence) = &mut text.encoder else {
            unreachable!("the config is that of a CLIP");
        };
        let prefix = &form.prefix;
        match form.is_hugging_face {
            true => checkpoint.fill_part(&mut Part(prefix, HuggingFaceSentence(sentence)), device),
            false => checkpoint.fill_part(&mut Part(prefix, Borrowed(sentence)), device),
        }?;
        Ok(text)
    }

    /// Loads a DistilBERT, such as the `model.safetensors` of `distilbert-base-uncased`. The head that guesses words is not
    /// read.
    ///
    /// # Errors
    ///
    /// If the file cannot be read, is damaged, or is not a DistilBERT.
    pub fn distilbert(path: impl AsRef<Path>, device: &Device) -> Result<Self, CheckpointError> {
        let checkpoint = Checkpoint::open_any(path)?;
        const WORDS: &str = "embeddings.word_embeddings.weight";
        let prefix = prefix_of(&checkpoint, WORDS).unwrap_or_default();
        let key = |name: &str| format!("{prefix}{name}");
        let [vocab_size, width] = checkpoint.matrix_shape(&key(WORDS))?;
        let [positions, _] =
            checkpoint.matrix_shape(&key("embeddings.position_embeddings.weight"))?;
        let [ff_size, _] = checkpoint.matrix_shape(&key("transformer.layer.0.ffn.lin1.weight"))?;
        let config = DistilBertConfig {
            vocab_size,
            positions,
            width,
            heads: width.div_ceil(HEAD_WIDTH),
            layers: checkpoint.layer_count(&key("transformer.layer")),
            ff_size,
        };
        let mut text = MdmText::new(&MdmTextConfig::DistilBert(config), device);
        let TextEncoder::DistilBert(network) = &mut text.encoder else {
            unreachable!("the config is that of a DistilBERT");
        };
        checkpoint.fill_part(&mut Part(&prefix, Borrowed(network)), device)?;
        Ok(text)
    }

    /// Writes the weights as safetensors: a CLIP's text tower under the keys of OpenAI's code, a DistilBERT under those of
    /// Hugging Face's.
    ///
    /// `metadata` is free text that is stored with the weights, such as `license`. The file is written whole or not at all.
    ///
    /// # Errors
    ///
    /// If the file cannot be written, or if a weight is beyond the range of 16 bits and `precision` requires 16 bits.
    pub fn save(
        &self,
        path: impl AsRef<Path>,
        precision: Precision,
        metadata: HashMap<String, String>,
    ) -> Result<(), CheckpointError> {
        match &self.encoder {
            TextEncoder::Clip(sentence) => Checkpoint::write(sentence, path, precision, metadata),
            TextEncoder::DistilBert(network) => {
                Checkpoint::write(network, path, precision, metadata)
            }
        }
    }

    /// Returns which kind of network this is.
    pub fn kind(&self) -> TextEncoderKind {
        match self.config {
            MdmTextConfig::Clip { .. } => TextEncoderKind::Clip,
            MdmTextConfig::DistilBert(_) => TextEncoderKind::Bert,
        }
    }

    /// Returns the width of its features.
    pub fn width(&self) -> usize {
        match &self.config {
            MdmTextConfig::Clip { output, .. } => *output,
            MdmTextConfig::DistilBert(config) => config.width,
        }
    }

    /// Returns the number of embeddings of token ids.
    pub fn vocab_size(&self) -> usize {
        match &self.config {
            MdmTextConfig::Clip { tower, .. } => tower.vocab_size,
            MdmTextConfig::DistilBert(config) => config.vocab_size,
        }
    }

    /// Returns the number of positions, which is that of the tokens of the longest text.
    pub fn positions(&self) -> usize {
        match &self.config {
            MdmTextConfig::Clip { tower, .. } => tower.context_length,
            MdmTextConfig::DistilBert(config) => config.positions,
        }
    }

    /// Computes the features of texts.
    pub(super) fn forward(&self, tokens: &TokenBatch) -> TextFeatures {
        match &self.encoder {
            TextEncoder::Clip(sentence) => TextFeatures {
                tokens: sentence.forward(tokens.ids.clone()).unsqueeze_dim(1),
                penalty: None,
            },
            TextEncoder::DistilBert(network) => {
                let penalty = padding_penalty(tokens);
                TextFeatures {
                    tokens: network.forward(tokens.ids.clone(), penalty.as_ref()),
                    penalty,
                }
            }
        }
    }
}

/// Returns what is subtracted from the scores of tokens that are padding, `[batch, 1, 1, tokens]`.
fn padding_penalty(tokens: &TokenBatch) -> Option<Tensor<4>> {
    /// Excludes a token from a softmax.
    const PENALTY: f32 = 1e6;
    let [batch, width] = tokens.ids.dims();
    if tokens.lengths.iter().all(|&length| length == width) {
        return None;
    }
    let rows = tokens.lengths.iter().flat_map(|&length| {
        (0..width).map(move |place| match place < length {
            true => 0.0,
            false => PENALTY,
        })
    });
    let rows: Vec<f32> = rows.collect();
    let rows = Tensor::<1>::from_floats(&rows[..], &tokens.ids.device());
    Some(rows.reshape([batch, 1, 1, width]))
}

/// Where the text tower lies in a file, and under whose names.
struct ClipForm {
    /// What stands before all keys, with its dot.
    prefix: String,
    is_hugging_face: bool,
}

impl ClipForm {
    fn of(checkpoint: &Checkpoint) -> Result<Self, CheckpointError> {
        let hugging_face = prefix_of(checkpoint, "text_model.embeddings.token_embedding.weight");
        if let Some(prefix) = hugging_face {
            return Ok(ClipForm {
                prefix,
                is_hugging_face: true,
            });
        }
        let prefix = prefix_of(checkpoint, "token_embedding.weight");
        let prefix = prefix.ok_or_else(|| CheckpointError::Format {
            path: checkpoint.path().to_owned(),
            problem: "expected the text tower of a CLIP, found no `token_embedding.weight`"
                .to_owned(),
        })?;
        Ok(ClipForm {
            prefix,
            is_hugging_face: false,
        })
    }

    fn config(&self, checkpoint: &Checkpoint) -> Result<MdmTextConfig, CheckpointError> {
        /// The number of channels of an attention head in CLIP's text towers of any width.
        const HEAD_WIDTH: usize = 64;
        let key = |openai: &str, hugging_face: &str| match self.is_hugging_face {
            true => format!("{}{hugging_face}", self.prefix),
            false => format!("{}{openai}", self.prefix),
        };
        let [vocab_size, width] = checkpoint.matrix_shape(&key(
            "token_embedding.weight",
            "text_model.embeddings.token_embedding.weight",
        ))?;
        let [context_length, _] = checkpoint.matrix_shape(&key(
            "positional_embedding",
            "text_model.embeddings.position_embedding.weight",
        ))?;
        let projection =
            checkpoint.matrix_shape(&key("text_projection", "text_projection.weight"))?;
        let output = match self.is_hugging_face {
            true => projection[0],
            false => projection[1],
        };
        Ok(MdmTextConfig::Clip {
            tower: ClipTextConfig {
                vocab_size,
                context_length,
                width,
                heads: width.div_ceil(HEAD_WIDTH),
                layers: checkpoint
                    .layer_count(&key("transformer.resblocks", "text_model.encoder.layers")),
            },
            output,
        })
    }
}

/// Returns what stands before a name in the key of the tensor that ends in it, or `None` if there is no such tensor.
fn prefix_of(checkpoint: &Checkpoint, name: &str) -> Option<String> {
    let keys = checkpoint.keys().into_iter();
    let prefixes = keys.filter_map(|key| key.strip_suffix(name).map(str::to_owned));
    { prefixes }
        .filter(|prefix| prefix.is_empty() || prefix.ends_with('.'))
        .min_by_key(String::len)
}

/// A network whose keys stand after a prefix, with its dot.
struct Part<'p, N>(&'p str, N);

impl<N: NamedParameters> NamedParameters for Part<'_, N> {
    fn keys(&mut self, keys: &mut ParameterList) {
        match self.0.strip_suffix('.') {
            Some(name) => keys.nested(name, &mut self.1),
            None => keys.flat(&mut self.1),
        }
    }
}

/// A network that is filled in place.
struct Borrowed<'n, N>(&'n mut N);

impl<N: NamedParameters> NamedParameters for Borrowed<'_, N> {
    fn keys(&mut self, keys: &mut ParameterList) {
        self.0.keys(keys);
    }
}
