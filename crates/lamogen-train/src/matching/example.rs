//! A batch as tensors.

use burn::tensor::{Device, Tensor, TensorData};
use lamogen_data::Dataset;
use lamogen_eval::{EvaluatorConfig, TextBatch};
use lamogen_model::{Tokenizer, TokenizerError, Tokens};

use super::pairs::Pair;

/// Every caption of every entry of a data set, as a tokenizer reads it.
pub(super) struct CaptionIds(Vec<Vec<Tokens>>);

impl CaptionIds {
    /// # Errors
    ///
    /// If a caption cannot be encoded.
    pub(super) fn new(dataset: &Dataset, tokenizer: &Tokenizer) -> Result<Self, TokenizerError> {
        let entries = dataset.entries().iter().map(|entry| {
            let captions = entry.captions.iter();
            captions.map(|caption| tokenizer.encode(&caption.text)).collect()
        });
        Ok(CaptionIds(entries.collect::<Result<_, _>>()?))
    }
}

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
        captions: &CaptionIds,
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
            .map(|pair| captions.0[pair.entry][pair.caption].clone())
            .collect();
        let shape = [pairs.len(), frames, read];
        Example {
            texts: TextBatch::tokens(&texts, device),
            features: Tensor::from_data(TensorData::new(numbers, shape), device),
            lengths,
        }
    }
}
