//! The figures of a row of the table, from one replication.

use std::collections::HashMap;

use lamogen_data::{BenchmarkClip, Caption};
use lamogen_motion::POSE_FEATURES;

use super::{ClipSample, PublicEvaluator, Replication};
use crate::{
    Embeddings, EvaluatorError, Gaussian, MatchingScore, MetricError, RetrievalBatches, draw_pairs,
    mean_distance, mean_pair_distance,
};

/// The public evaluation of a benchmark's motions: replications with the embeddings of their captions and real motions, with which generated motions
/// are compared.
#[derive(Clone, Debug)]
pub struct Protocol {
    passes: Vec<Pass>,
    diversity_pairs: usize,
}

/// Turns the pose features of a real motion's frames into those that are measured, or says why there are none.
pub type MeasuredForm<'a> = dyn Fn(&[f32]) -> Result<Vec<f32>, String> + 'a;

/// A replication, embedded.
#[derive(Clone, Debug)]
struct Pass {
    order: Vec<usize>,
    /// The embedding of each motion's caption; `None` if the evaluator has no words.
    texts: Option<Embeddings>,
    /// The embeddings of the real motions.
    real: Embeddings,
    /// The distribution of the real motions of the other pass.
    reference: Gaussian,
}

/// The figures of a row of the table, from one replication.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProtocolScores {
    /// R-precision top 1 to 3 and the distance to the texts (MM-Dist); `None` if the evaluator has no words.
    pub matching: Option<MatchingScore>,
    /// The Fréchet distance to real motions.
    pub fid: f64,
    /// The mean distance of 300 drawn pairs of motions; of 300 motions and fewer, of all pairs.
    pub diversity: f64,
    /// The number of motions that were compared: whole batches of 32.
    pub motions: usize,
}

impl Protocol {
    /// The number of pairs of Diversity in the public evaluation.
    pub const DIVERSITY_PAIRS: usize = 300;
    /// The number of replications in the public evaluation.
    pub const REPLICATIONS: u64 = 20;
    /// The number of texts of MultiModality in the public evaluation.
    pub const MULTIMODALITY_TEXTS: usize = 100;
    /// The number of motions for each text of MultiModality in the public evaluation.
    pub const MULTIMODALITY_MOTIONS: usize = 30;
    /// The number of pairs of motions for each text of MultiModality in the public evaluation.
    pub const MULTIMODALITY_PAIRS: usize = 10;

    /// Embeds the captions and real motions of replications.
    ///
    /// `form` turns the pose features of a real motion's frames into those that are embedded, in the form in which generated motions are measured; the
    /// public evaluation takes them as they are.
    ///
    /// # Errors
    ///
    /// If a caption or a motion cannot be embedded, or there are fewer than 32 motions.
    ///
    /// # Panics
    ///
    /// If a replication is not one of these motions.
    pub fn embed(
        evaluator: &PublicEvaluator,
        clips: &[&BenchmarkClip],
        replications: &[Replication],
        form: &MeasuredForm<'_>,
    ) -> Result<Protocol, EvaluatorError> {
        let mut motions = RealEmbeddings::default();
        for replication in replications {
            for samples in [&replication.samples, &replication.reference] {
                motions.add(evaluator, clips, samples, form)?;
            }
        }
        let captions = match evaluator.has_words() {
            true => Some(CaptionEmbeddings::new(evaluator, clips)?),
            false => None,
        };
        let passes = replications.iter().map(|replication| {
            let reference = motions.of(&replication.reference)?;
            let reference = reference.select(whole_batches(&replication.reference_order)?);
            Ok(Pass {
                order: replication.order.clone(),
                texts: captions.as_ref().map(|all| all.of(&replication.samples)),
                real: motions.of(&replication.samples)?,
                reference: Gaussian::of(&reference)?,
            })
        });
        Ok(Protocol {
            passes: passes.collect::<Result<_, MetricError>>()?,
            diversity_pairs: Self::DIVERSITY_PAIRS,
        })
    }

    /// Sets the number of pairs of Diversity.
    pub fn with_diversity_pairs(self, diversity_pairs: usize) -> Self {
        Protocol {
            diversity_pairs,
            ..self
        }
    }

    /// Returns the number of replications.
    pub fn replications(&self) -> usize {
        self.passes.len()
    }

    /// Returns the figures of the real motions in a replication.
    ///
    /// # Errors
    ///
    /// If there are fewer than 32.
    ///
    /// # Panics
    ///
    /// If there is no such replication.
    pub fn real_scores(&self, replication: usize) -> Result<ProtocolScores, MetricError> {
        let real = &self.passes[replication].real;
        let all: Vec<usize> = (0..real.len()).collect();
        self.scores(replication, &all, real)
    }

    /// Returns the figures of generated motions in a replication. `places` are the places of their texts among the benchmark's motions.
    ///
    /// # Errors
    ///
    /// If there are fewer than 32, or the widths differ.
    ///
    /// # Panics
    ///
    /// If there is no such replication, there are not as many places as motions, or a place is beyond the benchmark.
    pub fn scores(
        &self,
        replication: usize,
        places: &[usize],
        motions: &Embeddings,
    ) -> Result<ProtocolScores, MetricError> {
        assert_eq!(places.len(), motions.len(), "a place for each motion");
        let row = self.rows(replication, places);
        let pairs = match row.len() > self.diversity_pairs {
            true => Some(draw_pairs(
                row.len(),
                self.diversity_pairs,
                replication as u64,
            )),
            false => None,
        };
        self.scores_with_pairs(replication, places, motions, pairs.as_deref())
    }

