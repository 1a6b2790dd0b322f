//! Texts as the evaluator's text side takes them.

use burn::tensor::{Device, Int, Tensor, TensorData};
use lamogen_model::Tokens;

/// A batch of texts, padded to one length.
///
/// What stands past a text's own length plays no part.
#[derive(Clone, Debug)]
// One value a batch, which nobody keeps by the thousand.
#[allow(clippy::large_enum_variant)]
pub enum TextBatch {
    /// For networks that read words; see [`Vocabulary::batch`](crate::Vocabulary::batch).
    Words {
        /// `[batch, words, dim_word]`
        vectors: Tensor<3>,
        /// `[batch, words, dim_pos_ohot]`, 1 at the word's part of speech and else 0.
        parts_of_speech: Tensor<3>,
        /// Words of each text, at least 1.
        lengths: Vec<usize>,
    },
    /// For networks that read tokens.
    Tokens {
        /// `[batch, tokens]`
        ids: Tensor<2, Int>,
        /// Tokens of each text, at least 1.
        lengths: Vec<usize>,
    },
}

impl TextBatch {
    /// What a tokenizer makes of several texts. A text ends with its first token of the largest id, which is
    /// how lamogen's tokenizers end it.
    ///
    /// # Panics
    ///
    /// If there is no text, or they are padded to different lengths or to none.
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

    /// Words or tokens of each text.
    pub fn lengths(&self) -> &[usize] {
        match self {
            TextBatch::Words { lengths, .. } | TextBatch::Tokens { lengths, .. } => lengths,
        }
    }
}
