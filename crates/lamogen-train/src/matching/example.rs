//! An evaluator's training examples as tensors.

use burn::tensor::{Device, Tensor, TensorData};
use lamogen_data::Dataset;
use lamogen_eval::{EvaluatorConfig, TextBatch};
use lamogen_model::Tokens;

use super::pairs::Pair;
use crate::tokens::CaptionTokens;

/// A batch of texts and the motions that belong to them, in the same order.
pub(super) struct MatchingExamples {
    pub(super) texts: TextBatch,
    /// The motions `[pairs, frames, features without foot contacts]`, normalised.
    pub(super) features: Tensor<3>,
    /// The length of each motion in frames.
    pub(super) lengths: Vec<usize>,
}

impl MatchingExamples {
    /// Loads the captions and the motions of some pairs.
    pub(super) fn new(
        dataset: &Dataset,
        tokens: &CaptionTokens,
        pairs: &[Pair],
        device: &Device,
    ) -> Self {
        let all = dataset.mean().len();
        let kept = all - EvaluatorConfig::CONTACTS;
        let lengths: Vec<usize> = pairs.iter().map(|pair| pair.frames.len()).collect();
        let frames = lengths.iter().copied().max().expect("at least one pair");
        let mut numbers = vec![0.0; pairs.len() * frames * kept];
        let mut rows = Vec::new();
        for (pair, out) in pairs.iter().zip(numbers.chunks_exact_mut(frames * kept)) {
            rows.clear();
            let entry = &dataset.entries()[pair.entry];
            dataset.normalized(entry, pair.frames.clone(), &mut rows);
            for (row, out) in rows.chunks_exact(all).zip(out.chunks_exact_mut(kept)) {
                out.copy_from_slice(&row[..kept]);
            }
        }
        let texts: Vec<Tokens> = { pairs.iter() }
            .map(|pair| {
                let ids = tokens.original(pair.entry, pair.caption);
                Tokens {
                    ids: ids.iter().map(|&id| id as u32).collect(),
                    length: ids.len(),
                    cut: 0,
                    own: 0,
                }
            })
            .collect();
        let shape = [pairs.len(), frames, kept];
        MatchingExamples {
            texts: TextBatch::tokens(&texts, device),
            features: Tensor::from_data(TensorData::new(numbers, shape), device),
            lengths,
        }
    }
}
