//! The choice of the motions of each training step.

use std::collections::HashMap;
use std::ops::{Range, RangeInclusive};

use lamogen_data::Dataset;
use lamogen_model::LABAN_FEATURES;
use rand::{Rng, RngExt};

use crate::config::DenoisingConfig;
use crate::sampling::{draw_crop, step_generator, weighted_entries};

/// Draws batches of motions from the training split.
#[derive(Clone, Debug)]
pub(crate) struct BatchSampler {
    seed: u64,
    crop: f64,
    lengths: RangeInclusive<usize>,
    frames_per_batch: usize,
    noises: usize,
    /// The number of timesteps of the network's schedule.
    timesteps: usize,
    text_dropout: f64,
    laban_share: f64,
    phrasings: bool,
    buckets: Vec<Bucket>,
    /// The cumulative sums of the buckets' weights.
    weights: Vec<f64>,
}

/// Motions of about the same length.
#[derive(Clone, Debug)]
struct Bucket {
    entries: Vec<CandidateMotion>,
    /// The cumulative sums of the entries' weights.
    weights: Vec<f64>,
    /// The length of the longest motion in frames.
    longest: usize,
}

/// A motion that can be drawn.
#[derive(Clone, Debug)]
struct CandidateMotion {
    /// The index of its entry in the data set.
    entry: usize,
    /// Its length in frames.
    frames: usize,
    /// The number of its captions.
    captions: usize,
    /// The indices of the entries that are variations of it.
    variations: Vec<usize>,
}

/// One item of a batch: which motion the network sees, and with which conditions, timestep and noise.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct BatchItem {
    /// The index of the entry in the data set, whose captions are used.
    pub(crate) entry: usize,
    /// The index of the entry whose motion is used: the same entry, or one of its variations.
    pub(crate) motion: usize,
    /// The frames of the motion that are used.
    pub(crate) frames: Range<usize>,
    /// The index of the caption; `None` without text.
    pub(crate) caption: Option<usize>,
    /// A number that selects a phrasing of the caption; 0 is the caption itself.
    pub(crate) phrasing: u64,
    /// Which Laban features the network sees.
    pub(crate) laban: [bool; LABAN_FEATURES],
    /// The diffusion timestep.
    pub(crate) timestep: usize,
    /// The seed of the noise.
    pub(crate) noise: u64,
}

impl BatchSampler {
    /// Collects the motions of the training split that have at least the model's shortest length; of motions that are longer than
    /// the model's longest, a part is used. Returns `None` if there are none.
    pub(crate) fn new(
        dataset: &Dataset,
        config: &DenoisingConfig,
        seed: u64,
        lengths: RangeInclusive<usize>,
        timesteps: usize,
    ) -> Option<Self> {
        let frames = |entry: usize| dataset.entries()[entry].frames.min(*lengths.end());
        let mut sorted = weighted_entries(dataset, *lengths.start(), config.source_balance);
        sorted.sort_by_key(|&(entry, _)| (frames(entry), entry));
        let size = sorted.len().div_ceil(config.length_buckets);
        let mut variations = variations_by_original(dataset);
        let mut bucket = |candidates: &[(usize, f64)]| {
            let entries = candidates.iter().map(|&(index, _)| {
                let entry = &dataset.entries()[index];
                CandidateMotion {
                    entry: index,
                    frames: entry.frames,
                    captions: entry.captions.len(),
                    variations: variations.remove(&*entry.name).unwrap_or_default(),
                }
            });
            let (longest, _) = candidates.last().expect("chunks are not empty");
            Bucket {
                entries: entries.collect(),
                weights: cumulative_sums(candidates.iter().map(|(_, weight)| *weight)),
                longest: frames(*longest),
            }
        };
        let buckets: Vec<Bucket> = sorted.chunks(size.max(1)).map(&mut bucket).collect();
        let weights = buckets.iter();
        let weights = weights.map(|bucket| bucket.weights.last().expect("not empty"));
        let weights = cumulative_sums(weights.copied());
        (!buckets.is_empty()).then_some(BatchSampler {
            seed,
            crop: config.crop,
            lengths,
            frames_per_batch: config.frames_per_batch,
            noises: config.noises_per_motion,
            timesteps,
            text_dropout: config.text_dropout,
            laban_share: config.laban_share,
            phrasings: config.phrasings > 0,
            weights,
            buckets,
        })
    }

    /// Returns the number of motions that can be drawn, variations not counted.
    pub(crate) fn motions(&self) -> usize {
        self.buckets.iter().map(|bucket| bucket.entries.len()).sum()
    }

    /// Returns the indices of the entries that can be drawn, variations included.
    pub(crate) fn entries(&self) -> impl Iterator<Item = usize> {
        let candidates = self.buckets.iter().flat_map(|bucket| &bucket.entries);
        candidates.flat_map(|candidate| {
            std::iter::once(candidate.entry).chain(candidate.variations.iter().copied())
        })
    }

