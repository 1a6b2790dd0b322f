//! The random choices of a replication: the order of the motions, their captions, and where they are cut.

use std::ops::Range;

use lamogen_data::BenchmarkClip;
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha12Rng;

use crate::EvaluatorConfig;

/// A caption of a motion, and the frames that are read of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ClipSample {
    /// The index of the caption.
    pub caption: usize,
    /// The first frame.
    pub start: usize,
    /// The number of frames: a multiple of 4.
    pub frames: usize,
}

impl ClipSample {
    /// Returns the frames.
    pub fn range(&self) -> Range<usize> {
        self.start..self.start + self.frames
    }
}

/// The random choices of one replication of the public evaluation.
///
/// The public loader chooses anew whenever it gives a motion: one of its captions; its length, which is the largest multiple of 4 frames, or, in a third
/// of the cases, 4 frames less; and where a motion of that length begins. The lengths are those of the generated motions, too.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Replication {
    /// The order in which motions form batches of 32. Motions that fill no batch are dropped.
    pub order: Vec<usize>,
    /// The choices for each motion: the text that motions are generated for with the length of these, and the real motions in the row of their own.
    pub samples: Vec<ClipSample>,
    /// The order of the real motions that FID compares with: of a pass of its own.
    pub reference_order: Vec<usize>,
    /// The choices for these.
    pub reference: Vec<ClipSample>,
}

impl Replication {
    /// Draws the choices for motions. The seed is that of the replication.
    ///
    /// # Panics
    ///
    /// If a motion has less than 8 frames.
    pub fn draw(clips: &[&BenchmarkClip], seed: u64) -> Replication {
        let mut rng = ChaCha12Rng::seed_from_u64(seed);
        let unit = EvaluatorConfig::FRAMES_PER_MOVEMENT;
        let mut pass = || {
            let mut order: Vec<usize> = (0..clips.len()).collect();
            order.shuffle(&mut rng);
            let samples = clips.iter().map(|clip| {
                let caption = rng.random_range(0..clip.captions.len());
                let is_shorter = rng.random_range(0..3) == 0;
                let frames = (clip.frames() / unit - usize::from(is_shorter)) * unit;
                let start = rng.random_range(0..=clip.frames() - frames);
                ClipSample {
                    caption,
                    start,
                    frames,
                }
            });
            let samples = samples.collect();
            (order, samples)
        };
        let (order, samples) = pass();
        let (reference_order, reference) = pass();
        Replication {
            order,
            samples,
            reference_order,
            reference,
        }
    }
}

#[cfg(test)]
mod tests {
    use lamogen_data::Caption;
    use lamogen_motion::POSE_FEATURES;

    use super::*;

    #[test]
    fn lengths_are_multiples_of_four_and_a_third_is_four_less() {
        let caption = |text: &str| Caption {
            text: text.into(),
            tokens: None,
        };
        let clips: Vec<BenchmarkClip> = (0..3000)
            .map(|index| BenchmarkClip {
                name: index.to_string(),
                captions: ["one", "two"].map(caption).into(),
                features: vec![0.0; (40 + index % 160) * POSE_FEATURES],
            })
            .collect();
        let clips: Vec<&BenchmarkClip> = clips.iter().collect();
        let draws = Replication::draw(&clips, 5);
        let mut shorter = 0;
        let mut second = 0;
        let mut starts = [0; 8];
        for (clip, sample) in clips.iter().zip(&draws.samples) {
            assert!(sample.frames % 4 == 0 && sample.range().end <= clip.frames());
            let missing = clip.frames() - sample.frames;
            assert!(missing < 8);
            shorter += usize::from(missing >= 4);
            second += sample.caption;
            starts[sample.start] += 1;
        }
        assert!((900..1100).contains(&shorter), "{shorter}");
        assert!((1400..1600).contains(&second), "{second}");
        assert!(starts.iter().all(|count| *count > 0), "{starts:?}");
        let mut order = draws.order.clone();
        assert_ne!(order, draws.reference_order);
        order.sort_unstable();
        assert!(order.into_iter().eq(0..3000));
        assert_eq!(draws, Replication::draw(&clips, 5));
        assert_ne!(draws, Replication::draw(&clips, 6));
    }
}
