//! Motions and their captions as embeddings of an evaluator.

use std::collections::HashSet;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha12Rng;

use crate::{Embeddings, Evaluator, EvaluatorError, MatchingScore, MetricError, RetrievalBatches};

/// Embeddings of motions and of all their captions, which can be paired and compared again and again.
#[derive(Clone, Debug)]
pub struct CaptionedMotions {
    /// The captions, `[motion][caption]`.
    captions: Vec<Vec<String>>,
    /// The index in `texts` of each motion's first caption.
    first_text: Vec<usize>,
    /// The embeddings of all captions, motion by motion.
    texts: Embeddings,
    /// The embeddings of the motions.
    motions: Embeddings,
}

/// A matching score with the number of batches that it was computed from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct BatchedScore {
    pub(crate) score: MatchingScore,
    pub(crate) batches: usize,
}

impl CaptionedMotions {
    /// Embeds motions and their captions; each motion has at least one caption. The features are in the form that
    /// [`Evaluator::motions`] takes, and are dropped as soon as they are embedded.
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
        /// The number of motions in memory at a time. It is large, so that batches can be made of similar lengths.
        const CHUNK: usize = 512;
        let width = evaluator.network().config().dim_coemb_hidden;
        let empty = Embeddings::new(Vec::new(), width)?;
        let mut captioned = CaptionedMotions {
            captions: Vec::new(),
            first_text: Vec::new(),
            texts: empty.clone(),
            motions: empty,
        };
        let mut motions = motions.into_iter().peekable();
        while motions.peek().is_some() {
            let (captions, features): (Vec<_>, Vec<_>) = motions.by_ref().take(CHUNK).unzip();
            let texts = captions.concat();
            let mut first = captioned.texts.len();
            captioned.texts.extend(&evaluator.texts(&texts)?)?;
            captioned.motions.extend(&evaluator.motions(&features)?)?;
            for captions in captions {
                assert!(
                    !captions.is_empty(),
                    "expected at least one caption a motion"
                );
                captioned.first_text.push(first);
                first += captions.len();
                captioned.captions.push(captions);
            }
        }
        Ok(captioned)
    }

    /// Returns the number of motions.
    pub fn len(&self) -> usize {
        self.motions.len()
    }

    /// Returns whether there are no motions.
    pub fn is_empty(&self) -> bool {
        self.motions.is_empty()
    }

    /// Returns the embeddings of the motions, in the order in which they were given.
    pub fn motions(&self) -> &Embeddings {
        &self.motions
    }

    /// Computes R-precision and distance in [batches](RetrievalBatches::distinct) of `size` pairs. The seed decides
    /// which caption represents each motion, and which pairs are in one batch.
    ///
    /// # Errors
    ///
    /// If there are fewer than `size` motions with captions that differ.
    ///
    /// # Panics
    ///
    /// If the size is 0.
    pub fn matching(&self, size: usize, seed: u64) -> Result<MatchingScore, MetricError> {
        Ok(self.score_batches(size, seed)?.score)
    }

    /// Computes [`matching`](Self::matching) and says how many batches it is from.
    pub(crate) fn score_batches(
        &self,
        size: usize,
        seed: u64,
    ) -> Result<BatchedScore, MetricError> {
        let mut rng = ChaCha12Rng::seed_from_u64(seed);
        let mut choose = |captions: &Vec<String>| rng.random_range(0..captions.len() as u64);
        let chosen: Vec<usize> = { self.captions.iter() }
            .map(|captions| choose(captions) as usize)
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
        let rows = self.first_text.iter().zip(&chosen);
        let texts = self.texts.select(rows.map(|(first, one)| first + one));
        Ok(BatchedScore {
            score: MatchingScore::of(&texts, &self.motions, &batches)?,
            batches: batches.len(),
        })
    }
}
