//! Which two of three clips people find alike: a model of choices by distances of features.
//!
//! With differences `d` of a pair's logarithmic features and a weight `w` for each feature, a pair is chosen with a probability proportional to `exp(-Σ w d)`. Where the pair
//! without the neutral clip may be chosen less for its place on the screen, that pair has a bias besides.

use super::study::{PAIRS, Triple};

/// The differences of the features of each pair of a triple, with the answers.
#[derive(Clone, Debug, PartialEq)]
pub struct Choice {
    /// For each pair, the absolute difference of each feature.
    pub differences: [Vec<f64>; 3],
    pub answers: [f64; 3],
}

impl Choice {
    /// Returns the choice of a triple. `features` are those of every clip.
    pub fn of(triple: &Triple, features: &[Vec<f64>]) -> Choice {
        Choice {
            differences: PAIRS.map(|(a, b)| {
                let [a, b] = [a, b].map(|place| &features[triple.clips[place]]);
                a.iter().zip(b).map(|(a, b)| (a - b).abs()).collect()
            }),
            answers: triple.answers.map(f64::from),
        }
    }

    /// Returns the number of answers.
    pub fn count(&self) -> f64 {
        self.answers.iter().sum()
    }
}

/// The fitted weights.
#[derive(Clone, Debug, PartialEq)]
pub struct ChoiceModel {
    /// The weight of a unit of each feature, at least 0.
    pub weights: Vec<f64>,
    /// The bias of the pair without the neutral clip.
    pub bias: f64,
}

/// How often weights and bias are improved in turn; they are found long before.
const ROUNDS: usize = 200;
/// The change of a weight below which it is found.
const PRECISION: f64 = 1e-7;

impl ChoiceModel {
    /// Returns a model in which each feature counts alike.
    pub fn equal(features: usize) -> ChoiceModel {
        ChoiceModel {
            weights: vec![1.0; features],
            bias: 0.0,
        }
    }

    /// Finds the weights and the bias under which the answers are most probable. `factors` says how much each choice counts.
    pub fn fit(choices: &[Choice], factors: &[f64]) -> ChoiceModel {
        let features = choices
            .first()
            .map_or(0, |choice| choice.differences[0].len());
        let mut model = ChoiceModel::equal(features);
        // The likelihood is concave, so that Newton's steps along one coordinate at a time find its maximum.
        for _ in 0..ROUNDS {
            let mut largest = 0.0f64;
            for coordinate in 0..=features {
                let (mut slope, mut curvature) = (0.0, 0.0);
                for (choice, factor) in choices.iter().zip(factors).filter(|(_, f)| **f > 0.0) {
                    let value = |pair: usize| match coordinate {
                        _ if coordinate < features => -choice.differences[pair][coordinate],
                        _ => f64::from(u8::from(pair == 1)),
                    };
                    let probabilities = model.probabilities(choice);
                    let mean: f64 = (0..3).map(|pair| probabilities[pair] * value(pair)).sum();
                    let chosen: f64 = (0..3).map(|pair| choice.answers[pair] * value(pair)).sum();
                    let spread = (0..3).map(|pair| {
                        let difference = value(pair) - mean;
                        probabilities[pair] * difference * difference
                    });
                    slope += factor * (chosen - choice.count() * mean);
                    curvature += factor * choice.count() * spread.sum::<f64>();
                }
                if curvature <= 0.0 {
                    continue;
                }
                // A step is bounded, because far from the maximum the curvature is small.
                let step = (slope / curvature).clamp(-1.0, 1.0);
                let parameter = match coordinate {
                    _ if coordinate < features => &mut model.weights[coordinate],
                    _ => &mut model.bias,
                };
                let before = *parameter;
                *parameter += step;
                if coordinate < features {
                    *parameter = parameter.max(0.0);
                }
                largest = largest.max((*parameter - before).abs());
            }
            if largest < PRECISION {
                break;
            }
        }
        model
    }

    /// Returns the probability of each pair.
    pub fn probabilities(&self, choice: &Choice) -> [f64; 3] {
        let mut utilities = [0.0; 3];
        for (pair, utility) in utilities.iter_mut().enumerate() {
            let terms = self.weights.iter().zip(&choice.differences[pair]);
            *utility = -terms
                .map(|(weight, difference)| weight * difference)
                .sum::<f64>();
        }
        utilities[1] += self.bias;
        let largest = utilities.iter().copied().fold(f64::MIN, f64::max);
        let exponentials = utilities.map(|utility| (utility - largest).exp());
        let sum: f64 = exponentials.iter().sum();
        exponentials.map(|value| value / sum)
    }

