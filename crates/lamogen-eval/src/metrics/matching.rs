//! R-precision and matching score: whether texts are nearest to their own motions.

use super::embeddings::distance;
use super::{Embeddings, MetricError};

/// R-precision and mean distance of pairs of text and motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MatchingScore {
    /// R-precision: the shares of texts, 0 to 1, that have their own motion as the nearest of the batch, among the two
    /// nearest, and among the three nearest. By chance they are 1, 2 and 3 divided by the size of a batch.
    pub r_precision: [f64; 3],
    /// The mean distance from a text to its own motion ("matching score" or "multimodal distance"). Smaller is better.
    pub distance: f64,
    /// The number of pairs that were compared.
    pub pairs: usize,
}

impl MatchingScore {
    /// Compares every text with the motions of its batch by Euclidean distance. If two motions are equally near, the
    /// earlier one in the batch counts as nearer.
    ///
    /// # Errors
    ///
    /// If there are not as many motions as texts, the widths differ, or no batch has a pair.
    ///
    /// # Panics
    ///
    /// If a batch has the index of a pair that does not exist.
    pub fn of(
        texts: &Embeddings,
        motions: &Embeddings,
        batches: &[Vec<usize>],
    ) -> Result<MatchingScore, MetricError> {
        texts.check_width(motions)?;
        if texts.len() != motions.len() {
            return Err(MetricError::Mismatch {
                what: "as many motions as texts, a number",
                expected: texts.len(),
                found: motions.len(),
            });
        }
        let (mut rank_counts, mut sum, mut pairs) = ([0usize; 3], 0.0, 0);
        for batch in batches {
            for (index, &pair) in batch.iter().enumerate() {
                let distance_to = |motion: usize| distance(texts.row(pair), motions.row(motion));
                let own = distance_to(pair);
                let nearer = batch.iter().enumerate().filter(|&(other_index, &other)| {
                    let other = distance_to(other);
                    other_index != index && (other < own || other == own && other_index < index)
                });
                let nearer = nearer.count();
                for (rank, count) in rank_counts.iter_mut().enumerate() {
                    *count += usize::from(nearer <= rank);
                }
                sum += own;
                pairs += 1;
            }
        }
        match pairs {
            0 => Err(MetricError::TooFew {
                metric: "R-precision",
                what: "pair in a batch",
                needed: 1,
                found: 0,
            }),
            pairs => Ok(MatchingScore {
                r_precision: rank_counts.map(|count| count as f64 / pairs as f64),
                distance: sum / pairs as f64,
                pairs,
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn embeddings(values: &[f32]) -> Embeddings {
        Embeddings::new(values.to_vec(), 1).unwrap()
    }

    #[test]
    fn a_text_is_ranked_among_its_batch_only() {
        // Text 0 is nearest to its own motion, text 1 to motion 2, text 2 to motions 1 and 3.
        let texts = embeddings(&[0.0, 10.0, 20.0, 30.0]);
        let motions = embeddings(&[0.5, 18.0, 11.0, 24.0]);
        let all = MatchingScore::of(&texts, &motions, &[vec![0, 1, 2, 3]]).unwrap();
        assert_eq!(all.r_precision, [0.5, 0.75, 1.0]);
        assert_eq!(all.distance, (0.5 + 8.0 + 9.0 + 6.0) / 4.0);
        let apart = MatchingScore::of(&texts, &motions, &[vec![0, 1], vec![2, 3]]).unwrap();
        assert_eq!(apart.r_precision, [0.75, 1.0, 1.0]);
    }

    #[test]
    fn a_network_that_gives_one_embedding_for_everything_is_as_good_as_chance() {
        let same = embeddings(&[1.0; 32]);
        let found = MatchingScore::of(&same, &same, &[(0..32).collect()]).unwrap();
        assert_eq!(found.r_precision, [1.0 / 32.0, 2.0 / 32.0, 3.0 / 32.0]);
    }

    #[test]
    fn sets_that_do_not_fit_each_other_are_refused() {
        let (three, four) = (embeddings(&[0.0; 3]), embeddings(&[0.0; 4]));
        assert!(MatchingScore::of(&three, &four, &[vec![0]]).is_err());
        assert!(MatchingScore::of(&three, &three, &[]).is_err());
    }
}
