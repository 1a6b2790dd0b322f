//! Words or tokens as a point in the common space.

use burn::module::{Initializer, Module};
use burn::nn::{Embedding, EmbeddingConfig, Linear};
use burn::tensor::{Device, Tensor};
use lamogen_model::{Keyed, Keys};

use super::gru::BiGru;
use super::linear;
use super::projection::Projection;
use crate::{EvaluatorConfig, TextBatch, TextForm};

/// A recurrent network over words or tokens.
#[derive(Module, Debug)]
pub(crate) struct TextEncoder {
    reading: Reading,
    input: Linear,
    recurrent: BiGru,
    output: Projection,
}

/// How a text becomes one vector a word or token.
#[derive(Module, Debug)]
enum Reading {
    /// The word's vector, plus one for its part of speech.
    Words(Linear),
    /// A learned vector.
    Tokens(Embedding),
}

impl TextEncoder {
    pub(crate) fn new(config: &EvaluatorConfig, device: &Device) -> Self {
        let (hidden, width) = (config.dim_text_hidden, config.text.dim_word());
        TextEncoder {
            reading: Reading::new(&config.text, device),
            input: linear(width, hidden, device),
            recurrent: BiGru::new(hidden, hidden, device),
            output: Projection::new(hidden, config.dim_coemb_hidden, device),
        }
    }

    /// # Shapes
    ///
    /// - output: `[batch, dim_coemb_hidden]`
    pub(crate) fn forward(&self, texts: &TextBatch) -> Tensor<2> {
        let read = self.reading.forward(texts);
        let states = self
            .recurrent
            .last(self.input.forward(read), texts.lengths());
        self.output.forward(states)
    }
}

impl Reading {
    fn new(form: &TextForm, device: &Device) -> Self {
        match *form {
            TextForm::Words {
                dim_word,
                dim_pos_ohot,
            } => Reading::Words(linear(dim_pos_ohot, dim_word, device)),
            TextForm::Tokens {
                vocab_size,
                dim_word,
                ..
            } => {
                // As PyTorch starts an embedding.
                let standard = Initializer::Normal {
                    mean: 0.0,
                    std: 1.0,
                };
                let config = EmbeddingConfig::new(vocab_size, dim_word).with_initializer(standard);
                Reading::Tokens(config.init(device))
            }
        }
    }

    /// # Shapes
    ///
    /// - output: `[batch, words or tokens, dim_word]`
    fn forward(&self, texts: &TextBatch) -> Tensor<3> {
        match (self, texts) {
            (
                Reading::Words(parts),
                TextBatch::Words {
                    vectors,
                    parts_of_speech,
                    ..
                },
            ) => vectors.clone() + parts.forward(parts_of_speech.clone()),
            (Reading::Tokens(embedding), TextBatch::Tokens { ids, .. }) => {
                embedding.forward(ids.clone())
            }
            (Reading::Words(_), TextBatch::Tokens { .. }) => {
                panic!("expected words with parts of speech, found tokens")
            }
            (Reading::Tokens(_), TextBatch::Words { .. }) => {
                panic!("expected tokens, found words with parts of speech")
            }
        }
    }
}

impl Keyed for TextEncoder {
    fn keys(&mut self, keys: &mut Keys) {
        match &mut self.reading {
            Reading::Words(parts) => keys.linear("pos_emb", parts),
            Reading::Tokens(embedding) => keys.embedding("token_emb", embedding),
        }
        keys.linear("input_emb", &mut self.input);
        keys.flat(&mut self.recurrent);
        keys.nested("output_net", &mut self.output);
    }
}