    /// Draws the batch of a step.
    pub(crate) fn draw(&self, step: u64) -> Vec<BatchItem> {
        let mut generator = step_generator(self.seed, step);
        let bucket = &self.buckets[draw_index(&self.weights, &mut generator)];
        let count = (self.frames_per_batch / (bucket.longest * self.noises)).max(1);
        let mut items = Vec::with_capacity(count * self.noises);
        for _ in 0..count {
            let candidate = &bucket.entries[draw_index(&bucket.weights, &mut generator)];
            let lengths = self.lengths.clone();
            let frames = draw_crop(candidate.frames, self.crop, lengths, 1, &mut generator);
            let caption = generator.random_range(0..candidate.captions as u64) as usize;
            // Drawn only if there are phrasings, so that runs without them draw the same numbers as before.
            let phrasing = match self.phrasings {
                true => generator.random_range(0..=u64::from(u32::MAX)),
                false => 0,
            };
            // Each noise of a motion has its own range of timesteps, so that the timesteps differ.
            for part in 0..self.noises {
                let range = |part: usize| (part * self.timesteps / self.noises) as u64;
                let is_without_text =
                    self.text_dropout > 0.0 && generator.random_bool(self.text_dropout);
                let laban = match self.laban_share > 0.0 {
                    true => draw_laban_features(self.laban_share, &mut generator),
                    false => [false; LABAN_FEATURES],
                };
                // A variation is used only together with all of its Laban features, which distinguish it from its original.
                let variations = &candidate.variations;
                let may_be_varied = laban != [false; LABAN_FEATURES] && !variations.is_empty();
                let (motion, laban) = match may_be_varied
                    && generator.random_bool(VARIATION_PROBABILITY)
                {
                    true => {
                        let choice = generator.random_range(0..variations.len() as u64) as usize;
                        (variations[choice], [true; LABAN_FEATURES])
                    }
                    false => (candidate.entry, laban),
                };
                items.push(BatchItem {
                    entry: candidate.entry,
                    motion,
                    frames: frames.clone(),
                    caption: (!is_without_text).then_some(caption),
                    phrasing,
                    laban,
                    timestep: generator.random_range(range(part)..range(part + 1)) as usize,
                    noise: generator.next_u64(),
                });
            }
        }
        items
    }
}

/// The probability that a motion with variations is replaced by one of them where the network sees Laban features.
const VARIATION_PROBABILITY: f64 = 0.75;

/// Returns the indices of the variations of each motion that has any, by the motion's name.
fn variations_by_original(dataset: &Dataset) -> HashMap<&str, Vec<usize>> {
    let mut variations: HashMap<&str, Vec<usize>> = HashMap::new();
    for (index, entry) in dataset.entries().iter().enumerate() {
        if let Some(original) = &entry.variation_of {
            variations.entry(original).or_default().push(index);
        }
    }
    variations
}

/// Draws which Laban features of a motion the network sees. Only the given share of the motions has any; most of these have
/// all, the others a random subset.
fn draw_laban_features(share: f64, generator: &mut impl Rng) -> [bool; LABAN_FEATURES] {
    /// The probability of all features.
    const ALL_PROBABILITY: f64 = 0.7;
    if !generator.random_bool(share) {
        return [false; LABAN_FEATURES];
    }
    let all = generator.random_bool(ALL_PROBABILITY);
    std::array::from_fn(|_| generator.random_bool(0.5) || all)
}

/// Computes the cumulative sums of some numbers.
fn cumulative_sums(numbers: impl Iterator<Item = f64>) -> Vec<f64> {
    numbers
        .scan(0.0, |sum, number| {
            *sum += number;
            Some(*sum)
        })
        .collect()
}

/// Draws an index with a probability in proportion to its weight, from the cumulative sums of the weights.
fn draw_index(sums: &[f64], generator: &mut impl Rng) -> usize {
    let total = sums.last().expect("something to pick from");
    let drawn = generator.random::<f64>() * total;
    sums.partition_point(|sum| *sum <= drawn)
        .min(sums.len() - 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn variations_are_shown_only_with_all_that_sets_them_apart() {
        let candidate = |entry, variations| CandidateMotion {
            entry,
            frames: 50,
            captions: 2,
            variations,
        };
        let batches = BatchSampler {
            seed: 3,
            crop: 0.2,
            lengths: 40..=196,
            frames_per_batch: 4000,
            noises: 2,
            timesteps: 1000,
            text_dropout: 0.1,
            laban_share: 0.5,
            phrasings: false,
            buckets: vec![Bucket {
                entries: vec![candidate(0, vec![5, 6]), candidate(1, vec![])],
                weights: vec![1.0, 2.0],
                longest: 50,
            }],
            weights: vec![1.0],
        };
        let (mut varied, mut with_laban) = (0, 0);
        for step in 0..50 {
            for item in batches.draw(step) {
                let has_laban = item.laban != [false; LABAN_FEATURES];
                with_laban += usize::from(has_laban && item.entry == 0);
                if item.motion == item.entry {
                    continue;
                }
                assert!(item.entry == 0 && [5, 6].contains(&item.motion));
                assert_eq!(item.laban, [true; LABAN_FEATURES]);
                varied += 1;
            }
        }
        let share = varied as f64 / with_laban as f64;
        let error = (share - VARIATION_PROBABILITY).abs();
        assert!(error < 0.08, "{varied} of {with_laban}");
    }
}
