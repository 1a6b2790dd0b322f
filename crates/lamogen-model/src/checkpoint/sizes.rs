//! Derivation of the sizes of a network from the shapes of its tensors.

use super::{Checkpoint, CheckpointError};
use crate::config::{ClipTextConfig, ModelConfig, Prediction};

/// The number of channels of an attention head in CLIP's text towers of any width (Radford et al. 2021, table 20).
const CLIP_HEAD_WIDTH: usize = 64;

impl Checkpoint {
    /// Derives the sizes of the network from the tensors, for a checkpoint without a config, such as MotionDiffuse's.
    ///
    /// The shapes do not determine all values. The numbers of heads (8 in the decoder, 4 in the text transformer) and the
    /// prediction of noise are taken from [`ModelConfig::motion_diffuse`]. The heads of the CLIP tower have 64 channels, as
    /// in every CLIP.
    ///
    /// # Errors
    ///
    /// If a required tensor is missing or is not a matrix, or if the sizes do not form a valid network.
    pub fn config(&self) -> Result<ModelConfig, CheckpointError> {
        let defaults = ModelConfig::motion_diffuse();
        let [latent_dim, input_feats] = self.matrix_shape("joint_embed.weight")?;
        let [num_frames, _] = self.matrix_shape("sequence_embedding")?;
        let [ff_size, _] = self.matrix_shape("temporal_decoder_blocks.0.ffn.linear1.weight")?;
        let [_, text_latent_dim] =
            self.matrix_shape("temporal_decoder_blocks.0.ca_block.key.weight")?;
        let num_text_layers = self.layer_count("textTransEncoder.layers");
        let text_ff_size = match num_text_layers {
            0 => defaults.text_ff_size,
            _ => self.matrix_shape("textTransEncoder.layers.0.linear1.weight")?[0],
        };
        let [vocab_size, width] = self.matrix_shape("clip.token_embedding.weight")?;
        let [context_length, _] = self.matrix_shape("clip.positional_embedding")?;
        let config = ModelConfig {
            input_feats,
            num_frames,
            min_frames: None,
            latent_dim,
            ff_size,
            num_layers: self.layer_count("temporal_decoder_blocks"),
            num_heads: defaults.num_heads,
            text_latent_dim,
            text_ff_size,
            text_num_heads: defaults.text_num_heads,
            num_text_layers,
            clip: ClipTextConfig {
                vocab_size,
                context_length,
                width,
                heads: width.div_ceil(CLIP_HEAD_WIDTH),
                layers: self.layer_count("clip.transformer.resblocks"),
            },
            prediction: Prediction::Epsilon,
            laban_condition: None,
            sampling: None,
        };
        match config.problem() {
            None => Ok(config),
            Some(problem) => Err(CheckpointError::Sizes {
                path: self.path().to_owned(),
                problem,
            }),
        }
    }

    /// Returns the shape of a tensor that must be a matrix.
    pub(crate) fn matrix_shape(&self, key: &str) -> Result<[usize; 2], CheckpointError> {
        let problem = match self.shape(key) {
            Some(&[rows, columns]) => return Ok([rows, columns]),
            Some(shape) => format!("expected `{key}` to be a matrix, found the shape {shape:?}"),
            None => format!("there is no tensor `{key}`"),
        };
        Err(CheckpointError::Sizes {
            path: self.path().to_owned(),
            problem,
        })
    }

    /// Returns the number of layers whose keys begin with `name.0.`, `name.1.`, …
    pub(crate) fn layer_count(&self, name: &str) -> usize {
        let numbers = self.keys().into_iter().filter_map(|key| {
            let rest = key.strip_prefix(name)?.strip_prefix('.')?;
            rest.split('.').next()?.parse::<usize>().ok()
        });
        numbers.max().map_or(0, |last| last.saturating_add(1))
    }
}
