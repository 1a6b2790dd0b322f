//! Random draws of training steps.
//!
//! They depend on the seed and the number of the step alone, so that a resumed run draws what it would have drawn without a stop.

use std::collections::HashMap;
use std::ops::{Range, RangeInclusive};

use lamogen_data::{Dataset, Split};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha12Rng;

/// Returns the random number generator of a step.
pub(crate) fn step_generator(seed: u64, step: u64) -> ChaCha12Rng {
    let mut generator = ChaCha12Rng::seed_from_u64(seed);
    generator.set_stream(step);
    generator
}

/// Returns the entries of the training split with at least `shortest` frames, without variations, each with its weight.
///
/// The weight is one over the square root of the number of motions of the same content, times one over a power
/// (`source_balance`) of the number of motions from the same source. Frequent contents are drawn less than their share of the
/// motions, rare contents more.
pub(crate) fn weighted_entries(
    dataset: &Dataset,
    shortest: usize,
    source_balance: f64,
) -> Vec<(usize, f64)> {
    let content = |entry: usize| dataset.entries()[entry].content.as_deref();
    let source = |entry: usize| dataset.entries()[entry].source.as_deref();
    let is_eligible = |entry: &usize| {
        let entry = &dataset.entries()[*entry];
        entry.frames >= shortest && entry.variation_of.is_none()
    };
    let entries = dataset.indices(Split::Train).filter(is_eligible);
    let entries: Vec<usize> = entries.collect();
    let mut counts: HashMap<Option<&str>, f64> = HashMap::new();
    let mut sources: HashMap<Option<&str>, f64> = HashMap::new();
    for &entry in &entries {
        *counts.entry(content(entry)).or_default() += 1.0;
        *sources.entry(source(entry)).or_default() += 1.0;
    }
    let weight =
        |entry| counts[&content(entry)].powf(-0.5) * sources[&source(entry)].powf(-source_balance);
    entries
        .into_iter()
        .map(|entry| (entry, weight(entry)))
        .collect()
}

/// Draws the frames of a motion that are left when at most a share of them is cut away at its ends. Their number lies within
/// `lengths` and is a multiple of `unit`. The motion must have at least the shortest of the lengths.
pub(crate) fn draw_crop(
    frames: usize,
    share: f64,
    lengths: RangeInclusive<usize>,
    unit: usize,
    generator: &mut impl Rng,
) -> Range<usize> {
    let most = frames.min(*lengths.end());
    let least = (frames as f64 * (1.0 - share)).ceil() as usize;
    let least = least.max(*lengths.start()).min(most);
    let length = generator.random_range(least as u64..=most as u64) as usize / unit * unit;
    let start = generator.random_range(0..=(frames - length) as u64) as usize;
    start..start + length
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_cut_is_within_the_lengths_and_no_more_than_the_share() {
        let mut generator = step_generator(3, 5);
        for frames in [40, 41, 100, 196, 199, 900] {
            for _ in 0..200 {
                let crop = draw_crop(frames, 0.25, 40..=196, 1, &mut generator);
                assert!(crop.end <= frames && (40..=196).contains(&crop.len()));
                assert!(crop.len() == 196 || crop.len() as f64 >= 0.75 * frames as f64);
            }
            let whole = draw_crop(frames, 0.0, 40..=196, 1, &mut generator);
            assert_eq!(whole.len(), frames.min(196));
            let fours = draw_crop(frames, 0.5, 4..=199, 4, &mut generator);
            assert_eq!(fours.len() % 4, 0);
        }
    }

    #[test]
    fn steps_have_streams_of_their_own() {
        let first = |seed, step| step_generator(seed, step).next_u64();
        assert_eq!(first(1, 2), first(1, 2));
        assert_ne!(first(1, 2), first(1, 3));
        assert_ne!(first(1, 2), first(2, 2));
    }
}
