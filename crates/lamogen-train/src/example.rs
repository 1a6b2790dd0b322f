//! A denoiser's training examples as tensors.

use burn::tensor::{Device, Int, Tensor, TensorData};
use lamogen_data::Dataset;
use lamogen_guide::{Schedule, noise};
use lamogen_model::{FrameMask, TrainingBatch};
use rayon::prelude::*;

use crate::batches::BatchItem;
use crate::laban::LabanLabels;
use crate::losses::NoisyMotions;
use crate::tokens::CaptionTokens;

/// A batch of noisy motions: the network's input, and the clean motions and noise from which targets follow.
pub(crate) struct DenoisingExamples {
    pub(crate) batch: TrainingBatch,
    pub(crate) motions: NoisyMotions,
}

impl DenoisingExamples {
    /// Loads the motions of some batch items and adds their noise.
    pub(crate) fn new(
        dataset: &Dataset,
        tokens: &CaptionTokens,
        laban: Option<&LabanLabels>,
        schedule: &Schedule,
        items: &[BatchItem],
        device: &Device,
    ) -> Self {
        let features = dataset.mean().len();
        let lengths: Vec<usize> = items.iter().map(|item| item.frames.len()).collect();
        let frames = lengths.iter().copied().max().expect("at least one motion");
        let shape = [items.len(), frames, features];
        let size = frames * features;
        let (mut clean, mut noises) = (vec![0.0f32; items.len() * size], Vec::new());
        noises.resize(clean.len(), 0.0f32);
        // Both in parallel: a batch has a million numbers and more.
        clean
            .par_chunks_mut(size)
            .zip(noises.par_chunks_mut(size))
            .zip(items)
            .for_each(|((clean, noises), item)| {
                let entry = &dataset.entries()[item.motion];
                let mut rows = Vec::new();
                dataset.normalized(entry, item.frames.clone(), &mut rows);
                clean[..rows.len()].copy_from_slice(&rows);
                let drawn = noise(item.noise, item.frames.len(), features);
                noises[..drawn.len()].copy_from_slice(&drawn);
            });
        let alphas: Vec<f32> = items
            .iter()
            .map(|item| schedule.alphas_cumprod()[item.timestep] as f32)
            .collect();
        // Each caption has one row, however many items have it.
        let mut rows: Vec<&[i32]> = Vec::new();
        let mut row_of = |ids| match rows.iter().position(|row| *row == ids) {
            Some(place) => place,
            None => {
                rows.push(ids);
                rows.len() - 1
            }
        };
        let captions = items.iter();
        let captions = captions.map(|item| {
            row_of(match item.caption {
                Some(caption) => tokens.phrasing(item.entry, caption, item.phrasing),
                None => tokens.empty(),
            })
        });
        let captions: Vec<usize> = captions.collect();
        let shape_of_ids = [rows.len(), rows[0].len()];
        let ids = rows.concat();
        let tensor = |numbers: Vec<f32>, shape: [usize; 3]| {
            Tensor::<3>::from_data(TensorData::new(numbers, shape), device)
        };
        let motions = NoisyMotions::new(
            tensor(clean, shape),
            tensor(noises, shape),
            tensor(alphas, [items.len(), 1, 1]),
            FrameMask::new(&lengths, frames, device),
        );
        let ids = TensorData::new(ids, shape_of_ids);
        DenoisingExamples {
            batch: TrainingBatch {
                tokens: Tensor::<2, Int>::from_data(ids, device),
                captions,
                is_without_text: items.iter().map(|item| item.caption.is_none()).collect(),
                x_t: motions.noisy.clone(),
                timesteps: items.iter().map(|item| item.timestep).collect(),
                mask: motions.mask.clone(),
                laban: laban.map(|laban| {
                    { items.iter() }
                        .map(|item| laban.condition_values(item))
                        .collect()
                }),
                sentences: None,
            },
            motions,
        }
    }
}
