//! Batches of texts for the text encoder.

use burn::tensor::{Device, Int, Tensor, TensorData};
use lamogen_model::Tokens;

/// A batch of texts, padded to one length. The padding does not change a text's embedding.
#[derive(Clone, Debug)]
// There is one value per batch, and few of them are in memory at a time.
#[allow(clippy::large_enum_variant)]
pub enum TextBatch {
    /// Words, for networks that read words; see [`Vocabulary::batch`](crate::Vocabulary::batch).
    Words {
        /// The vectors of the words, `[batch, words, dim_word]`.
        vectors: Tensor<3>,
        /// The parts of speech, one-hot, `[batch, words, dim_pos_ohot]`: 1 at the word's part of speech, 0 elsewhere.
        parts_of_speech: Tensor<3>,
        /// The number of words of each text, at least 1.
        lengths: Vec<usize>,
    },
    /// Tokens, for networks that read tokens.
    Tokens {
        /// The ids of the tokens, `[batch, tokens]`.
        ids: Tensor<2, Int>,
        /// The number of tokens of each text, at least 1.
        lengths: Vec<usize>,
    },
}

impl TextBatch {
    /// Returns a batch of texts that a tokenizer encoded. A text ends with the first of its tokens that has the largest
    /// id, because that is the end token of lamogen's tokenizers.
    ///
    /// # Panics
    ///
    /// If there is no text, or the texts are padded to different lengths or to length 0.
    pub fn tokens(texts: &[Tokens], device: &Device) -> TextBatch {
        let length = texts.first().map_or(0, |text| text.ids.len());
        assert!(length > 0, "expected texts of at least one token");
        let mut ids = Vec::with_capacity(texts.len() * length);
        let mut lengths = Vec::with_capacity(texts.len());
        for text in texts {
            assert_eq!(
                text.ids.len(),
                length,
                "the texts of a batch are padded to one length"
            );
            let end = text.ids.iter().max().expect("at least one token");
            let before = text.ids.iter().take_while(|&id| id != end).count();
            lengths.push(before + 1);
            ids.extend(text.ids.iter().map(|&id| i64::from(id)));
        }
        let ids = TensorData::new(ids, [texts.len(), length]);
        TextBatch::Tokens {
            ids: Tensor::from_data(ids, device),
            lengths,
        }
    }

    /// Returns the number of words or tokens of each text.
    pub fn lengths(&self) -> &[usize] {
        match self {
            TextBatch::Words { lengths, .. } | TextBatch::Tokens { lengths, .. } => lengths,
        }
    }
}