    /// Returns the number of answers that name the most probable pair. Pairs that are equally probable share it.
    pub fn hits(&self, choice: &Choice) -> f64 {
        let probabilities = self.probabilities(choice);
        let largest = probabilities.iter().copied().fold(0.0, f64::max);
        let best = |pair: &usize| probabilities[*pair] >= largest - 1e-12;
        let pairs: Vec<usize> = (0..3).filter(best).collect();
        let answers: f64 = pairs.iter().map(|&pair| choice.answers[pair]).sum();
        answers / pairs.len() as f64
    }
}

/// Returns the number of answers that name what most of the other answers to the same question name: what a model that knows everything but the
/// person could predict.
pub fn predictable(choice: &Choice) -> f64 {
    let mut hits = 0.0;
    for pair in 0..3 {
        let mut others = choice.answers;
        if others[pair] == 0.0 {
            continue;
        }
        others[pair] -= 1.0;
        let most = others.iter().copied().fold(0.0, f64::max);
        let best = others.iter().filter(|count| **count == most).count();
        if others[pair] == most {
            hits += choice.answers[pair] / best as f64;
        }
    }
    hits
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Choices among clips on a grid of two features, answered as a model says.
    fn choices(model: &ChoiceModel) -> Vec<Choice> {
        let values = [-1.0, -0.3, 0.0, 0.2, 0.9];
        let mut found = Vec::new();
        for left in 0..25 {
            for right in 0..left {
                let point =
                    |index: usize| -> [f64; 2] { [values[index / 5], values[index % 5] * 0.7] };
                let clips = [point(left), [0.1, 0.05], point(right)];
                let differences = PAIRS.map(|(a, b)| {
                    let pairs = clips[a].iter().zip(&clips[b]);
                    pairs.map(|(a, b)| (a - b).abs()).collect()
                });
                let mut choice = Choice {
                    differences,
                    answers: [0.0; 3],
                };
                choice.answers = model.probabilities(&choice).map(|p| 10.0 * p);
                found.push(choice);
            }
        }
        found
    }

    #[test]
    fn the_weights_that_made_the_answers_are_found() {
        let model = ChoiceModel {
            weights: vec![2.0, 0.5],
            bias: -0.4,
        };
        let choices = choices(&model);
        let found = ChoiceModel::fit(&choices, &vec![1.0; choices.len()]);
        for (found, expected) in found.weights.iter().zip(&model.weights) {
            assert!((found - expected).abs() < 1e-3, "{found} {expected}");
        }
        assert!((found.bias + 0.4).abs() < 1e-3, "{}", found.bias);
    }

    #[test]
    fn a_feature_that_people_do_not_see_has_no_weight() {
        let model = ChoiceModel {
            weights: vec![1.5, 0.0],
            bias: 0.0,
        };
        let choices = choices(&model);
        let found = ChoiceModel::fit(&choices, &vec![1.0; choices.len()]);
        assert!(found.weights[1] < 1e-3, "{found:?}");
        // Choices that do not count change nothing.
        let mut factors = vec![1.0; choices.len()];
        let mut wrong = choices.clone();
        wrong[5].answers = [0.0, 1000.0, 0.0];
        factors[5] = 0.0;
        let found = ChoiceModel::fit(&wrong, &factors);
        assert!((found.weights[0] - 1.5).abs() < 1e-3, "{found:?}");
    }

    #[test]
    fn hits_and_what_can_be_predicted_are_counted_by_answers() {
        let choice = |differences: [f64; 3], answers| Choice {
            differences: differences.map(|difference| vec![difference]),
            answers,
        };
        let model = ChoiceModel::equal(1);
        assert_eq!(model.hits(&choice([0.1, 0.5, 0.4], [7.0, 2.0, 1.0])), 7.0);
        // Equal pairs share the answers.
        assert_eq!(model.hits(&choice([0.1, 0.5, 0.1], [7.0, 2.0, 1.0])), 4.0);
        assert_eq!(predictable(&choice([0.0; 3], [7.0, 2.0, 1.0])), 7.0);
        assert_eq!(predictable(&choice([0.0; 3], [5.0, 5.0, 0.0])), 0.0);
        assert_eq!(predictable(&choice([0.0; 3], [1.0, 0.0, 0.0])), 1.0 / 3.0);
    }
}
