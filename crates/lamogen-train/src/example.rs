//! A batch as tensors.

use burn::tensor::{Device, Int, Tensor, TensorData};
use lamogen_data::Dataset;
use lamogen_guide::{Schedule, noise};
use lamogen_model::{FrameMask, TrainingBatch};
use rayon::prelude::*;

use crate::batches::Visit;
use crate::laban::TrainingLaban;
use crate::losses::Truth;
use crate::tokens::CaptionTokens;

/// A batch of motions with noise, and what is known of them.
pub(crate) struct Example {
    pub(crate) batch: TrainingBatch,
    pub(crate) truth: Truth,
}

impl Example {
    /// The batch that some visits make.
    pub(crate) fn new(
        dataset: &Dataset,
        tokens: &CaptionTokens,
        laban: Option<&TrainingLaban>,
        schedule: &Schedule,
        visits: &[Visit],
        device: &Device,
    ) -> Self {
        let features = dataset.mean().len();
        let lengths: Vec<usize> = visits.iter().map(|visit| visit.frames.len()).collect();
        let frames = lengths.iter().copied().max().expect("at least one motion");
        let shape = [visits.len(), frames, features];
        let size = frames * features;
        let (mut clean, mut noises) = (vec![0.0f32; visits.len() * size], Vec::new());
        noises.resize(clean.len(), 0.0f32);
        // Both on all threads: a batch has a million numbers and more.
        clean
            .par_chunks_mut(size)
            .zip(noises.par_chunks_mut(size))
            .zip(visits)
            .for_each(|((clean, noises), visit)| {
                let entry = &dataset.entries()[visit.motion];
                let mut rows = Vec::new();
                dataset.normalized(entry, visit.frames.clone(), &mut rows);
                clean[..rows.len()].copy_from_slice(&rows);
                let drawn = noise(visit.noise, visit.frames.len(), features);
                noises[..drawn.len()].copy_from_slice(&drawn);
            });
        let alphas: Vec<f32> = visits
            .iter()
            .map(|visit| schedule.alphas_cumprod()[visit.timestep] as f32)
            .collect();
        // Every caption once, however many visits have it.
        let mut rows: Vec<&[i32]> = Vec::new();
        let mut row = |ids| match rows.iter().position(|row| *row == ids) {
            Some(place) => place,
            None => {
                rows.push(ids);
                rows.len() - 1
            }
        };
        let captions = visits.iter();
        let captions = captions.map(|visit| {
            row(match visit.caption {
                Some(caption) => tokens.phrased(visit.entry, caption, visit.phrasing),
                None => tokens.empty(),
            })
        });
        let captions: Vec<usize> = captions.collect();
        let shape_of_ids = [rows.len(), rows[0].len()];
        let ids = rows.concat();
        let tensor = |numbers: Vec<f32>, shape: [usize; 3]| {
            Tensor::<3>::from_data(TensorData::new(numbers, shape), device)
        };
        let truth = Truth::new(
            tensor(clean, shape),
            tensor(noises, shape),
            tensor(alphas, [visits.len(), 1, 1]),
            FrameMask::new(&lengths, frames, device),
        );
        let ids = TensorData::new(ids, shape_of_ids);
        Example {
            batch: TrainingBatch {
                tokens: Tensor::<2, Int>::from_data(ids, device),
                captions,
                x_t: truth.noisy.clone(),
                timesteps: visits.iter().map(|visit| visit.timestep).collect(),
                mask: truth.mask.clone(),
                laban: laban.map(|laban| visits.iter().map(|visit| laban.told(visit)).collect()),
                sentences: None,
            },
            truth,
        }
    }
}
