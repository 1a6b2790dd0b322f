//! The encoder from words or tokens to an embedding of the text.

use burn::module::{Initializer, Module};
use burn::nn::{Embedding, EmbeddingConfig, Linear};
use burn::tensor::{Device, Tensor};
use lamogen_model::{NamedParameters, ParameterList};

use super::gru::BiGru;
use super::linear;
use super::projection::Projection;
use crate::{EvaluatorConfig, TextBatch, TextForm};

/// The text encoder: a recurrent network over words or tokens.
#[derive(Module, Debug)]
pub(crate) struct TextEncoder {
    embedding: TextEmbedding,
    input: Linear,
    recurrent: BiGru,
    output: Projection,
}

/// The layer that gives one vector for each word or token.
#[derive(Module, Debug)]
enum TextEmbedding {
    /// The vector is the word's own plus a learned vector of its part of speech.
    Words(Linear),
    /// The vector of each token is learned.
    Tokens(Embedding),
}

impl TextEncoder {
    pub(crate) fn new(config: &EvaluatorConfig, device: &Device) -> Self {
        let (hidden, width) = (config.dim_text_hidden, config.text.dim_word());
        TextEncoder {
            embedding: TextEmbedding::new(&config.text, device),
            input: linear(width, hidden, device),
            recurrent: BiGru::new(hidden, hidden, device),
            output: Projection::new(hidden, config.dim_coemb_hidden, device),
        }
    }

    /// Embeds texts.
    ///
    /// # Shapes
    ///
    /// - output: `[batch, dim_coemb_hidden]`
    pub(crate) fn forward(&self, texts: &TextBatch) -> Tensor<2> {
        let vectors = self.embedding.forward(texts);
        let states = self
            .recurrent
            .final_states(self.input.forward(vectors), texts.lengths());
        self.output.forward(states)
    }
}

impl TextEmbedding {
    fn new(form: &TextForm, device: &Device) -> Self {
        match *form {
            TextForm::Words {
                dim_word,
                dim_pos_ohot,
            } => TextEmbedding::Words(linear(dim_pos_ohot, dim_word, device)),
            TextForm::Tokens {
                vocab_size,
                dim_word,
                ..
            } => {
                // These are PyTorch's initial weights of an embedding.
                let standard = Initializer::Normal {
                    mean: 0.0,
                    std: 1.0,
                };
                let config = EmbeddingConfig::new(vocab_size, dim_word).with_initializer(standard);
                TextEmbedding::Tokens(config.init(device))
            }
        }
    }

    /// Returns the vectors of the words or tokens.
    ///
    /// # Shapes
    ///
    /// - output: `[batch, words or tokens, dim_word]`
    ///
    /// # Panics
    ///
    /// If the texts are not in the form that the network reads.
    fn forward(&self, texts: &TextBatch) -> Tensor<3> {
        match (self, texts) {
            (
                TextEmbedding::Words(parts),
                TextBatch::Words {
                    vectors,
                    parts_of_speech,
                    ..
                },
            ) => vectors.clone() + parts.forward(parts_of_speech.clone()),
            (TextEmbedding::Tokens(embedding), TextBatch::Tokens { ids, .. }) => {
                embedding.forward(ids.clone())
            }
            (TextEmbedding::Words(_), TextBatch::Tokens { .. }) => {
                panic!("expected words with parts of speech, found tokens")
            }
            (TextEmbedding::Tokens(_), TextBatch::Words { .. }) => {
                panic!("expected tokens, found words with parts of speech")
            }
        }
    }
}

impl NamedParameters for TextEncoder {
    fn keys(&mut self, keys: &mut ParameterList) {
        match &mut self.embedding {
            TextEmbedding::Words(parts) => keys.linear("pos_emb", parts),
            TextEmbedding::Tokens(embedding) => keys.embedding("token_emb", embedding),
        }
        keys.linear("input_emb", &mut self.input);
        keys.flat(&mut self.recurrent);
        keys.nested("output_net", &mut self.output);
    }
}
