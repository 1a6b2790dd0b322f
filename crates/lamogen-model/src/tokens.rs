//! Batches of tokenized prompts.

use burn::tensor::{Device, Int, Tensor, TensorData};
use lamogen_tokenizer::Tokens;

/// A batch of tokenized prompts, the input of [`Denoiser::encode`](crate::Denoiser::encode).
#[derive(Clone, Debug)]
pub struct TokenBatch {
    /// The token ids, `[batch, tokens]`, padded with 0.
    pub ids: Tensor<2, Int>,
    /// The number of tokens of each prompt that are not padding, with its start and end tokens. The last of them is the
    /// end token.
    pub lengths: Vec<usize>,
}

impl TokenBatch {
    /// Joins prompts. Shorter rows are padded with 0 to the longest.
    pub fn new<'t>(prompts: impl IntoIterator<Item = &'t Tokens>, device: &Device) -> Self {
        let prompts: Vec<&Tokens> = prompts.into_iter().collect();
        let width = prompts.iter().map(|tokens| tokens.ids.len()).max();
        let width = width.unwrap_or(0);
        let ids = prompts.iter().flat_map(|tokens| {
            let padding = width - tokens.ids.len();
            let ids = tokens.ids.iter().map(|&id| id as i32);
            ids.chain(std::iter::repeat_n(0, padding))
        });
        let ids = TensorData::new(ids.collect(), [prompts.len(), width]);
        TokenBatch {
            ids: Tensor::from_data(ids, device),
            lengths: prompts.iter().map(|tokens| tokens.length).collect(),
        }
    }
}

/// Takes every id for a token of its prompt. This is right for text encoders that find the end of a text by its ids, such as
/// CLIP's text tower, and for prompts without padding.
impl From<Tensor<2, Int>> for TokenBatch {
    fn from(ids: Tensor<2, Int>) -> Self {
        let [batch, width] = ids.dims();
        TokenBatch {
            ids,
            lengths: vec![width; batch],
        }
    }
}
