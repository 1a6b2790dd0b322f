//! Which pairs of text and motion a step sees.

use std::collections::{HashMap, HashSet};
use std::ops::{Range, RangeInclusive};

use lamogen_data::{Dataset, Entry};
use lamogen_eval::{EvaluatorConfig, RetrievalBatches};
use rand::RngExt;
use rand_chacha::ChaCha12Rng;

use super::config::EvaluatorTrainingConfig;
use crate::sampling::{candidates, cut, stream};

/// Deals out the motions of the training split, mirrored ones too.
///
/// Two motions that mean the same do not meet in a batch, since either would be a right answer to the other's caption. They mean
/// the same if they have a caption in common ([`RetrievalBatches::words`]), or the data set gives both the same content and style: their
/// captions then say the same in other words.
#[derive(Clone, Debug)]
pub(super) struct Pairs {
    seed: u64,
    size: usize,
    crop: f64,
    longest: usize,
    candidates: Vec<Candidate>,
}

#[derive(Clone, Debug)]
struct Candidate {
    entry: usize,
    frames: usize,
    captions: usize,
    /// How likely it is to be seen.
    weight: f64,
    /// Numbers that stand for what it means; none in common with another means that they may meet.
    meanings: Vec<usize>,
}

/// A pair of a batch.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Pair {
    /// Which entry of the data set.
    pub(super) entry: usize,
    /// Which frames of it, a multiple of four.
    pub(super) frames: Range<usize>,
    /// Which of its captions.
    pub(super) caption: usize,
}

/// The batch of a step.
pub(super) struct Draw {
    /// At least two.
    pub(super) pairs: Vec<Pair>,
    /// For what else is drawn at the step.
    pub(super) stream: ChaCha12Rng,
}

const UNIT: usize = EvaluatorConfig::FRAMES_PER_MOVEMENT;

/// Frames of motions that an evaluator can read.
pub(super) fn lengths(config: &EvaluatorConfig) -> RangeInclusive<usize> {
    UNIT..=config.max_motion_length / UNIT * UNIT + UNIT - 1
}

impl Pairs {
    /// `None` if there are no two motions that may meet.
    pub(super) fn new(dataset: &Dataset, config: &EvaluatorTrainingConfig) -> Option<Self> {
        let lengths = lengths(&config.evaluator);
        let mut known = HashMap::new();
        let candidates = candidates(dataset, *lengths.start(), 0.0).into_iter();
        let candidates = candidates.map(|(index, weight)| {
            let entry = &dataset.entries()[index];
            Candidate {
                entry: index,
                frames: entry.frames,
                captions: entry.captions.len(),
                weight,
                meanings: meanings(entry, &mut known),
            }
        });
        let pairs = Pairs {
            seed: config.optimization.seed,
            size: config.matching.pairs_per_batch,
            crop: config.matching.crop,
            longest: *lengths.end() / UNIT * UNIT,
            candidates: candidates.collect(),
        };
        pairs.any_may_meet().then_some(pairs)
    }

    fn any_may_meet(&self) -> bool {
        let all: HashSet<&Vec<usize>> = { self.candidates.iter() }
            .map(|candidate| &candidate.meanings)
            .collect();
        let all: Vec<_> = all.into_iter().collect();
        let meets = |(place, one): (usize, &&Vec<usize>)| {
            let apart = |other: &&Vec<usize>| one.iter().all(|meaning| !other.contains(meaning));
            all[place + 1..].iter().any(apart)
        };
        all.iter().enumerate().any(meets)
    }

    /// How many motions are dealt out.
    pub(super) fn motions(&self) -> usize {
        self.candidates.len()
    }

    /// The batch of a step.
    pub(super) fn draw(&self, step: u64) -> Draw {
        let mut stream = stream(self.seed, step);
        loop {
            let chosen = self.choose(&mut stream);
            // A motion that means the same as every other leaves room for none; then the others are asked.
            if chosen.len() < 2 {
                continue;
            }
            let pairs = chosen.into_iter().map(|candidate| Pair {
                entry: candidate.entry,
                frames: cut(
                    candidate.frames,
                    self.crop,
                    UNIT..=self.longest,
                    UNIT,
                    &mut stream,
                ),
                caption: stream.random_range(0..candidate.captions as u64) as usize,
            });
            return Draw {
                pairs: pairs.collect(),
                stream,
            };
        }
    }

