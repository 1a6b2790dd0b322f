//! The choice of the pairs of text and motion of each training step.

use std::collections::{HashMap, HashSet};
use std::ops::{Range, RangeInclusive};

use lamogen_data::{Dataset, Entry};
use lamogen_eval::{EvaluatorConfig, RetrievalBatches};
use rand::RngExt;
use rand_chacha::ChaCha12Rng;

use super::config::EvaluatorTrainingConfig;
use crate::sampling::{draw_crop, step_generator, weighted_entries};

/// Draws batches of pairs from the motions of the training split, mirrored ones included.
///
/// A batch has no two motions with the same meaning, since either of them would be a right answer to the caption of the other. Two
/// motions have the same meaning if they have a caption in common ([`RetrievalBatches::words`]), or if the data set gives both the
/// same content and style, because their captions are then paraphrases.
#[derive(Clone, Debug)]
pub(super) struct PairSampler {
    seed: u64,
    /// The number of pairs in a batch.
    size: usize,
    /// The largest share of a motion's frames that is cut away.
    crop: f64,
    /// The longest motion of a pair in frames.
    longest: usize,
    candidates: Vec<CandidateMotion>,
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
    /// The weight that determines how often it is drawn.
    weight: f64,
    /// The ids of its meanings. Two motions may be in the same batch if they have none in common.
    meanings: Vec<usize>,
}

/// A pair of a batch.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Pair {
    /// The index of the entry in the data set.
    pub(super) entry: usize,
    /// The frames of the motion that are used, a multiple of four in number.
    pub(super) frames: Range<usize>,
    /// The index of the caption.
    pub(super) caption: usize,
}

/// The pairs of a step.
pub(super) struct PairBatch {
    /// The pairs, at least two.
    pub(super) pairs: Vec<Pair>,
    /// The random number generator for further draws of the step.
    pub(super) generator: ChaCha12Rng,
}

/// The number of frames of which a length must be a multiple.
const UNIT: usize = EvaluatorConfig::FRAMES_PER_MOVEMENT;

/// Returns the lengths in frames of the motions that an evaluator can read.
pub(super) fn readable_lengths(config: &EvaluatorConfig) -> RangeInclusive<usize> {
    UNIT..=config.max_motion_length / UNIT * UNIT + UNIT - 1
}

impl PairSampler {
    /// Collects the motions of the training split. Returns `None` if there are no two with different meanings.
    pub(super) fn new(dataset: &Dataset, config: &EvaluatorTrainingConfig) -> Option<Self> {
        let lengths = readable_lengths(&config.evaluator);
        let mut known_meanings = HashMap::new();
        let candidates = weighted_entries(dataset, *lengths.start(), 0.0).into_iter();
        let candidates = candidates.map(|(index, weight)| {
            let entry = &dataset.entries()[index];
            CandidateMotion {
                entry: index,
                frames: entry.frames,
                captions: entry.captions.len(),
                weight,
                meanings: meanings(entry, &mut known_meanings),
            }
        });
        let pairs = PairSampler {
            seed: config.optimization.seed,
            size: config.matching.pairs_per_batch,
            crop: config.matching.crop,
            longest: *lengths.end() / UNIT * UNIT,
            candidates: candidates.collect(),
        };
        pairs.has_different_meanings().then_some(pairs)
    }

    /// Returns whether there are two motions with different meanings.
    fn has_different_meanings(&self) -> bool {
        let all: HashSet<&Vec<usize>> = { self.candidates.iter() }
            .map(|candidate| &candidate.meanings)
            .collect();
        let all: Vec<_> = all.into_iter().collect();
        let differs_from_later = |(index, one): (usize, &&Vec<usize>)| {
            let is_disjoint =
                |other: &&Vec<usize>| one.iter().all(|meaning| !other.contains(meaning));
            all[index + 1..].iter().any(is_disjoint)
        };
        all.iter().enumerate().any(differs_from_later)
    }

    /// Returns the number of motions that can be drawn.
    pub(super) fn motions(&self) -> usize {
        self.candidates.len()
    }

    /// Draws the pairs of a step.
    pub(super) fn draw(&self, step: u64) -> PairBatch {
        let mut generator = step_generator(self.seed, step);
        loop {
            let chosen = self.choose(&mut generator);
            // A motion with a meaning in common with all others comes alone; then the motions are drawn again.
            if chosen.len() < 2 {
                continue;
            }
            let pairs = chosen.into_iter().map(|candidate| Pair {
                entry: candidate.entry,
                frames: draw_crop(
                    candidate.frames,
                    self.crop,
                    UNIT..=self.longest,
                    UNIT,
                    &mut generator,
                ),
                caption: generator.random_range(0..candidate.captions as u64) as usize,
            });
            return PairBatch {
                pairs: pairs.collect(),
                generator,
            };
        }
    }

    /// Chooses motions with different meanings, at most as many as a batch has pairs. The motions are taken in a random order, in
    /// which each comes first with a probability in proportion to its weight (Efraimidis and Spirakis 2006).
    fn choose(&self, generator: &mut ChaCha12Rng) -> Vec<&CandidateMotion> {
        let arrivals = self.candidates.iter().map(|candidate| {
            let uniform: f64 = 1.0 - generator.random::<f64>();
            (-uniform.ln() / candidate.weight, candidate)
        });
        let mut arrivals: Vec<(f64, &CandidateMotion)> = arrivals.collect();
        arrivals.sort_by(|(a, _), (b, _)| a.total_cmp(b));
        let mut used_meanings: HashSet<usize> = HashSet::new();
        let mut chosen = Vec::with_capacity(self.size);
        for (_, candidate) in arrivals {
            if chosen.len() == self.size {
                break;
            }
            if !candidate
                .meanings
                .iter()
                .any(|meaning| used_meanings.contains(meaning))
            {
                used_meanings.extend(&candidate.meanings);
                chosen.push(candidate);
            }
        }
        chosen
    }
}

