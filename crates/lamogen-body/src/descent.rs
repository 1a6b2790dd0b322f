//! L-BFGS with a preconditioner (Nocedal and Wright 2006, chapters 3 and 7).
//!
//! A minimiser does not evaluate the function itself: its caller evaluates a trial point and passes value and gradient on.
//! Many minimisers can therefore run side by side, each at its own pace, while their functions are evaluated together.

use std::collections::VecDeque;

/// The number of past steps from which the curvature is estimated.
const MEMORY: usize = 8;
/// A step is accepted if the value decreases by at least this share of the decrease that the slope predicts.
const ARMIJO: f64 = 1e-4;
/// How often a step is shortened before its direction is given up.
const MAX_SHORTENINGS: usize = 10;
/// How often a step along the preconditioned gradient is shortened, of which the scale is known only roughly, before the minimiser
/// stops.
const MAX_FIRST_SHORTENINGS: usize = 40;
/// A step with a smaller relative decrease than this counts as stalled.
const MIN_DECREASE: f64 = 1e-6;
/// The number of stalled steps in a row after which the minimiser stops.
const PATIENCE: usize = 4;

/// A past step and the change of the gradient along it.
#[derive(Debug)]
struct CurvaturePair {
    step: Vec<f64>,
    /// The change of the gradient.
    change: Vec<f64>,
    /// `1 / (step · change)`.
    rho: f64,
}

/// An L-BFGS minimiser of one function.
#[derive(Debug)]
pub(crate) struct Minimizer {
    /// The best point so far, with its value and gradient.
    point: Vec<f64>,
    value: f64,
    gradient: Vec<f64>,
    /// The point that is to be evaluated next.
    trial: Vec<f64>,
    direction: Vec<f64>,
    /// The slope along the direction, which is negative.
    slope: f64,
    /// The distance of the trial point from the best point, in units of the direction.
    length: f64,
    shortenings: usize,
    memory: VecDeque<CurvaturePair>,
    /// The number of stalled steps in a row.
    stalled: usize,
    is_done: bool,
}

impl Minimizer {
    /// Starts at a point, which is also the first trial point.
    pub(crate) fn new(point: Vec<f64>) -> Minimizer {
        Minimizer {
            trial: point.clone(),
            gradient: vec![0.0; point.len()],
            direction: vec![0.0; point.len()],
            point,
            value: f64::INFINITY,
            slope: 0.0,
            length: 0.0,
            shortenings: 0,
            memory: VecDeque::new(),
            stalled: 0,
            is_done: false,
        }
    }

    /// Returns the point at which value and gradient are needed next.
    pub(crate) fn trial(&self) -> &[f64] {
        &self.trial
    }

    /// Returns the best point so far.
    pub(crate) fn point(&self) -> &[f64] {
        &self.point
    }

    /// Returns whether the minimiser has converged.
    pub(crate) fn is_done(&self) -> bool {
        self.is_done
    }

    /// Takes value and gradient at the trial point and chooses the next trial point.
    ///
    /// `precondition` multiplies a gradient in place by the inverse of a rough curvature, so that all numbers of the
    /// resulting step are on the same scale.
    pub(crate) fn update(
        &mut self,
        value: f64,
        gradient: Vec<f64>,
        precondition: &dyn Fn(&mut [f64]),
    ) {
        if self.is_done {
            return;
        }
        let is_first = self.value.is_infinite();
        let sufficient = self.value + ARMIJO * self.length * self.slope;
        // A value that is not a number fails this comparison and is rejected.
        let is_low = is_first || value <= sufficient;
        if !is_low {
            return self.shorten_step(value, precondition);
        }
        if !is_first {
            let step = difference(&self.trial, &self.point);
            let change = difference(&gradient, &self.gradient);
            let along = dot(&step, &change);
            if along > 1e-12 * dot(&change, &change).sqrt() * dot(&step, &step).sqrt() {
                if self.memory.len() == MEMORY {
                    self.memory.pop_front();
                }
                self.memory.push_back(CurvaturePair {
                    step,
                    change,
                    rho: 1.0 / along,
                });
            }
            let gain = (self.value - value) / self.value.abs().max(1e-12);
            self.stalled = if gain < MIN_DECREASE {
                self.stalled + 1
            } else {
                0
            };
            if self.stalled >= PATIENCE {
                self.is_done = true;
            }
        }
        self.point.copy_from_slice(&self.trial);
        self.value = value;
        self.gradient = gradient;
        self.choose_direction(precondition);
    }

    /// Chooses a direction by the two-loop recursion of L-BFGS, and the first trial point along it.
    fn choose_direction(&mut self, precondition: &dyn Fn(&mut [f64])) {
        let mut direction = self.gradient.clone();
        let mut shares = Vec::with_capacity(self.memory.len());
        for pair in self.memory.iter().rev() {
            let share = pair.rho * dot(&pair.step, &direction);
            add_scaled(&mut direction, -share, &pair.change);
            shares.push(share);
        }
        precondition(&mut direction);
        if let Some(pair) = self.memory.back() {
            let mut change = pair.change.clone();
            precondition(&mut change);
            let scale = 1.0 / (pair.rho * dot(&pair.change, &change));
            if scale.is_finite() && scale > 0.0 {
                direction.iter_mut().for_each(|x| *x *= scale);
            }
        }
        for (pair, share) in self.memory.iter().zip(shares.into_iter().rev()) {
            let back = pair.rho * dot(&pair.change, &direction);
            add_scaled(&mut direction, share - back, &pair.step);
        }
        self.slope = -dot(&direction, &self.gradient);
        if !(self.slope < 0.0 && self.slope.is_finite()) {
            self.is_done = self.memory.is_empty();
            self.memory.clear();
            if !self.is_done {
                self.choose_direction(precondition);
            }
            return;
        }
        direction.iter_mut().for_each(|x| *x = -*x);
        self.direction = direction;
        // Without past steps, the scale is known only roughly, from the preconditioner.
        self.length = if self.memory.is_empty() { 0.5 } else { 1.0 };
        self.shortenings = 0;
        self.set_trial();
    }

