//! R-precision of real motions.

use crate::{CaptionedMotions, MetricError, RetrievalBatches};

/// R-precision and distance of real motions and their own captions. They show how good an evaluator is, and are the
/// reference for generated motions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RealMotions {
    /// R-precision: the shares of texts, 0 to 1, that have their own motion as the nearest of 32, among the two nearest,
    /// and among the three nearest. By chance they are 1/32, 2/32 and 3/32.
    pub r_precision: [Estimate; 3],
    /// The mean distance from a text to its own motion.
    pub distance: Estimate,
    /// The number of motions.
    pub motions: usize,
    /// The number of batches of 32 pairs over all repetitions.
    pub batches: usize,
    /// The number of repetitions, each with new captions and batches.
    pub repetitions: usize,
}

/// A mean over repetitions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// The mean.
    pub mean: f64,
    /// Half of the 95 % confidence interval: 1.96 σ / √n, with the standard deviation σ of n repetitions. It shows how
    /// much the choice of captions and batches matters, not how much other motions would change the mean.
    pub interval: f64,
}

/// Computes R-precision of real motions in [batches](RetrievalBatches::distinct) of 32 pairs with distinct captions.
/// Every repetition draws captions and batches from a seed of its own: `seed`, `seed + 1`, ….
///
/// # Errors
///
/// If there are fewer than 32 motions with captions that differ.
///
/// # Panics
///
/// If there is no repetition.
pub fn evaluate_real_motions(
    motions: &CaptionedMotions,
    repetitions: usize,
    seed: u64,
) -> Result<RealMotions, MetricError> {
    assert!(repetitions > 0, "expected at least one repetition");
    let score = |repetition| {
        motions.score_batches(RetrievalBatches::SIZE, seed.wrapping_add(repetition as u64))
    };
    let results: Result<Vec<_>, _> = (0..repetitions).map(score).collect();
    let results = results?;
    let scores = results.iter().map(|result| result.score);
    Ok(RealMotions {
        r_precision: [0, 1, 2]
            .map(|rank| Estimate::of(scores.clone().map(|score| score.r_precision[rank]))),
        distance: Estimate::of(scores.map(|score| score.distance)),
        motions: motions.len(),
        batches: results.iter().map(|result| result.batches).sum(),
        repetitions,
    })
}

impl Estimate {
    /// Computes mean and interval of the values of repetitions. The interval of a single value is 0.
    ///
    /// # Panics
    ///
    /// If there is no value.
    pub fn of(values: impl IntoIterator<Item = f64>) -> Estimate {
        let values: Vec<f64> = values.into_iter().collect();
        let count = values.len() as f64;
        assert!(count > 0.0, "expected at least one value");
        let mean = values.iter().sum::<f64>() / count;
        let squares = values.iter().map(|value| (value - mean) * (value - mean));
        // The deviation is that of `numpy.std`, which the public code uses.
        let deviation = (squares.sum::<f64>() / count).sqrt();
        Estimate {
            mean,
            interval: 1.96 * deviation / count.sqrt(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_estimate_is_a_mean_with_its_interval() {
        let estimate = Estimate::of([1.0, 3.0, 1.0, 3.0]);
        assert_eq!((estimate.mean, estimate.interval), (2.0, 1.96 / 2.0));
        assert_eq!(Estimate::of([5.0]).interval, 0.0);
    }
}
