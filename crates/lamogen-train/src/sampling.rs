//! What is drawn at a step.
//!
//! It depends on the seed and the step's number alone, so that a run that goes on where it was stopped sees what it would have seen
//! without a stop.

use std::collections::HashMap;
use std::ops::{Range, RangeInclusive};

use lamogen_data::{Dataset, Split};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha12Rng;

/// The generator of a step.
pub(crate) fn stream(seed: u64, step: u64) -> ChaCha12Rng {
    let mut stream = ChaCha12Rng::seed_from_u64(seed);
    stream.set_stream(step);
    stream
}

/// The motions of the training split, but for variations, that have at least so many frames, each with how likely it is to be seen: by one over the root
/// of how many have its content, and one over a power of how many have its source. What is done often is seen less than its share, what is done rarely more.
pub(crate) fn candidates(
    dataset: &Dataset,
    shortest: usize,
    source_balance: f64,
) -> Vec<(usize, f64)> {
    let content = |entry: usize| dataset.entries()[entry].content.as_deref();
    let source = |entry: usize| dataset.entries()[entry].source.as_deref();
    let is_wanted = |entry: &usize| {
        let entry = &dataset.entries()[*entry];
        entry.frames >= shortest && entry.variation_of.is_none()
    };
    let entries = dataset.indices(Split::Train).filter(is_wanted);
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

/// Frames of a motion from which at most a share was cut away at its ends: within `lengths`, and a multiple of `unit`. The motion has at least
/// the shortest length.
pub(crate) fn cut(
    frames: usize,
    share: f64,
    lengths: RangeInclusive<usize>,
    unit: usize,
    stream: &mut impl Rng,
) -> Range<usize> {
    let most = frames.min(*lengths.end());
    let least = (frames as f64 * (1.0 - share)).ceil() as usize;
    let least = least.max(*lengths.start()).min(most);
    let length = stream.random_range(least as u64..=most as u64) as usize / unit * unit;
    let start = stream.random_range(0..=(frames - length) as u64) as usize;
    start..start + length
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_cut_is_within_the_lengths_and_no_more_than_the_share() {
        let mut stream = stream(3, 5);
        for frames in [40, 41, 100, 196, 199, 900] {
            for _ in 0..200 {
                let cut = cut(frames, 0.25, 40..=196, 1, &mut stream);
                assert!(cut.end <= frames && (40..=196).contains(&cut.len()));
                assert!(cut.len() == 196 || cut.len() as f64 >= 0.75 * frames as f64);
            }
            let whole = cut(frames, 0.0, 40..=196, 1, &mut stream);
            assert_eq!(whole.len(), frames.min(196));
            assert_eq!(cut(frames, 0.5, 4..=199, 4, &mut stream).len() % 4, 0);
        }
    }

    #[test]
    fn steps_have_streams_of_their_own() {
        let first = |seed, step| stream(seed, step).next_u64();
        assert_eq!(first(1, 2), first(1, 2));
        assert_ne!(first(1, 2), first(1, 3));
        assert_ne!(first(1, 2), first(2, 2));
    }
}
