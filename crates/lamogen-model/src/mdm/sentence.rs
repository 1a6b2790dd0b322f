//! CLIP's embedding of a sentence.

use burn::module::Module;
use burn::nn::{Linear, LinearConfig};
use burn::tensor::{Device, Int, Tensor};

use crate::checkpoint::{NamedParameters, ParameterList};
use crate::config::ClipTextConfig;
use crate::network::clip::{ClipText, HuggingFaceClip};

/// CLIP's text tower with the projection into the space that texts share with images (`encode_text` of OpenAI's code).
#[derive(Module, Debug)]
pub(super) struct ClipSentence {
    tower: ClipText,
    projection: Linear,
}

impl ClipSentence {
    /// `output` is the width of the embedding.
    pub(super) fn new(config: &ClipTextConfig, output: usize, device: &Device) -> Self {
        let projection = LinearConfig::new(config.width, output).with_bias(false);
        ClipSentence {
            tower: ClipText::new(config, device),
            projection: projection.init(device),
        }
    }

    /// Embeds sentences: `[batch, tokens]` → `[batch, output]`. The end token is the largest id of each row.
    pub(super) fn forward(&self, tokens: Tensor<2, Int>) -> Tensor<2> {
        let features = self.tower.forward(tokens.clone());
        let [batch, _, width] = features.dims();
        let end = tokens.argmax(1).reshape([batch, 1, 1]).repeat_dim(2, width);
        let end = features.gather(1, end).reshape([batch, width]);
        self.projection.forward(end)
    }
}

/// The keys of OpenAI's files.
impl NamedParameters for ClipSentence {
    fn keys(&mut self, keys: &mut ParameterList) {
        keys.flat(&mut self.tower);
        keys.matrix("text_projection", &mut self.projection.weight);
    }
}

/// The same with the keys of Hugging Face's files.
pub(super) struct HuggingFaceSentence<'a>(pub(super) &'a mut ClipSentence);

impl NamedParameters for HuggingFaceSentence<'_> {
    fn keys(&mut self, keys: &mut ParameterList) {
        keys.nested("text_model", &mut HuggingFaceClip(&mut self.0.tower));
        keys.linear("text_projection", &mut self.0.projection);
    }
}
