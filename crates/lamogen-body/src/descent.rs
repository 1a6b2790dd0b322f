//! L-BFGS with a preconditioner (Nocedal and Wright 2006, chapters 3 and 7), as a machine that is told values: many of them can
//! go down together, each at its own pace, while whoever evaluates does so for all at once.

use std::collections::VecDeque;

/// Steps that the curvature is learned from.
const MEMORY: usize = 8;
/// The share of the decrease that the slope promises with which a step is good enough.
const ARMIJO: f64 = 1e-4;
/// Halvings of a step before its direction is given up.
const HALVINGS: usize = 10;
/// Relative decrease below which a step counts as none.
const STALLED: f64 = 1e-6;
/// How many of those in a row end the descent.
const PATIENCE: usize = 4;

/// One step and what the gradient did along it.
#[derive(Debug)]
struct Pair {
    step: Vec<f64>,
    change: Vec<f64>,
    /// 1 / (step · change)
    rho: f64,
}

/// The way of one point down a function.
#[derive(Debug)]
pub(crate) struct Descent {
    point: Vec<f64>,
    value: f64,
    gradient: Vec<f64>,
    trial: Vec<f64>,
    direction: Vec<f64>,
    /// Slope along the direction, negative.
    slope: f64,
    length: f64,
    halvings: usize,
    memory: VecDeque<Pair>,
    stalled: usize,
    is_done: bool,
}

impl Descent {
    /// Begins at a point; its value is asked for first.
    pub(crate) fn new(point: Vec<f64>) -> Descent {
        Descent {
            trial: point.clone(),
            gradient: vec![0.0; point.len()],
            direction: vec![0.0; point.len()],
            point,
            value: f64::INFINITY,
            slope: 0.0,
            length: 0.0,
            halvings: 0,
            memory: VecDeque::new(),
            stalled: 0,
            is_done: false,
        }
    }

    /// The point whose value and gradient are asked for.
    pub(crate) fn trial(&self) -> &[f64] {
        &self.trial
    }

    /// The best point so far.
    pub(crate) fn point(&self) -> &[f64] {
        &self.point
    }

    /// Whether nothing is left to gain.
    pub(crate) fn is_done(&self) -> bool {
        self.is_done
    }

    /// Takes value and gradient at the trial point and chooses the next one. `precondition` turns a gradient into a step whose
    /// numbers have all come to the same scale: the inverse of a rough curvature.
    pub(crate) fn tell(
        &mut self,
        value: f64,
        gradient: Vec<f64>,
        precondition: &dyn Fn(&mut [f64]),
    ) {
        if self.is_done {
            return;
        }
        let is_first = self.value.is_infinite();
        let enough = self.value + ARMIJO * self.length * self.slope;
        // What is not a number is not low enough either.
        let is_low = is_first || value <= enough;
        if !is_low {
            return self.shorten(value, precondition);
        }
        if !is_first {
            let step = difference(&self.trial, &self.point);
            let change = difference(&gradient, &self.gradient);
            let along = dot(&step, &change);
            if along > 1e-12 * dot(&change, &change).sqrt() * dot(&step, &step).sqrt() {
                if self.memory.len() == MEMORY {
                    self.memory.pop_front();
                }
                self.memory.push_back(Pair {
                    step,
                    change,
                    rho: 1.0 / along,
                });
            }
            let gain = (self.value - value) / self.value.abs().max(1e-12);
            self.stalled = if gain < STALLED { self.stalled + 1 } else { 0 };
            if self.stalled >= PATIENCE {
                self.is_done = true;
            }
        }
        self.point.copy_from_slice(&self.trial);
        self.value = value;
        self.gradient = gradient;
        self.aim(precondition);
    }

    /// Chooses a direction and the first trial along it.
    fn aim(&mut self, precondition: &dyn Fn(&mut [f64])) {
        let mut direction = self.gradient.clone();
        let mut shares = Vec::with_capacity(self.memory.len());
        for pair in self.memory.iter().rev() {
            let share = pair.rho * dot(&pair.step, &direction);
            add(&mut direction, -share, &pair.change);
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
            add(&mut direction, share - back, &pair.step);
        }
        self.slope = -dot(&direction, &self.gradient);
        if !(self.slope < 0.0 && self.slope.is_finite()) {
            self.is_done = self.memory.is_empty();
            self.memory.clear();
            if !self.is_done {
                self.aim(precondition);
            }
            return;
        }
        direction.iter_mut().for_each(|x| *x = -*x);
        self.direction = direction;
        // The preconditioner knows the scale only roughly.
        self.length = if self.memory.is_empty() { 0.5 } else { 1.0 };
        self.halvings = 0;
        self.place_trial();
    }

    fn shorten(&mut self, value: f64, precondition: &dyn Fn(&mut [f64])) {
        self.halvings += 1;
        if self.halvings > HALVINGS {
            self.is_done = self.memory.is_empty();
            self.memory.clear();
            if !self.is_done {
                self.aim(precondition);
            }
            return;
        }
        // The least of the parabola through value, slope and the value found.
        let curved = value - self.value - self.length * self.slope;
        let best = -self.slope * self.length * self.length / (2.0 * curved);
        self.length = match best.is_finite() && best > 0.0 {
            true => best.clamp(0.1 * self.length, 0.5 * self.length),
            false => 0.25 * self.length,
        };
        self.place_trial();
    }

    fn place_trial(&mut self) {
        let places = self.trial.iter_mut().zip(self.point.iter());
        for ((trial, point), step) in places.zip(&self.direction) {
            *trial = point + self.length * step;
        }
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    // Four sums that do not wait for each other.
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

fn add(to: &mut [f64], share: f64, what: &[f64]) {
    for (to, what) in to.iter_mut().zip(what) {
        *to += share * what;
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
    ) -> Descent {
        let mut descent = Descent::new(start);
        for _ in 0..evaluations {
            let (value, gradient) = function(descent.trial());
            descent.tell(value, gradient, precondition);
            if descent.is_done() {
                break;
            }
        }
        descent
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
        // Curvatures from 1 to a million.
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
        // Finite below 1 only; the least is at 0.5.
        let function = |x: &[f64]| match x[0] < 1.0 {
            true => ((x[0] - 0.5).powi(2), vec![2.0 * (x[0] - 0.5)]),
            false => (f64::NAN, vec![f64::NAN]),
        };
        let found = minimise(vec![-5.0], function, &|_| (), 60);
        assert!((found.point()[0] - 0.5).abs() < 1e-6, "{found:?}");
    }
}
