//! What an evaluator makes of real motions.

use crate::{CaptionedMotions, MetricError, RetrievalBatches};

/// How well real motions fit their own captions: what an evaluator is worth, and what generated motions are measured
/// against.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RealMotions {
    /// The share of texts, 0 to 1, whose own motion is the nearest, among the two, among the three nearest of 32. By chance
    /// 1/32, 2/32, 3/32.
    pub r_precision: [Estimate; 3],
    /// The mean distance from a text to its own motion.
    pub distance: Estimate,
    /// Motions that there are.
    pub motions: usize,
    /// RetrievalBatches of 32 pairs over all repetitions.
    pub batches: usize,
    /// How often captions and batches were drawn.
    pub repetitions: usize,
}

/// A mean over repetitions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// The mean.
    pub mean: f64,
    /// Half of the 95 % interval, 1.96 σ / √n, with the standard deviation σ of n repetitions. It tells how much captions and
    /// batches matter, not how much other motions would.
    pub interval: f64,
}

/// R-precision of real motions in [batches](RetrievalBatches::distinct) of 32 pairs with distinct captions. Every repetition draws
/// captions and batches anew from a seed of its own: `seed`, `seed + 1`, ….
///
/// # Errors
///
/// If there are fewer than 32 motions with captions that differ.
///
/// # Panics
///
/// If there is no repetition.
pub fn real_motions(
    motions: &CaptionedMotions,
    repetitions: usize,
    seed: u64,
) -> Result<RealMotions, MetricError> {
    assert!(repetitions > 0, "expected at least one repetition");
    let draw =
        |repetition| motions.draw(RetrievalBatches::SIZE, seed.wrapping_add(repetition as u64));
    let drawn: Result<Vec<_>, _> = (0..repetitions).map(draw).collect();
    let drawn = drawn?;
    let matchings = drawn.iter().map(|drawn| drawn.matching);
    Ok(RealMotions {
        r_precision: [0, 1, 2]
            .map(|rank| Estimate::of(matchings.clone().map(|matching| matching.r_precision[rank]))),
        distance: Estimate::of(matchings.map(|matching| matching.distance)),
        motions: motions.len(),
        batches: drawn.iter().map(|drawn| drawn.batches).sum(),
        repetitions,
    })
}

impl Estimate {
    /// Mean and interval of what repetitions gave. The interval of a single one is 0.
    ///
    /// # Panics
    ///
    /// If there is none.
    pub fn of(values: impl IntoIterator<Item = f64>) -> Estimate {
        let values: Vec<f64> = values.into_iter().collect();
        let count = values.len() as f64;
        assert!(count > 0.0, "expected at least one value");
        let mean = values.iter().sum::<f64>() / count;
        let squares = values.iter().map(|value| (value - mean) * (value - mean));
        // As numpy.std, which the public code uses.
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