/// Returns the ids of the meanings of an entry: of the words of each caption, and of content and style. Equal meanings have equal
/// ids, which `known` keeps.
fn meanings(entry: &Entry, known: &mut HashMap<Vec<String>, usize>) -> Vec<usize> {
    let captions = entry.captions.iter();
    let captions = captions.map(|caption| RetrievalBatches::words(&caption.text));
    let label = match (&entry.content, &entry.style) {
        // The slash distinguishes it from the words of a caption, which contain none.
        (Some(content), Some(style)) => Some(vec![format!("{content}/{style}")]),
        _ => None,
    };
    let mut ids: Vec<usize> = { captions.chain(label) }
        .map(|meaning| {
            let next = known.len();
            *known.entry(meaning).or_insert(next)
        })
        .collect();
    ids.sort_unstable();
    ids.dedup();
    ids
}

#[cfg(test)]
#[path = "../../tests/common/mod.rs"]
mod common;

#[cfg(test)]
mod tests {
    use super::common::{Clip, pack_clips};
    use super::*;

    fn config() -> EvaluatorTrainingConfig {
        let mut config = EvaluatorTrainingConfig::compact();
        config.matching.pairs_per_batch = 4;
        config.matching.crop = 0.3;
        config
    }

    /// Clips of one content 16 times in two styles, of another once, and of a third four times without a style.
    fn clips() -> Vec<Clip> {
        let clip = |content, style, captions: Vec<String>| Clip {
            split: "train",
            content: Some(content),
            style,
            captions,
            frames: 50,
            swing: (0.3, 0.1),
            mirrored: false,
        };
        let mut clips: Vec<Clip> = (0..16)
            .map(|i| {
                clip(
                    "walk",
                    Some(["old", "sad"][i % 2]),
                    vec![format!("walk {i}"), "on".into()],
                )
            })
            .collect();
        for clip in &mut clips[8..] {
            // These have no caption in common with others, but content and style.
            clip.captions.pop();
        }
        clips.push(clip(
            "kick",
            Some("sad"),
            vec!["a kick".into(), "On!".into()],
        ));
        clips.extend((0..4).map(|i| clip("jump", None, vec![format!("jump {i}")])));
        clips
    }

    #[test]
    fn motions_with_the_same_meaning_are_never_in_a_batch() {
        let folder = tempfile::tempdir().unwrap();
        let dataset = pack_clips(folder.path(), &clips());
        let pairs = PairSampler::new(&dataset, &config()).unwrap();
        assert_eq!(pairs.motions(), 21);
        let mut partly_equal = 0;
        for step in 0..300 {
            let drawn = pairs.draw(step).pairs;
            assert_eq!(drawn.len(), 4);
            for (index, one) in drawn.iter().enumerate() {
                for other in &drawn[index + 1..] {
                    let [a, b] = [one, other].map(|pair| &dataset.entries()[pair.entry]);
                    let labels = [a, b].map(|entry| (&entry.content, &entry.style));
                    assert!(labels[0] != labels[1] || a.style.is_none());
                    let words = [a, b].map(|entry| {
                        let captions = entry.captions.iter();
                        let words = captions.map(|caption| RetrievalBatches::words(&caption.text));
                        words.collect::<HashSet<_>>()
                    });
                    assert!(words[0].is_disjoint(&words[1]), "{words:?}");
                    // Neither a style nor a content alone is a meaning.
                    partly_equal += usize::from(a.style.is_some() && a.style == b.style);
                    partly_equal += usize::from(a.content == b.content);
                }
            }
        }
        assert!(partly_equal > 300, "{partly_equal}");
    }

    #[test]
    fn a_step_always_has_the_same_pairs_with_multiples_of_four_frames() {
        let folder = tempfile::tempdir().unwrap();
        let dataset = pack_clips(folder.path(), &clips());
        let pairs = PairSampler::new(&dataset, &config()).unwrap();
        let mut lengths = HashSet::new();
        for step in 0..50 {
            let drawn = pairs.draw(step).pairs;
            assert_eq!(drawn, pairs.draw(step).pairs);
            assert_ne!(drawn, pairs.draw(step + 1).pairs);
            for Pair {
                frames,
                caption,
                entry,
            } in drawn
            {
                assert!(frames.end <= 50 && caption < dataset.entries()[entry].captions.len());
                lengths.insert(frames.len());
            }
        }
        // 35 to 50 frames, rounded down to multiples of four.
        let all = HashSet::from([32, 36, 40, 44, 48]);
        assert_eq!(lengths, all);
    }

    #[test]
    fn rare_contents_are_drawn_more_than_their_share() {
        let folder = tempfile::tempdir().unwrap();
        let mut clips = clips();
        // The first motion of a batch does not depend on others; with different captions, every motion can be drawn.
        for (number, clip) in clips.iter_mut().enumerate() {
            clip.captions = vec![format!("caption {number}")];
        }
        let dataset = pack_clips(folder.path(), &clips);
        let pairs = PairSampler::new(&dataset, &config()).unwrap();
        let contents = (0..3000).map(|step| {
            let first = &pairs.draw(step).pairs[0];
            dataset.entries()[first.entry].content.as_deref()
        });
        let walks = contents.filter(|content| *content == Some("walk")).count();
        // The square roots of 16, 1 and 4 give a share of 4 of 7; the share of the motions is 16 of 21.
        let share = walks as f64 / 3000.0;
        assert!((share - 4.0 / 7.0).abs() < 0.03, "{share}");
    }
}
