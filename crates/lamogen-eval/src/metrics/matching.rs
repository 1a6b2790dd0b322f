//! Whether texts find their motions.

use super::embeddings::distance;
use super::{Embeddings, MetricError};

/// How well texts and motions belong together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MatchingScore {
    /// R-precision: the share of texts, 0 to 1, whose own motion is the nearest, among the two nearest, among the three
    /// nearest of its batch. By chance it is 1, 2, 3 over the size of a batch.
    pub r_precision: [f64; 3],
    /// The mean distance from a text to its own motion ("matching score" or "multimodal distance"). Smaller is better.
    pub distance: f64,
    /// Pairs that were looked at.
    pub pairs: usize,
}

impl MatchingScore {
    /// Compares every text with the motions of its batch, by Euclidean distance. Of motions equally near, the earlier
    /// in the batch counts as nearer.
    ///
    /// # Errors
    ///
    /// If there are not as many motions as texts, they have different widths, or there is no pair in any batch.
    ///
    /// # Panics
    ///
    /// If a batch names a pair that is not there.
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
        let (mut within, mut sum, mut pairs) = ([0usize; 3], 0.0, 0);
        for batch in batches {
            for (place, &pair) in batch.iter().enumerate() {
                let to = |motion: usize| distance(texts.row(pair), motions.row(motion));
                let own = to(pair);
                let nearer = batch.iter().enumerate().filter(|&(other_place, &other)| {
                    let other = to(other);
                    other_place != place && (other < own || other == own && other_place < place)
                });
                let nearer = nearer.count();
                for (rank, count) in within.iter_mut().enumerate() {
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
                r_precision: within.map(|count| count as f64 / pairs as f64),
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
        // Text 0 is nearest to its own motion, text 1 to the motion of 2, text 2 to those of 1 and 3.
        let texts = embeddings(&[0.0, 10.0, 20.0, 30.0]);
        let motions = embeddings(&[0.5, 18.0, 11.0, 24.0]);
        let all = MatchingScore::of(&texts, &motions, &[vec![0, 1, 2, 3]]).unwrap();
        assert_eq!(all.r_precision, [0.5, 0.75, 1.0]);
        assert_eq!(all.distance, (0.5 + 8.0 + 9.0 + 6.0) / 4.0);
        let apart = MatchingScore::of(&texts, &motions, &[vec![0, 1], vec![2, 3]]).unwrap();
        assert_eq!(apart.r_precision, [0.75, 1.0, 1.0]);
    }

    #[test]
    fn a_network_that_says_the_same_of_everything_is_as_good_as_chance() {
        let same = embeddings(&[1.0; 32]);
        let found = MatchingScore::of(&same, &same, &[(0..32).collect()]).unwrap();
        assert_eq!(found.r_precision, [1.0 / 32.0, 2.0 / 32.0, 3.0 / 32.0]);
    }

    #[test]
    fn sets_that_do_not_belong_together_are_refused() {
        let (three, four) = (embeddings(&[0.0; 3]), embeddings(&[0.0; 4]));
        assert!(MatchingScore::of(&three, &four, &[vec![0]]).is_err());
        assert!(MatchingScore::of(&three, &three, &[]).is_err());
    }
}
