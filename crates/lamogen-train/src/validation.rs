//! How well a network knows motion that it has not seen.

use burn::tensor::{Device, Tensor};
use lamogen_data::{Dataset, Split};
use lamogen_guide::{Schedule, TRAINING_STEPS};
use lamogen_model::{Denoiser, LABAN_FEATURES, MotionDiffuse};

use crate::batches::Visit;
use crate::example::Example;
use crate::losses::Truth;
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
    /// The motions of a split that are as long as the network asks for; of longer ones the first frames. `None` if there are none.
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
            .filter(|&(_, entry)| dataset.entries()[entry].frames >= *lengths.start())
            .collect();
        entries.sort_by_key(|&(place, entry)| (dataset.entries()[entry].frames, place));
        let frames = |entry: usize| dataset.entries()[entry].frames.min(*lengths.end());
        let longest = frames(entries.last()?.1);
        let at_once = (FRAMES / longest).max(1);
        let batches = (50..TRAINING_STEPS).step_by(100).flat_map(|timestep| {
            let visit = move |&(place, entry): &(usize, usize)| Visit {
                entry,
                motion: entry,
                frames: 0..frames(entry),
                caption: Some(0),
                phrasing: 0,
                laban: [false; LABAN_FEATURES],
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
        self.mean(network, |output, truth| {
            truth.clean_of(output, network.prediction()) - truth.clean.clone()
        })
    }

    /// The same of what the network predicts, in its own terms.
    pub fn prediction_loss(&self, network: &MotionDiffuse) -> f64 {
        self.mean(network, |output, truth| {
            output - truth.target(network.prediction())
        })
    }

    fn mean(&self, network: &MotionDiffuse, error: impl Fn(Tensor<3>, &Truth) -> Tensor<3>) -> f64 {
        let schedule = Schedule::linear();
        let mut errors = Vec::new();
        for visits in &self.batches {
            let Example { batch, truth } = Example::new(
                self.dataset,
                self.tokens,
                None,
                &schedule,
                visits,
                &self.device,
            );
            let mut squares = error(network.predict(batch), &truth).square();
            if let Some(keep) = truth.mask.keep() {
                squares = squares * keep;
            }
            let [_, _, features] = squares.dims();
            let sums: Vec<f32> = squares
                .sum_dim(2)
                .sum_dim(1)
                .try_into_vec_as()
                .expect("floats convert to f32");
            let lengths = truth.mask.lengths().iter();
            let means = sums.iter().zip(lengths);
            errors.extend(means.map(|(sum, frames)| f64::from(*sum) / (frames * features) as f64));
        }
        errors.iter().sum::<f64>() / errors.len() as f64
    }
}
