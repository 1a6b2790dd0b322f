//! Which motions a step sees.

use std::ops::{Range, RangeInclusive};

use lamogen_data::Dataset;
use lamogen_guide::TRAINING_STEPS;
use rand::{Rng, RngExt};

use crate::config::DenoisingConfig;
use crate::sampling::{candidates, cut, stream};

/// Deals out the motions of the training split.
#[derive(Clone, Debug)]
pub(crate) struct Batches {
    seed: u64,
    crop: f64,
    lengths: RangeInclusive<usize>,
    frames_per_batch: usize,
    noises: usize,
    buckets: Vec<Bucket>,
    /// Sums of the buckets' weights, each with those before it.
    weights: Vec<f64>,
}

/// Motions of about the same length.
#[derive(Clone, Debug)]
struct Bucket {
    entries: Vec<Candidate>,
    /// Sums of the entries' weights, each with those before it.
    weights: Vec<f64>,
    longest: usize,
}

#[derive(Clone, Copy, Debug)]
struct Candidate {
    entry: usize,
    frames: usize,
    captions: usize,
}

/// A motion of a batch.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Visit {
    /// Which entry of the data set.
    pub(crate) entry: usize,
    /// Which frames of it.
    pub(crate) frames: Range<usize>,
    /// Which of its captions.
    pub(crate) caption: usize,
    pub(crate) timestep: usize,
    /// Of its noise.
    pub(crate) noise: u64,
}

impl Batches {
    /// Batches of the training split's motions that are as long as the model asks for; of longer ones a part is seen. `None` if there
    /// is none.
    pub(crate) fn new(
        dataset: &Dataset,
        config: &DenoisingConfig,
        seed: u64,
        lengths: RangeInclusive<usize>,
    ) -> Option<Self> {
        let frames = |entry: usize| dataset.entries()[entry].frames.min(*lengths.end());
        let mut sorted = candidates(dataset, *lengths.start());
        sorted.sort_by_key(|&(entry, _)| (frames(entry), entry));
        let size = sorted.len().div_ceil(config.length_buckets);
        let bucket = |candidates: &[(usize, f64)]| {
            let entries = candidates.iter().map(|&(entry, _)| Candidate {
                entry,
                frames: dataset.entries()[entry].frames,
                captions: dataset.entries()[entry].captions.len(),
            });
            let (longest, _) = candidates.last().expect("chunks are not empty");
            Bucket {
                entries: entries.collect(),
                weights: sums(candidates.iter().map(|(_, weight)| *weight)),
                longest: frames(*longest),
            }
        };
        let buckets: Vec<Bucket> = sorted.chunks(size.max(1)).map(bucket).collect();
        let weights = buckets.iter();
        let weights = weights.map(|bucket| bucket.weights.last().expect("not empty"));
        let weights = sums(weights.copied());
        (!buckets.is_empty()).then_some(Batches {
            seed,
            crop: config.crop,
            lengths,
            frames_per_batch: config.frames_per_batch,
            noises: config.noises_per_motion,
            weights,
            buckets,
        })
    }

    /// How many motions are dealt out.
    pub(crate) fn motions(&self) -> usize {
        self.buckets.iter().map(|bucket| bucket.entries.len()).sum()
    }

    /// The batch of a step.
    pub(crate) fn draw(&self, step: u64) -> Vec<Visit> {
        let mut generator = stream(self.seed, step);
        let bucket = &self.buckets[pick(&self.weights, &mut generator)];
        let count = (self.frames_per_batch / (bucket.longest * self.noises)).max(1);
        let mut visits = Vec::with_capacity(count * self.noises);
        for _ in 0..count {
            let candidate = bucket.entries[pick(&bucket.weights, &mut generator)];
            let lengths = self.lengths.clone();
            let frames = cut(candidate.frames, self.crop, lengths, 1, &mut generator);
            let caption = generator.random_range(0..candidate.captions as u64) as usize;
            // Each noise of a motion in a part of the timesteps of its own, so that they differ.
            for part in 0..self.noises {
                let range = |part: usize| (part * TRAINING_STEPS / self.noises) as u64;
                visits.push(Visit {
                    entry: candidate.entry,
                    frames: frames.clone(),
                    caption,
                    timestep: generator.random_range(range(part)..range(part + 1)) as usize,
                    noise: generator.next_u64(),
                });
            }
        }
        visits
    }
}

/// Sums of numbers, each with those before it.
fn sums(numbers: impl Iterator<Item = f64>) -> Vec<f64> {
    numbers
        .scan(0.0, |sum, number| {
            *sum += number;
            Some(*sum)
        })
        .collect()
}

/// A place, each as likely as its weight is large.
fn pick(sums: &[f64], generator: &mut impl Rng) -> usize {
    let all = sums.last().expect("something to pick from");
    let drawn = generator.random::<f64>() * all;
    sums.partition_point(|sum| *sum <= drawn)
        .min(sums.len() - 1)
}
