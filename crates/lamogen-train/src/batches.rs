//! Which motions a step sees.

use std::collections::HashMap;
use std::ops::{Range, RangeInclusive};

use lamogen_data::Dataset;
use lamogen_guide::TRAINING_STEPS;
use lamogen_model::LABAN_FEATURES;
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
    text_dropout: f64,
    laban_share: f64,
    phrasings: bool,
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

#[derive(Clone, Debug)]
struct Candidate {
    entry: usize,
    frames: usize,
    captions: usize,
    /// Which entries are variations of it.
    variations: Vec<usize>,
}

/// A motion of a batch.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Visit {
    /// Which entry of the data set.
    pub(crate) entry: usize,
    /// Whose motion is shown: that entry's, or a variation's.
    pub(crate) motion: usize,
    /// Which frames of it.
    pub(crate) frames: Range<usize>,
    /// Which of its captions; none where nothing is said.
    pub(crate) caption: Option<usize>,
    /// Which phrasing of it; 0 is as it is.
    pub(crate) phrasing: u64,
    /// Which Laban features are told.
    pub(crate) laban: [bool; LABAN_FEATURES],
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
        let mut sorted = candidates(dataset, *lengths.start(), config.source_balance);
        sorted.sort_by_key(|&(entry, _)| (frames(entry), entry));
        let size = sorted.len().div_ceil(config.length_buckets);
        let mut varied = variations(dataset);
        let mut bucket = |candidates: &[(usize, f64)]| {
            let entries = candidates.iter().map(|&(place, _)| {
                let entry = &dataset.entries()[place];
                Candidate {
                    entry: place,
                    frames: entry.frames,
                    captions: entry.captions.len(),
                    variations: varied.remove(&*entry.name).unwrap_or_default(),
                }
            });
            let (longest, _) = candidates.last().expect("chunks are not empty");
            Bucket {
                entries: entries.collect(),
                weights: sums(candidates.iter().map(|(_, weight)| *weight)),
                longest: frames(*longest),
            }
        };
        let buckets: Vec<Bucket> = sorted.chunks(size.max(1)).map(&mut bucket).collect();
        let weights = buckets.iter();
        let weights = weights.map(|bucket| bucket.weights.last().expect("not empty"));
        let weights = sums(weights.copied());
        (!buckets.is_empty()).then_some(Batches {
            seed,
            crop: config.crop,
            lengths,
            frames_per_batch: config.frames_per_batch,
            noises: config.noises_per_motion,
            text_dropout: config.text_dropout,
            laban_share: config.laban_share,
            phrasings: config.phrasings > 0,
            weights,
            buckets,
        })
    }

    /// How many motions are dealt out.
    pub(crate) fn motions(&self) -> usize {
        self.buckets.iter().map(|bucket| bucket.entries.len()).sum()
    }

    /// Which entries are dealt out, variations included.
    pub(crate) fn entries(&self) -> impl Iterator<Item = usize> {
        let candidates = self.buckets.iter().flat_map(|bucket| &bucket.entries);
        candidates.flat_map(|candidate| {
            std::iter::once(candidate.entry).chain(candidate.variations.iter().copied())
        })
    }

    /// The batch of a step.
    pub(crate) fn draw(&self, step: u64) -> Vec<Visit> {
        let mut generator = stream(self.seed, step);
        let bucket = &self.buckets[pick(&self.weights, &mut generator)];
        let count = (self.frames_per_batch / (bucket.longest * self.noises)).max(1);
        let mut visits = Vec::with_capacity(count * self.noises);
        for _ in 0..count {
            let candidate = &bucket.entries[pick(&bucket.weights, &mut generator)];
            let lengths = self.lengths.clone();
            let frames = cut(candidate.frames, self.crop, lengths, 1, &mut generator);
            let caption = generator.random_range(0..candidate.captions as u64) as usize;
            // Drawn only where asked for, so that other runs draw as they did before.
            let phrasing = match self.phrasings {
                true => generator.random_range(0..=u64::from(u32::MAX)),
                false => 0,
            };
            // Each noise of a motion in a part of the timesteps of its own, so that they differ.
            for part in 0..self.noises {
                let range = |part: usize| (part * TRAINING_STEPS / self.noises) as u64;
                let unsaid = self.text_dropout > 0.0 && generator.random_bool(self.text_dropout);
                let laban = match self.laban_share > 0.0 {
                    true => told(self.laban_share, &mut generator),
                    false => [false; LABAN_FEATURES],
                };
                // A variation is only shown with all that sets it apart.
                let variations = &candidate.variations;
                let may_be_varied = laban != [false; LABAN_FEATURES] && !variations.is_empty();
                let (motion, laban) = match may_be_varied && generator.random_bool(VARIED) {
                    true => {
                        let which = generator.random_range(0..variations.len() as u64) as usize;
                        (variations[which], [true; LABAN_FEATURES])
                    }
                    false => (candidate.entry, laban),
                };
                visits.push(Visit {
                    entry: candidate.entry,
                    motion,
                    frames: frames.clone(),
                    caption: (!unsaid).then_some(caption),
                    phrasing,
                    laban,
                    timestep: generator.random_range(range(part)..range(part + 1)) as usize,
                    noise: generator.next_u64(),
                });
            }
        }
        visits
    }
}

/// How often a variation is shown in place of a motion that has some and whose Laban features are told.
const VARIED: f64 = 0.75;

/// The variations of every motion that has some, by its name.
fn variations(dataset: &Dataset) -> HashMap<&str, Vec<usize>> {
    let mut variations: HashMap<&str, Vec<usize>> = HashMap::new();
    for (place, entry) in dataset.entries().iter().enumerate() {
        if let Some(original) = &entry.variation_of {
            variations.entry(original).or_default().push(place);
        }
    }
    variations
}

/// Which Laban features are told of a motion: of a share of the motions, mostly all of them, at times only some.
fn told(share: f64, generator: &mut impl Rng) -> [bool; LABAN_FEATURES] {
    const ALL: f64 = 0.7;
    if !generator.random_bool(share) {
        return [false; LABAN_FEATURES];
    }
    let all = generator.random_bool(ALL);
    std::array::from_fn(|_| generator.random_bool(0.5) || all)
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn variations_are_shown_only_with_all_that_sets_them_apart() {
        let candidate = |entry, variations| Candidate {
            entry,
            frames: 50,
            captions: 2,
            variations,
        };
        let batches = Batches {
            seed: 3,
            crop: 0.2,
            lengths: 40..=196,
            frames_per_batch: 4000,
            noises: 2,
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
        let (mut varied, mut told) = (0, 0);
        for step in 0..50 {
            for visit in batches.draw(step) {
                let is_told = visit.laban != [false; LABAN_FEATURES];
                told += usize::from(is_told && visit.entry == 0);
                if visit.motion == visit.entry {
                    continue;
                }
                assert!(visit.entry == 0 && [5, 6].contains(&visit.motion));
                assert_eq!(visit.laban, [true; LABAN_FEATURES]);
                varied += 1;
            }
        }
        let share = varied as f64 / told as f64;
        assert!((share - VARIED).abs() < 0.08, "{varied} of {told}");
    }
}