    /// Motions that may meet, as many as a batch has room for. All are gone through in an order in which a motion comes
    /// first with a chance in proportion to its weight (Efraimidis and Spirakis 2006).
    fn choose(&self, stream: &mut ChaCha12Rng) -> Vec<&Candidate> {
        let arrivals = self.candidates.iter().map(|candidate| {
            let uniform: f64 = 1.0 - stream.random::<f64>();
            (-uniform.ln() / candidate.weight, candidate)
        });
        let mut arrivals: Vec<(f64, &Candidate)> = arrivals.collect();
        arrivals.sort_by(|(a, _), (b, _)| a.total_cmp(b));
        let mut taken: HashSet<usize> = HashSet::new();
        let mut chosen = Vec::with_capacity(self.size);
        for (_, candidate) in arrivals {
            if chosen.len() == self.size {
                break;
            }
            if !candidate
                .meanings
                .iter()
                .any(|meaning| taken.contains(meaning))
            {
                taken.extend(&candidate.meanings);
                chosen.push(candidate);
            }
        }
        chosen
    }
}

/// What an entry means, in numbers that are the same for what is the same.
fn meanings(entry: &Entry, known: &mut HashMap<Vec<String>, usize>) -> Vec<usize> {
    let captions = entry.captions.iter();
    let captions = captions.map(|caption| RetrievalBatches::words(&caption.text));
    let label = match (&entry.content, &entry.style) {
        // Not to be mixed up with words, which hold no such letter.
        (Some(content), Some(style)) => Some(vec![format!("{content}/{style}")]),
        _ => None,
    };
    let mut numbers: Vec<usize> = { captions.chain(label) }
        .map(|meaning| {
            let next = known.len();
            *known.entry(meaning).or_insert(next)
        })
        .collect();
    numbers.sort_unstable();
    numbers.dedup();
    numbers
}

#[cfg(test)]
#[path = "../../tests/common/mod.rs"]
mod common;

#[cfg(test)]
mod tests {
    use super::common::{Clip, packed};
    use super::*;

    fn config() -> EvaluatorTrainingConfig {
        let mut config = EvaluatorTrainingConfig::compact();
        config.matching.pairs_per_batch = 4;
        config.matching.crop = 0.3;
        config
    }

    /// One content 16 times in two styles, another once, a third without style.
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
            // No caption in common, but content and style.
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
    fn what_means_the_same_does_not_meet() {
        let folder = tempfile::tempdir().unwrap();
        let dataset = packed(folder.path(), &clips());
        let pairs = Pairs::new(&dataset, &config()).unwrap();
        assert_eq!(pairs.motions(), 21);
        let mut met = 0;
        for step in 0..300 {
            let drawn = pairs.draw(step).pairs;
            assert_eq!(drawn.len(), 4);
            for (place, one) in drawn.iter().enumerate() {
                for other in &drawn[place + 1..] {
                    let [a, b] = [one, other].map(|pair| &dataset.entries()[pair.entry]);
                    let labels = [a, b].map(|entry| (&entry.content, &entry.style));
                    assert!(labels[0] != labels[1] || a.style.is_none());
                    let words = [a, b].map(|entry| {
                        let captions = entry.captions.iter();
                        let words = captions.map(|caption| RetrievalBatches::words(&caption.text));
                        words.collect::<HashSet<_>>()
                    });
                    assert!(words[0].is_disjoint(&words[1]), "{words:?}");
                    // A style is no meaning of its own, nor is a content.
                    met += usize::from(a.style.is_some() && a.style == b.style);
                    met += usize::from(a.content == b.content);
                }
            }
        }
        assert!(met > 300, "{met}");
    }

    #[test]
    fn a_step_sees_the_same_again_in_whole_fours_of_frames() {
        let folder = tempfile::tempdir().unwrap();
        let dataset = packed(folder.path(), &clips());
        let pairs = Pairs::new(&dataset, &config()).unwrap();
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
        // 35 to 50 frames, in fours.
        let all = HashSet::from([32, 36, 40, 44, 48]);
        assert_eq!(lengths, all);
    }

    #[test]
    fn rare_contents_are_seen_more_than_their_share() {
        let folder = tempfile::tempdir().unwrap();
        let mut clips = clips();
        // The first motion of a batch is drawn freely; captions that differ let every one come.
        for (number, clip) in clips.iter_mut().enumerate() {
            clip.captions = vec![format!("caption {number}")];
        }
        let dataset = packed(folder.path(), &clips);
        let pairs = Pairs::new(&dataset, &config()).unwrap();
        let contents = (0..3000).map(|step| {
            let first = &pairs.draw(step).pairs[0];
            dataset.entries()[first.entry].content.as_deref()
        });
        let walks = contents.filter(|content| *content == Some("walk")).count();
        // The square roots of 16, 1 and 4: 4 of 7, where its share is 16 of 21.
        let share = walks as f64 / 3000.0;
        assert!((share - 4.0 / 7.0).abs() < 0.03, "{share}");
    }
}
