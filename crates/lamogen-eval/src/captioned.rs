//! Motions with what is said of them, as an evaluator sees both.

use std::collections::HashSet;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha12Rng;

use crate::{Embeddings, Evaluator, EvaluatorError, MatchingScore, MetricError, RetrievalBatches};

/// Motions and all of their captions in an evaluator's space, to be compared in different pairs again and again.
#[derive(Clone, Debug)]
pub struct CaptionedMotions {
    /// `[motion][caption]`
    captions: Vec<Vec<String>>,
    /// Where the captions of each motion begin among the texts.
    first: Vec<usize>,
    texts: Embeddings,
    motions: Embeddings,
}

/// A matching, and of how many batches it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Drawn {
    pub(crate) matching: MatchingScore,
    pub(crate) batches: usize,
}

impl CaptionedMotions {
    /// Embeds motions, each with at least one caption. Features are as [`Evaluator::motions`] takes them, and are let go as soon
    /// as they are embedded.
    ///
    /// # Errors
    ///
    /// If the evaluator cannot embed a motion or a text.
    ///
    /// # Panics
    ///
    /// If a motion has no caption.
    pub fn embed(
        evaluator: &Evaluator,
        motions: impl IntoIterator<Item = (Vec<String>, Vec<f32>)>,
    ) -> Result<Self, EvaluatorError> {
        /// Motions that are in memory together; many, so that batches can be made of similar lengths.
        const AT_ONCE: usize = 512;
        let width = evaluator.network().config().dim_coemb_hidden;
        let none = Embeddings::new(Vec::new(), width)?;
        let mut captioned = CaptionedMotions {
            captions: Vec::new(),
            first: Vec::new(),
            texts: none.clone(),
            motions: none,
        };
        let mut motions = motions.into_iter().peekable();
        while motions.peek().is_some() {
            let (captions, features): (Vec<_>, Vec<_>) = motions.by_ref().take(AT_ONCE).unzip();
            let texts = captions.concat();
            let mut first = captioned.texts.len();
            captioned.texts.extend(&evaluator.texts(&texts)?)?;
            captioned.motions.extend(&evaluator.motions(&features)?)?;
            for captions in captions {
                assert!(
                    !captions.is_empty(),
                    "expected at least one caption a motion"
                );
                captioned.first.push(first);
                first += captions.len();
                captioned.captions.push(captions);
            }
        }
        Ok(captioned)
    }

    /// How many motions there are.
    pub fn len(&self) -> usize {
        self.motions.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.motions.is_empty()
    }

    /// The motions, in their order.
    pub fn motions(&self) -> &Embeddings {
        &self.motions
    }

    /// R-precision and distance in [batches](RetrievalBatches::distinct) of `size` pairs; the seed decides which caption stands for each
    /// motion, and who meets whom.
    ///
    /// # Errors
    ///
    /// If there are fewer than `size` motions with captions that differ.
    ///
    /// # Panics
    ///
    /// If the size is 0.
    pub fn matching(&self, size: usize, seed: u64) -> Result<MatchingScore, MetricError> {
        Ok(self.draw(size, seed)?.matching)
    }

    pub(crate) fn draw(&self, size: usize, seed: u64) -> Result<Drawn, MetricError> {
        let mut stream = ChaCha12Rng::seed_from_u64(seed);
        let mut chosen = |captions: &Vec<String>| stream.random_range(0..captions.len() as u64);
        let chosen: Vec<usize> = { self.captions.iter() }
            .map(|captions| chosen(captions) as usize)
            .collect();
        let captions = self.captions.iter().zip(&chosen);
        let captions: Vec<&str> = captions.map(|(all, &one)| all[one].as_str()).collect();
        let RetrievalBatches { batches, .. } = RetrievalBatches::distinct(&captions, size, seed);
        if batches.is_empty() {
            return Err(MetricError::TooFew {
                metric: "R-precision",
                what: "motions with captions that differ",
                needed: size,
                found: { captions.iter() }
                    .map(|caption| RetrievalBatches::words(caption))
                    .collect::<HashSet<_>>()
                    .len(),
            });
        }
        let rows = self.first.iter().zip(&chosen);
        let texts = self.texts.select(rows.map(|(first, one)| first + one));
        Ok(Drawn {
            matching: MatchingScore::of(&texts, &self.motions, &batches)?,
            batches: batches.len(),
        })
    }
}
