//! The learning rate over a run.

use crate::config::Recipe;

/// The learning rate of a step: a linear warm-up, then half a cosine down to the last share of it.
pub(crate) fn learning_rate(recipe: &Recipe, step: u64, steps: u64) -> f64 {
    let warm_up = (step + 1) as f64 / recipe.warm_up_steps.max(1) as f64;
    let done = step as f64 / steps.max(1) as f64;
    let cosine = 0.5 * (1.0 + (std::f64::consts::PI * done.min(1.0)).cos());
    let last = recipe.last_learning_rate;
    recipe.learning_rate * warm_up.min(1.0) * (last + (1.0 - last) * cosine)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_learning_rate_rises_then_falls_to_its_last_share() {
        let recipe = Recipe {
            learning_rate: 2.0,
            warm_up_steps: 10,
            last_learning_rate: 0.1,
            ..Recipe::default()
        };
        let rates: Vec<f64> = (0..=100).map(|step| learning_rate(&recipe, step, 100)).collect();
        assert!((rates[0] - 0.2).abs() < 1e-3);
        assert!(rates[..9].is_sorted());
        assert!(rates[10..].iter().rev().is_sorted());
        assert!((rates[100] - 0.2).abs() < 1e-9);
        assert!((rates[50] - 2.0 * (0.1 + 0.45)).abs() < 1e-9);
    }
}
