//! How well a network knows motion that it has not seen.

use burn::tensor::{Device, Tensor};
use lamogen_data::{Dataset, Split};
use lamogen_guide::{Schedule, TRAINING_STEPS};
use lamogen_model::{Denoiser, MotionDiffuse};

use crate::batches::Visit;
use crate::example::Example;
use crate::tokens::CaptionTokens;

/// The same noisy motions every time: every motion of a split that is no mirror image, under its first caption, at the timesteps
/// 50, 150, …, 950, with noise that depends on the motion's place in the split and the timestep.
pub struct Validation<'a> {
    dataset: &'a Dataset,
    tokens: &'a CaptionTokens,
    device: Device,
    /// Motions of about the same length together; those of a batch share a timestep.
    batches: Vec<Vec<Visit>>,
}

impl<'a> Validation<'a> {
    /// The motions of a split that have a length the network is made for. `None` if there are none.
    pub fn new(
        dataset: &'a Dataset,
        tokens: &'a CaptionTokens,
        split: Split,
        lengths: std::ops::RangeInclusive<usize>,
        device: &Device,
    ) -> Option<Self> {
        /// Frames of a batch.
        const FRAMES: usize = 6400;
        let mut entries: Vec<(usize, usize)> = dataset
            .indices(split)
            .filter(|&entry| !dataset.entries()[entry].mirror)
            .enumerate()
            .filter(|&(_, entry)| lengths.contains(&dataset.entries()[entry].frames))
            .collect();
        entries.sort_by_key(|&(place, entry)| (dataset.entries()[entry].frames, place));
        let longest = dataset.entries()[entries.last()?.1].frames;
        let at_once = (FRAMES / longest).max(1);
        let batches = (50..TRAINING_STEPS).step_by(100).flat_map(|timestep| {
            let visit = move |&(place, entry): &(usize, usize)| Visit {
                entry,
                frames: 0..dataset.entries()[entry].frames,
                caption: 0,
                timestep,
                noise: (TRAINING_STEPS * place + timestep) as u64,
            };
            let batches = entries.chunks(at_once);
            batches.map(move |batch| batch.iter().map(visit).collect::<Vec<_>>())
        });
        Some(Validation {
            batches: batches.collect(),
            device: device.clone(),
            dataset,
            tokens,
        })
    }

    /// The mean squared error of the clean motion, normalised, over frames and features; averaged over motions and timesteps.
    ///
    /// Whatever the network predicts, the error is that of the clean motion its output speaks of, so that networks can be
    /// compared.
    pub fn loss(&self, network: &MotionDiffuse) -> f64 {
        let schedule = Schedule::linear();
        let mut errors = Vec::new();
        for visits in &self.batches {
            let Example { batch, truth } =
                Example::new(self.dataset, self.tokens, &schedule, visits, &self.device);
            let output = network.predict(batch);
            let clean = truth.clean_of(output, network.prediction());
            let mut squares = (clean - truth.clean.clone()).square();
            if let Some(keep) = truth.mask.keep() {
                squares = squares * keep;
            }
            let [count, _, features] = squares.dims();
            let sums: Tensor<2> = squares.sum_dim(2).sum_dim(1).reshape([count, 1]);
            let sums: Vec<f32> = sums.try_into_vec_as().expect("floats convert to f32");
            let lengths = truth.mask.lengths().iter();
            let means = sums.iter().zip(lengths);
            errors.extend(means.map(|(sum, frames)| f64::from(*sum) / (frames * features) as f64));
        }
        errors.iter().sum::<f64>() / errors.len() as f64
    }
}
