//! Linear systems along time whose unknowns touch their next neighbours only.

/// How many neighbours on each side.
pub(crate) const REACH: usize = 3;

/// A symmetric matrix with ones on the diagonal of `L` in `L D Lᵀ`: `lower[t][k]` joins `t` with `t - 1 - k`.
#[derive(Clone, Debug)]
pub(crate) struct Banded {
    diagonal: Vec<f64>,
    lower: Vec<[f64; REACH]>,
}

/// The second and third difference.
pub(crate) const SECOND: [f64; 3] = [1.0, -2.0, 1.0];
pub(crate) const THIRD: [f64; 4] = [-1.0, 3.0, -3.0, 1.0];

impl Banded {
    /// The factors of `diagonal I + second D₂ᵀD₂ + third D₃ᵀD₃` over so many frames.
    ///
    /// # Panics
    ///
    /// If the diagonal is not above 0.
    pub(crate) fn new(
        frames: usize,
        own: impl Fn(usize) -> f64,
        second: f64,
        third: f64,
    ) -> Banded {
        let mut diagonal: Vec<f64> = (0..frames).map(own).collect();
        assert!(diagonal.iter().all(|&x| x > 0.0), "a curvature is positive");
        let mut lower = vec![[0.0; REACH]; frames];
        let mut join = |factors: &[f64], weight: f64| {
            for start in 0..(frames + 1).saturating_sub(factors.len()) {
                for (i, a) in factors.iter().enumerate() {
                    diagonal[start + i] += weight * a * a;
                    for (j, b) in factors[..i].iter().enumerate() {
                        lower[start + i][i - j - 1] += weight * a * b;
                    }
                }
            }
        };
        join(&SECOND, second);
        join(&THIRD, third);
        for t in 0..frames {
            for k in (0..REACH.min(t)).rev() {
                // The entry at (t, t - 1 - k), less what the columns before it take.
                let column = t - 1 - k;
                let mut value = lower[t][k];
                for m in k + 1..REACH.min(t) {
                    let before = t - 1 - m;
                    if column - before <= REACH {
                        value -=
                            lower[t][m] * diagonal[before] * lower[column][column - before - 1];
                    }
                }
                lower[t][k] = value / diagonal[column];
            }
            for k in 0..REACH.min(t) {
                diagonal[t] -= lower[t][k] * lower[t][k] * diagonal[t - 1 - k];
            }
        }
        Banded { diagonal, lower }
    }

    /// Solves for the numbers at `offset`, `offset + stride`, …, a frame each.
    pub(crate) fn solve(&self, values: &mut [f64], offset: usize, stride: usize) {
        let frames = self.diagonal.len();
        let at = |t: usize| offset + t * stride;
        for t in 0..frames {
            for k in 0..REACH.min(t) {
                values[at(t)] -= self.lower[t][k] * values[at(t - 1 - k)];
            }
        }
        for t in 0..frames {
            values[at(t)] /= self.diagonal[t];
        }
        for t in (0..frames).rev() {
            for k in 0..REACH.min(t) {
                values[at(t - 1 - k)] -= self.lower[t][k] * values[at(t)];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_solved_gives_the_right_side_again() {
        for frames in [1, 2, 3, 4, 5, 30] {
            let own = |t: usize| 0.1 + 0.05 * (t as f64).sin().abs();
            let banded = Banded::new(frames, own, 2.0, 5.0);
            let right: Vec<f64> = (0..2 * frames).map(|i| (i as f64 * 0.7).cos()).collect();
            let mut solved = right.clone();
            banded.solve(&mut solved, 1, 2);
            let x: Vec<f64> = (0..frames).map(|t| solved[1 + 2 * t]).collect();
            let mut back: Vec<f64> = (0..frames).map(|t| own(t) * x[t]).collect();
            for (factors, weight) in [(&SECOND[..], 2.0), (&THIRD[..], 5.0)] {
                for start in 0..(frames + 1).saturating_sub(factors.len()) {
                    let difference: f64 = { factors.iter().enumerate() }
                        .map(|(i, a)| a * x[start + i])
                        .sum();
                    for (i, a) in factors.iter().enumerate() {
                        back[start + i] += weight * a * difference;
                    }
                }
            }
            for t in 0..frames {
                assert!(
                    (back[t] - right[1 + 2 * t]).abs() < 1e-9,
                    "{frames} frames, {t}"
                );
                assert_eq!(solved[2 * t], right[2 * t]);
            }
        }
    }
}
