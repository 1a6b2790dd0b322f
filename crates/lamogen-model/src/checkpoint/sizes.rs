//! The sizes of a network, read off the shapes of its tensors.

use super::{Checkpoint, CheckpointError};
use crate::config::{ClipTextConfig, ModelConfig, Prediction};

/// Channels of a head in CLIP's text towers, whatever their width (Radford et al. 2021, table 20).
const CLIP_HEAD: usize = 64;

impl Checkpoint {
    /// The sizes of the network, for a checkpoint without a config, such as MotionDiffuse's.
    ///
    /// Shapes do not tell everything. Taken as in [`ModelConfig::motion_diffuse`] are the numbers of
    /// heads (8 in the decoder, 4 in the text transformer) and that the network predicts noise; heads of
    /// the CLIP tower are 64 channels wide, as in every CLIP.
    ///
    /// # Errors
    ///
    /// If a tensor is missing whose shape is needed, or the sizes make no network.
    pub fn config(&self) -> Result<ModelConfig, CheckpointError> {
        let public = ModelConfig::motion_diffuse();
        let [latent_dim, input_feats] = self.matrix("joint_embed.weight")?;
        let [num_frames, _] = self.matrix("sequence_embedding")?;
        let [ff_size, _] = self.matrix("temporal_decoder_blocks.0.ffn.linear1.weight")?;
        let [_, text_latent_dim] = self.matrix("temporal_decoder_blocks.0.ca_block.key.weight")?;
        let num_text_layers = self.layers("textTransEncoder.layers");
        let text_ff_size = match num_text_layers {
            0 => public.text_ff_size,
            _ => self.matrix("textTransEncoder.layers.0.linear1.weight")?[0],
        };
        let [vocab_size, width] = self.matrix("clip.token_embedding.weight")?;
        let [context_length, _] = self.matrix("clip.positional_embedding")?;
        let config = ModelConfig {
            input_feats,
            num_frames,
            min_frames: None,
            latent_dim,
            ff_size,
            num_layers: self.layers("temporal_decoder_blocks"),
            num_heads: public.num_heads,
            text_latent_dim,
            text_ff_size,
            text_num_heads: public.text_num_heads,
            num_text_layers,
            clip: ClipTextConfig {
                vocab_size,
                context_length,
                width,
                heads: width.div_ceil(CLIP_HEAD),
                layers: self.layers("clip.transformer.resblocks"),
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

    fn matrix(&self, key: &str) -> Result<[usize; 2], CheckpointError> {
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

    /// How many layers are numbered under a name.
    fn layers(&self, name: &str) -> usize {
        let numbers = self.keys().into_iter().filter_map(|key| {
            let rest = key.strip_prefix(name)?.strip_prefix('.')?;
            rest.split('.').next()?.parse::<usize>().ok()
        });
        numbers.max().map_or(0, |last| last.saturating_add(1))
    }
}