    /// Returns the figures as [`scores`](Self::scores) does, with given pairs of Diversity: places in the order of the batches. `None` is all pairs.
    ///
    /// # Errors
    ///
    /// As [`scores`](Self::scores).
    ///
    /// # Panics
    ///
    /// As [`scores`](Self::scores), and if a place of a pair is beyond the whole batches.
    pub fn scores_with_pairs(
        &self,
        replication: usize,
        places: &[usize],
        motions: &Embeddings,
        pairs: Option<&[(usize, usize)]>,
    ) -> Result<ProtocolScores, MetricError> {
        let pass = &self.passes[replication];
        let rows = whole_batches(&self.rows(replication, places))?;
        let motions = motions.select(rows.iter().copied());
        let batches: Vec<usize> = (0..rows.len()).collect();
        let batches: Vec<Vec<usize>> = { batches.chunks(RetrievalBatches::SIZE) }
            .map(<[usize]>::to_vec)
            .collect();
        let matching = pass.texts.as_ref().map(|texts| {
            let texts = texts.select(rows.iter().map(|&row| places[row]));
            MatchingScore::of(&texts, &motions, &batches)
        });
        Ok(ProtocolScores {
            matching: matching.transpose()?,
            fid: pass.reference.distance(&Gaussian::of(&motions)?)?,
            diversity: match pairs {
                Some(pairs) => mean_pair_distance(std::slice::from_ref(&motions), pairs)?,
                None => mean_distance(&motions)?,
            },
            motions: motions.len(),
        })
    }

    /// Returns the indices of motions in the order of the replication. `places` are the places of their texts.
    fn rows(&self, replication: usize, places: &[usize]) -> Vec<usize> {
        let row_of: HashMap<usize, usize> = { places.iter() }
            .enumerate()
            .map(|(row, &place)| (place, row))
            .collect();
        let order = self.passes[replication].order.iter();
        order
            .filter_map(|place| row_of.get(place).copied())
            .collect()
    }
}

/// Returns the items that fill whole batches.
fn whole_batches(order: &[usize]) -> Result<Vec<usize>, MetricError> {
    let size = RetrievalBatches::SIZE;
    match order.len() / size {
        0 => Err(MetricError::TooFew {
            metric: "the public evaluation",
            what: "motions",
            needed: size,
            found: order.len(),
        }),
        batches => Ok(order[..batches * size].to_vec()),
    }
}

/// The embeddings of all captions of all motions.
struct CaptionEmbeddings {
    /// The row of each motion's first caption.
    first: Vec<usize>,
    embeddings: Embeddings,
}

impl CaptionEmbeddings {
    fn new(evaluator: &PublicEvaluator, clips: &[&BenchmarkClip]) -> Result<Self, EvaluatorError> {
        let mut count = 0;
        let first = clips.iter().map(|clip| {
            let first = count;
            count += clip.captions.len();
            first
        });
        let first = first.collect();
        let captions: Vec<&Caption> = clips.iter().flat_map(|clip| &clip.captions).collect();
        Ok(CaptionEmbeddings {
            first,
            embeddings: evaluator.captions(&captions)?,
        })
    }

    fn of(&self, samples: &[ClipSample]) -> Embeddings {
        let rows = self.first.iter().zip(samples);
        self.embeddings
            .select(rows.map(|(first, sample)| first + sample.caption))
    }
}

/// The embeddings of cut real motions. A cut that was drawn in another replication is not embedded again.
#[derive(Default)]
struct RealEmbeddings {
    /// The row of a motion that begins at a frame and has a length.
    rows: HashMap<(usize, usize, usize), usize>,
    embeddings: Option<Embeddings>,
}

impl RealEmbeddings {
    /// Embeds the cuts that are not embedded yet.
    fn add(
        &mut self,
        evaluator: &PublicEvaluator,
        clips: &[&BenchmarkClip],
        samples: &[ClipSample],
        form: &MeasuredForm<'_>,
    ) -> Result<(), EvaluatorError> {
        assert_eq!(samples.len(), clips.len(), "a sample for each motion");
        let mut motions = Vec::new();
        for (index, (clip, sample)) in clips.iter().zip(samples).enumerate() {
            let key = (index, sample.start, sample.frames);
            if self.rows.contains_key(&key) {
                continue;
            }
            self.rows.insert(key, self.rows.len());
            let range = sample.range();
            let rows = &clip.features[range.start * POSE_FEATURES..range.end * POSE_FEATURES];
            motions.push(form(rows).map_err(|problem| EvaluatorError::Real {
                name: clip.name.clone(),
                problem,
            })?);
        }
        let embeddings = evaluator.motions(&motions)?;
        match &mut self.embeddings {
            None => self.embeddings = Some(embeddings),
            Some(all) => all.extend(&embeddings)?,
        }
        Ok(())
    }

    fn of(&self, samples: &[ClipSample]) -> Result<Embeddings, MetricError> {
        let row = |(index, sample): (usize, &ClipSample)| {
            self.rows[&(index, sample.start, sample.frames)]
        };
        let all = self.embeddings.as_ref().expect("added before");
        Ok(all.select(samples.iter().enumerate().map(row)))
    }
}
