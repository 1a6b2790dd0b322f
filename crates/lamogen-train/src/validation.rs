//! The validation loss of a denoiser on motions that it was not trained on.

use burn::tensor::{Device, Tensor};
use lamogen_data::{Dataset, Split};
use lamogen_guide::Schedule;
use lamogen_model::{LABAN_FEATURES, NoiseSchedule, TrainableDenoiser};

use crate::batches::BatchItem;
use crate::example::DenoisingExamples;
use crate::losses::NoisyMotions;
use crate::tokens::CaptionTokens;

/// The noisy motions on which denoisers are validated, which are the same at every validation.
///
/// They are all motions of a split except mirror images, each with its first caption, at ten timesteps in the middle of ten equal
/// parts of the schedule (50, 150, …, 950 of 1000), with noise that depends on the motion's position in the split and on the timestep.
pub struct ValidationSet<'a> {
    dataset: &'a Dataset,
    tokens: &'a CaptionTokens,
    device: Device,
    schedule: Schedule,
    /// Batches of motions of about the same length, which share a timestep.
    batches: Vec<Vec<BatchItem>>,
}

impl<'a> ValidationSet<'a> {
    /// Collects the motions of a split that have at least the network's shortest length; of motions that are longer than the
    /// network's longest, the first frames are used. Returns `None` if there are none.
    pub fn new(
        dataset: &'a Dataset,
        tokens: &'a CaptionTokens,
        split: Split,
        lengths: std::ops::RangeInclusive<usize>,
        schedule: NoiseSchedule,
        device: &Device,
    ) -> Option<Self> {
        /// The frames of a batch, padding included.
        const FRAMES_PER_BATCH: usize = 6400;
        let mut entries: Vec<(usize, usize)> = dataset
            .indices(split)
            .filter(|&entry| !dataset.entries()[entry].mirror)
            .enumerate()
            .filter(|&(_, entry)| dataset.entries()[entry].frames >= *lengths.start())
            .collect();
        entries.sort_by_key(|&(place, entry)| (dataset.entries()[entry].frames, place));
        let frames = |entry: usize| dataset.entries()[entry].frames.min(*lengths.end());
        let longest = frames(entries.last()?.1);
        let motions_per_batch = (FRAMES_PER_BATCH / longest).max(1);
        /// The number of timesteps of each motion.
        const TIMESTEPS: usize = 10;
        let timesteps = schedule.timesteps();
        let middles = (0..TIMESTEPS).map(|part| (2 * part + 1) * timesteps / (2 * TIMESTEPS));
        let batches = middles.flat_map(|timestep| {
            let item = move |&(place, entry): &(usize, usize)| BatchItem {
                entry,
                motion: entry,
                frames: 0..frames(entry),
                caption: Some(0),
                phrasing: 0,
                laban: [false; LABAN_FEATURES],
                timestep,
                noise: (timesteps * place + timestep) as u64,
            };
            let batches = entries.chunks(motions_per_batch);
            batches.map(move |batch| batch.iter().map(item).collect::<Vec<_>>())
        });
        Some(ValidationSet {
            batches: batches.collect(),
            device: device.clone(),
            schedule: Schedule::new(schedule),
            dataset,
            tokens,
        })
    }

    /// Computes the mean squared error of the normalised clean motion over frames and features, averaged over motions and timesteps.
    ///
    /// If the network predicts noise or `v`, the error is that of the clean motion that follows from the prediction, so that
    /// networks with different predictions can be compared.
    pub fn loss(&self, network: &impl TrainableDenoiser) -> f64 {
        self.mean_squared_error(network, |output, motions| {
            motions.predicted_clean(output, network.prediction()) - motions.clean.clone()
        })
    }

    /// Computes the mean squared error of the network's prediction itself (clean motion, noise or `v`), averaged in the same way.
    pub fn prediction_loss(&self, network: &impl TrainableDenoiser) -> f64 {
        self.mean_squared_error(network, |output, motions| {
            output - motions.target(network.prediction())
        })
    }

    /// Computes the mean of the squares of an error, which `error` computes from the network's output.
    fn mean_squared_error(
        &self,
        network: &impl TrainableDenoiser,
        error: impl Fn(Tensor<3>, &NoisyMotions) -> Tensor<3>,
    ) -> f64 {
        let mut errors = Vec::new();
        for items in &self.batches {
            let DenoisingExamples { batch, motions } = DenoisingExamples::new(
                self.dataset,
                self.tokens,
                None,
                &self.schedule,
                items,
                &self.device,
            );
            let mut squares = error(network.predict(batch), &motions).square();
            if let Some(keep) = motions.mask.keep() {
                squares = squares * keep;
            }
            let [_, _, features] = squares.dims();
            let sums: Vec<f32> = squares
                .sum_dim(2)
                .sum_dim(1)
                .try_into_vec_as()
                .expect("floats convert to f32");
            let lengths = motions.mask.lengths().iter();
            let means = sums.iter().zip(lengths);
            errors.extend(means.map(|(sum, frames)| f64::from(*sum) / (frames * features) as f64));
        }
        errors.iter().sum::<f64>() / errors.len() as f64
    }
}