    /// Shortens the step after a rejected trial point; `value` is the value found there.
    fn shorten_step(&mut self, value: f64, precondition: &dyn Fn(&mut [f64])) {
        self.shortenings += 1;
        let most = match self.memory.is_empty() {
            true => MAX_FIRST_SHORTENINGS,
            false => MAX_SHORTENINGS,
        };
        if self.shortenings > most {
            self.is_done = self.memory.is_empty();
            self.memory.clear();
            if !self.is_done {
                self.choose_direction(precondition);
            }
            return;
        }
        // The minimum of the parabola through the value and slope at the best point and the value found.
        let curvature = value - self.value - self.length * self.slope;
        let best = -self.slope * self.length * self.length / (2.0 * curvature);
        self.length = match best.is_finite() && best > 0.0 {
            true => best.clamp(0.1 * self.length, 0.5 * self.length),
            false => 0.25 * self.length,
        };
        self.set_trial();
    }

    /// Sets the trial point from the best point, direction and length.
    fn set_trial(&mut self) {
        let numbers = self.trial.iter_mut().zip(self.point.iter());
        for ((trial, point), step) in numbers.zip(&self.direction) {
            *trial = point + self.length * step;
        }
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    // Four independent sums, so that additions do not wait for each other.
    let mut sums = [0.0; 4];
    let (a4, b4) = (a.as_chunks::<4>(), b.as_chunks::<4>());
    for (a, b) in a4.0.iter().zip(b4.0) {
        for i in 0..4 {
            sums[i] += a[i] * b[i];
        }
    }
    let rest: f64 = a4.1.iter().zip(b4.1).map(|(a, b)| a * b).sum();
    sums.iter().sum::<f64>() + rest
}

/// Adds `factor * values` to `sums`.
fn add_scaled(sums: &mut [f64], factor: f64, values: &[f64]) {
    for (sum, value) in sums.iter_mut().zip(values) {
        *sum += factor * value;
    }
}

fn difference(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a - b).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn minimise(
        start: Vec<f64>,
        function: impl Fn(&[f64]) -> (f64, Vec<f64>),
        precondition: &dyn Fn(&mut [f64]),
        evaluations: usize,
    ) -> Minimizer {
        let mut minimizer = Minimizer::new(start);
        for _ in 0..evaluations {
            let (value, gradient) = function(minimizer.trial());
            minimizer.update(value, gradient, precondition);
            if minimizer.is_done() {
                break;
            }
        }
        minimizer
    }

    #[test]
    fn a_scale_that_is_wrong_by_a_million_is_found() {
        let function = |x: &[f64]| {
            (
                x[0].powi(4) + x[0].powi(2),
                vec![4.0 * x[0].powi(3) + 2.0 * x[0]],
            )
        };
        let precondition = |step: &mut [f64]| step.iter_mut().for_each(|x| *x *= 1e6);
        let found = minimise(vec![1.0], function, &precondition, 100);
        assert!(found.point()[0].abs() < 1e-3, "{found:?}");
    }

    #[test]
    fn the_valley_of_rosenbrock_is_followed_to_its_end() {
        let function = |x: &[f64]| {
            let (a, b) = (1.0 - x[0], x[1] - x[0] * x[0]);
            let gradient = vec![-2.0 * a - 400.0 * x[0] * b, 200.0 * b];
            (a * a + 100.0 * b * b, gradient)
        };
        let found = minimise(
            vec![-1.2, 1.0],
            function,
            &|step| step.iter_mut().for_each(|x| *x *= 1e-3),
            200,
        );
        assert!(found.value < 1e-9, "{found:?}");
    }

    #[test]
    fn a_good_preconditioner_saves_most_of_the_way() {
        // The curvatures range from 1 to a million.
        let curvature = |i: usize| 10f64.powf(6.0 * i as f64 / 99.0);
        let function = |x: &[f64]| {
            let value = x
                .iter()
                .enumerate()
                .map(|(i, x)| 0.5 * curvature(i) * x * x);
            let gradient = x.iter().enumerate().map(|(i, x)| curvature(i) * x);
            (value.sum(), gradient.collect())
        };
        let scaled = |step: &mut [f64]| {
            for (i, x) in step.iter_mut().enumerate() {
                *x /= curvature(i);
            }
        };
        let plain = |step: &mut [f64]| step.iter_mut().for_each(|x| *x *= 1e-6);
        let start = vec![1.0; 100];
        let good = minimise(start.clone(), function, &scaled, 15);
        let bad = minimise(start, function, &plain, 15);
        assert!(
            good.value < 1e-9 && bad.value > 1e-3,
            "{} {}",
            good.value,
            bad.value
        );
    }

    #[test]
    fn values_that_are_not_finite_are_stepped_back_from() {
        // The function is finite only below 1, and its minimum is at 0.5.
        let function = |x: &[f64]| match x[0] < 1.0 {
            true => ((x[0] - 0.5).powi(2), vec![2.0 * (x[0] - 0.5)]),
            false => (f64::NAN, vec![f64::NAN]),
        };
        let found = minimise(vec![-5.0], function, &|_| (), 60);
        assert!((found.point()[0] - 0.5).abs() < 1e-6, "{found:?}");
    }
}
