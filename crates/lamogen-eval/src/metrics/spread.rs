//! Diversity and MultiModality: how different motions are from each other.

use rand::SeedableRng;
use rand_chacha::ChaCha12Rng;

use super::embeddings::distance;
use super::{Embeddings, MetricError};

/// Computes diversity: the mean distance between `pairs` random pairs of motions of any texts.
///
/// The first motions of the pairs are drawn without replacement, and so are the second ones. The public evaluation draws
/// 300 pairs. The best value is that of real motions.
///
/// # Errors
///
/// If there are not more motions than pairs, or `pairs` is 0.
pub fn diversity(motions: &Embeddings, pairs: usize, seed: u64) -> Result<f64, MetricError> {
    mean_drawn_distance("diversity", std::slice::from_ref(motions), pairs, seed)
}

/// Computes the mean distance over all pairs of motions. [`diversity`] estimates it from random pairs; use this function
/// for sets that are too small for that.
///
/// # Errors
///
/// If there are fewer than two motions.
pub fn mean_distance(motions: &Embeddings) -> Result<f64, MetricError> {
    let count = motions.len();
    if count < 2 {
        return Err(MetricError::TooFew {
            metric: "a mean distance",
            what: "motions",
            needed: 2,
            found: count,
        });
    }
    let pairs = (0..count).flat_map(|a| (a + 1..count).map(move |b| (a, b)));
    let distances = pairs.map(|(a, b)| distance(motions.row(a), motions.row(b)));
    Ok(distances.sum::<f64>() / (count * (count - 1) / 2) as f64)
}

/// Computes MultiModality: the mean distance between `pairs` random pairs of motions of the same text, over all texts.
///
/// The same indices are drawn for every text. The first motions of the pairs are drawn without replacement, and so are
/// the second ones. The public evaluation has 30 motions for each of 100 texts and draws 10 pairs.
///
/// # Errors
///
/// If there is no text, texts have different numbers of motions or different widths, there are not more motions than
/// pairs, or `pairs` is 0.
pub fn multimodality(texts: &[Embeddings], pairs: usize, seed: u64) -> Result<f64, MetricError> {
    mean_drawn_distance("MultiModality", texts, pairs, seed)
}

/// Computes the mean distance between pairs of embeddings within each set. The same indices are drawn for all sets.
fn mean_drawn_distance(
    metric: &'static str,
    sets: &[Embeddings],
    pairs: usize,
    seed: u64,
) -> Result<f64, MetricError> {
    let too_few = |what, needed, found| MetricError::TooFew {
        metric,
        what,
        needed,
        found,
    };
    let first = sets.first().ok_or(too_few("text", 1, 0))?;
    if pairs == 0 {
        return Err(too_few("pair", 1, 0));
    }
    if first.len() <= pairs {
        return Err(too_few("motions", pairs + 1, first.len()));
    }
    for set in sets {
        first.check_width(set)?;
        if set.len() != first.len() {
            return Err(MetricError::Mismatch {
                what: "as many motions for each text, a number",
                expected: first.len(),
                found: set.len(),
            });
        }
    }
    let pairs = draw_pairs(first.len(), pairs, seed);
    mean_pair_distance(sets, &pairs)
}

/// Draws pairs of indices below `count`: the first ones without replacement, and so the second ones.
///
/// # Panics
///
/// If there are more pairs than indices.
pub fn draw_pairs(count: usize, pairs: usize, seed: u64) -> Vec<(usize, usize)> {
    let mut rng = ChaCha12Rng::seed_from_u64(seed);
    let mut draw = || rand::seq::index::sample(&mut rng, count, pairs).into_vec();
    let (left, right) = (draw(), draw());
    left.into_iter().zip(right).collect()
}

/// Computes the mean distance between the embeddings of given pairs, over all sets. With one set and pairs of any motions this is Diversity, with a set
/// for each text MultiModality.
///
/// # Errors
///
/// If there is no set or no pair.
///
/// # Panics
///
/// If a set has no embedding with an index of a pair.
pub fn mean_pair_distance(
    sets: &[Embeddings],
    pairs: &[(usize, usize)],
) -> Result<f64, MetricError> {
    let distances = sets
        .iter()
        .flat_map(|set| { pairs.iter() }.map(|&(a, b)| distance(set.row(a), set.row(b))));
    match sets.len() * pairs.len() {
        0 => Err(MetricError::TooFew {
            metric: "a mean distance",
            what: "pair",
            needed: 1,
            found: 0,
        }),
        count => Ok(distances.sum::<f64>() / count as f64),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(places: impl Iterator<Item = f32>) -> Embeddings {
        Embeddings::new(places.collect(), 1).unwrap()
    }

    #[test]
    fn diversity_is_the_mean_distance_of_draws() {
        // Two random points between 0 and 1 have a mean distance of a third.
        let motions = line((0..4000).map(|n| n as f32 / 4000.0));
        let found = diversity(&motions, 3000, 4).unwrap();
        assert!((found - 1.0 / 3.0).abs() < 0.02, "{found}");
        assert_eq!(found, diversity(&motions, 3000, 4).unwrap());
        assert_ne!(found, diversity(&motions, 3000, 5).unwrap());
    }

    #[test]
    fn the_mean_distance_is_over_all_pairs() {
        let motions = line([0.0, 1.0, 5.0].into_iter());
        assert_eq!(mean_distance(&motions).unwrap(), (1.0 + 5.0 + 4.0) / 3.0);
        let many = line((0..400).map(|n| (0.37 * n as f32).sin()));
        let [all, drawn] = [
            mean_distance(&many).unwrap(),
            diversity(&many, 300, 1).unwrap(),
        ];
        assert!((all - drawn).abs() < 0.1 * all, "{all} {drawn}");
        let message = mean_distance(&line([1.0].into_iter())).unwrap_err();
        assert!(message.to_string().contains("at least 2 motions, found 1"));
    }

    #[test]
    fn multimodality_measures_differences_within_a_text_only() {
        let texts = [0.0, 100.0].map(|place| line((0..30).map(move |_| place)));
        assert_eq!(multimodality(&texts, 10, 0).unwrap(), 0.0);
        let wide = [1.0, 3.0].map(|scale| line((0..30).map(move |n| scale * n as f32)));
        let narrow = multimodality(&wide[..1], 10, 0).unwrap();
        let both = multimodality(&wide, 10, 0).unwrap();
        assert!(
            narrow > 0.0 && (both - 2.0 * narrow).abs() < 1e-9,
            "{narrow} {both}"
        );
    }

    #[test]
    fn too_few_motions_are_refused() {
        let error = diversity(&line((0..300).map(|n| n as f32)), 300, 0).unwrap_err();
        assert_eq!(
            error.to_string(),
            "diversity needs at least 301 motions, found 300"
        );
    }
}
