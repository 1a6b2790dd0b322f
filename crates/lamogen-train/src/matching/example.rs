//! A batch as tensors.

use burn::tensor::{Device, Tensor, TensorData};
use lamogen_data::Dataset;
use lamogen_eval::{EvaluatorConfig, TextBatch};
use lamogen_model::Tokens;

use super::pairs::Pair;
use crate::tokens::CaptionTokens;

/// Texts and motions, pair by pair.
pub(super) struct Example {
    pub(super) texts: TextBatch,
    /// `[pairs, frames, features without foot contacts]`, normalised.
    pub(super) features: Tensor<3>,
    /// Frames of each motion.
    pub(super) lengths: Vec<usize>,
}

impl Example {
    pub(super) fn new(
        dataset: &Dataset,
        tokens: &CaptionTokens,
        pairs: &[Pair],
        device: &Device,
    ) -> Self {
        let all = dataset.mean().len();
        let read = all - EvaluatorConfig::CONTACTS;
        let lengths: Vec<usize> = pairs.iter().map(|pair| pair.frames.len()).collect();
        let frames = lengths.iter().copied().max().expect("at least one pair");
        let mut numbers = vec![0.0; pairs.len() * frames * read];
        let mut rows = Vec::new();
        for (pair, out) in pairs.iter().zip(numbers.chunks_exact_mut(frames * read)) {
            rows.clear();
            let entry = &dataset.entries()[pair.entry];
            dataset.normalized(entry, pair.frames.clone(), &mut rows);
            for (row, out) in rows.chunks_exact(all).zip(out.chunks_exact_mut(read)) {
                out.copy_from_slice(&row[..read]);
            }
        }
        let texts: Vec<Tokens> = { pairs.iter() }
            .map(|pair| {
                let ids = tokens.of(pair.entry, pair.caption);
                Tokens {
                    ids: ids.iter().map(|&id| id as u32).collect(),
                    cut: 0,
                    own: 0,
                }
            })
            .collect();
        let shape = [pairs.len(), frames, read];
        Example {
            texts: TextBatch::tokens(&texts, device),
            features: Tensor::from_data(TensorData::new(numbers, shape), device),
            lengths,
        }
    }
}
