//! Which motions a step sees.
//!
//! What is drawn at a step depends on the seed and the step alone, so that a run that goes on where it was stopped sees what it
//! would have seen without a stop.

use std::collections::HashMap;
use std::ops::{Range, RangeInclusive};

use lamogen_data::{Dataset, Split};
use lamogen_guide::TRAINING_STEPS;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha12Rng;

use crate::config::DenoisingConfig;

/// Deals out the motions of the training split.
#[derive(Clone, Debug)]
pub(crate) struct Batches {
    seed: u64,
    crop: f64,
    shortest: usize,
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
    /// Batches of the training split's motions, none shorter or longer than the model allows. `None` if there is none.
    pub(crate) fn new(
        dataset: &Dataset,
        config: &DenoisingConfig,
        seed: u64,
        lengths: RangeInclusive<usize>,
    ) -> Option<Self> {
        let mut counts: HashMap<Option<&str>, f64> = HashMap::new();
        let entries: Vec<usize> = dataset
            .indices(Split::Train)
            .filter(|&entry| lengths.contains(&dataset.entries()[entry].frames))
            .collect();
        for &entry in &entries {
            let content = dataset.entries()[entry].content.as_deref();
            *counts.entry(content).or_default() += 1.0;
        }
        let mut sorted = entries;
        sorted.sort_by_key(|&entry| (dataset.entries()[entry].frames, entry));
        let size = sorted.len().div_ceil(config.length_buckets);
        let buckets: Vec<Bucket> = sorted
            .chunks(size.max(1))
            .map(|entries| {
                let motions = entries.iter().map(|&entry| &dataset.entries()[entry]);
                let candidates = entries.iter().zip(motions.clone());
                let candidates = candidates.map(|(&entry, motion)| Candidate {
                    entry,
                    frames: motion.frames,
                    captions: motion.captions.len(),
                });
                // What is done often is seen less than its share, what is done rarely more.
                let weights = motions.map(|motion| counts[&motion.content.as_deref()].powf(-0.5));
                Bucket {
                    entries: candidates.collect(),
                    weights: sums(weights),
                    longest: dataset.entries()[*entries.last().expect("chunks are not empty")]
                        .frames,
                }
            })
            .collect();
        let weights = buckets.iter();
        let weights = weights.map(|bucket| bucket.weights.last().expect("not empty"));
        let weights = sums(weights.copied());
        (!buckets.is_empty()).then(|| Batches {
            seed,
            crop: config.crop,
            shortest: *lengths.start(),
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
        let mut generator = ChaCha12Rng::seed_from_u64(self.seed);
        generator.set_stream(step);
        let bucket = &self.buckets[pick(&self.weights, &mut generator)];
        let count = (self.frames_per_batch / (bucket.longest * self.noises)).max(1);
        let mut visits = Vec::with_capacity(count * self.noises);
        for _ in 0..count {
            let candidate = bucket.entries[pick(&bucket.weights, &mut generator)];
            let frames = self.cut(candidate.frames, &mut generator);
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

    /// Some frames of a motion, most of them.
    fn cut(&self, frames: usize, generator: &mut impl Rng) -> Range<usize> {
        let least = ((frames as f64 * (1.0 - self.crop)).ceil() as usize).max(self.shortest);
        let length = generator.random_range(least.min(frames) as u64..=frames as u64);
        let start = generator.random_range(0..=frames as u64 - length);
        start as usize..(start + length) as usize
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
