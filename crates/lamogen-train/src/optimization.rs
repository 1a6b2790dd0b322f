//! The optimiser: AdamW, its learning rate over a run, and the moving average of the weights.

use burn::optim::{AdamW, AdamWConfig};
use serde::{Deserialize, Serialize};

/// The optimiser of a training. A field that a file leaves out has its default.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OptimizerConfig {
    /// The seed of the weights at the start, and of everything that is drawn at random.
    pub seed: u64,
    /// The learning rate of AdamW (Loshchilov and Hutter 2019) after the warm-up.
    pub learning_rate: f64,
    /// The number of steps in which the learning rate rises from 0.
    pub warm_up_steps: u64,
    /// The ratio of the learning rate at the end of the cosine to that after the warm-up.
    #[serde(alias = "last_learning_rate")]
    pub final_learning_rate_ratio: f64,
    /// The exponential decay rates of AdamW's two moments.
    pub betas: [f32; 2],
    /// The weight decay of AdamW, which acts on matrices, not on biases, scales and embeddings.
    pub weight_decay: f32,
    /// The largest norm of the gradient of all weights together; a longer gradient is scaled down to it.
    pub gradient_norm: f64,
    /// The decay of the exponential moving average of the weights, which is the network that a run saves. In the first steps the
    /// average moves faster.
    pub average_decay: f64,
}

impl Default for OptimizerConfig {
    fn default() -> Self {
        OptimizerConfig {
            seed: 0,
            learning_rate: 6e-4,
            warm_up_steps: 200,
            final_learning_rate_ratio: 0.01,
            betas: [0.9, 0.999],
            weight_decay: 0.01,
            gradient_norm: 1.0,
            average_decay: 0.999,
        }
    }
}

impl OptimizerConfig {
    /// Describes the first value that makes no sense; `None` if there is none.
    pub(crate) fn problem(&self) -> Option<String> {
        for (name, found) in [
            ("learning_rate", self.learning_rate),
            ("gradient_norm", self.gradient_norm),
        ] {
            if !(found.is_finite() && found > 0.0) {
                return Some(format!(
                    "optimization.{name} must be above 0, found {found}"
                ));
            }
        }
        for (name, found) in [
            ("final_learning_rate_ratio", self.final_learning_rate_ratio),
            ("betas", f64::from(self.betas[0])),
            ("betas", f64::from(self.betas[1])),
            ("average_decay", self.average_decay),
        ] {
            if !(0.0..1.0).contains(&found) {
                return Some(format!(
                    "optimization.{name} must be from 0 to below 1, found {found}"
                ));
            }
        }
        let decay = self.weight_decay;
        (!(decay.is_finite() && decay >= 0.0))
            .then(|| format!("optimization.weight_decay must be 0 or above, found {decay}"))
    }

    /// Computes the learning rate of a step: a linear warm-up, multiplied by half a cosine that falls from 1 to
    /// `final_learning_rate_ratio`. There is no cosine as long as `steps`, the number of all steps, is unknown.
    pub(crate) fn learning_rate_at(&self, step: u64, steps: Option<u64>) -> f64 {
        let warm_up = (step + 1) as f64 / self.warm_up_steps.max(1) as f64;
        let done = steps.map_or(0.0, |steps| step as f64 / steps.max(1) as f64);
        let cosine = 0.5 * (1.0 + (std::f64::consts::PI * done.min(1.0)).cos());
        let last = self.final_learning_rate_ratio;
        self.learning_rate * warm_up.min(1.0) * (last + (1.0 - last) * cosine)
    }

    /// Computes the decay of the average at a step. It is smaller in the first steps, so that the average forgets the initial
    /// weights.
    pub(crate) fn average_decay_at(&self, step: u64) -> f64 {
        self.average_decay
            .min((1 + step) as f64 / (10 + step) as f64)
    }

    /// Returns AdamW with weight decay, for matrices, and without it, for all other weights.
    pub(crate) fn adam(&self) -> [AdamW; 2] {
        let [first, second] = self.betas;
        [self.weight_decay, 0.0].map(|weight_decay| {
            AdamWConfig::new()
                .with_beta_1(first)
                .with_beta_2(second)
                // burn's default is 1e-5.
                .with_epsilon(1e-8)
                .with_weight_decay(weight_decay)
                .build()
        })
    }
}

/// Returns whether weight decay acts on the weight of `rank` axes in the modules of `path`: it does on matrices, but not on
/// biases, scales, tables of vectors and initial states.
pub(crate) fn has_weight_decay(path: &[String], rank: usize) -> bool {
    const EXCLUDED: [&str; 5] = [
        "token_embedding",
        "positional_embedding",
        "frame_embedding",
        // Weights of evaluators.
        "Tokens",
        "start",
    ];
    rank > 1 && !path.iter().any(|name| EXCLUDED.contains(&&**name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_learning_rate_rises_then_falls_to_its_last_share() {
        let optimization = OptimizerConfig {
            learning_rate: 2.0,
            warm_up_steps: 10,
            final_learning_rate_ratio: 0.1,
            ..OptimizerConfig::default()
        };
        let rates: Vec<f64> = (0..=100)
            .map(|step| optimization.learning_rate_at(step, Some(100)))
            .collect();
        assert!((rates[0] - 0.2).abs() < 1e-3);
        assert!(rates[..9].is_sorted());
        assert!(rates[10..].iter().rev().is_sorted());
        assert!((rates[100] - 0.2).abs() < 1e-9);
        assert!((rates[50] - 2.0 * (0.1 + 0.45)).abs() < 1e-9);
        assert_eq!(optimization.learning_rate_at(10_000, None), 2.0);
    }
}
