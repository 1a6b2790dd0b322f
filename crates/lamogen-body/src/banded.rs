//! Banded linear systems along time: the unknown of a frame depends only on those of a few neighbouring frames.

/// The number of neighbouring frames on each side.
pub(crate) const BANDWIDTH: usize = 3;

/// A symmetric banded matrix in factorised form, `L D Lᵀ`.
///
/// The diagonal of `L` is all ones, and `lower[t][k]` is the entry of `L` in row `t` and column `t - 1 - k`.
#[derive(Clone, Debug)]
pub(crate) struct BandedFactorization {
    /// The diagonal of `D`.
    diagonal: Vec<f64>,
    lower: Vec<[f64; BANDWIDTH]>,
}

/// Factors of the second difference.
pub(crate) const SECOND_DIFFERENCE: [f64; 3] = [1.0, -2.0, 1.0];
/// Factors of the third difference.
pub(crate) const THIRD_DIFFERENCE: [f64; 4] = [-1.0, 3.0, -3.0, 1.0];

impl BandedFactorization {
    /// Factorises the matrix `diagonal I + second D₂ᵀD₂ + D₃ᵀ third D₃` of size `frames`, where `D₂` and `D₃` are the
    /// second and the third difference along frames. `third` is the weight of the third difference that ends at a frame.
    ///
    /// # Panics
    ///
    /// If a value of `diagonal` is not above 0.
    pub(crate) fn new(
        frames: usize,
        diagonal: impl Fn(usize) -> f64,
        second: f64,
        third: impl Fn(usize) -> f64,
    ) -> BandedFactorization {
        let mut diagonal: Vec<f64> = (0..frames).map(diagonal).collect();
        assert!(diagonal.iter().all(|&x| x > 0.0), "a curvature is positive");
        let mut lower = vec![[0.0; BANDWIDTH]; frames];
        let mut add_squared_difference = |factors: &[f64], weight: &dyn Fn(usize) -> f64| {
            for start in 0..(frames + 1).saturating_sub(factors.len()) {
                let weight = weight(start + factors.len() - 1);
                for (i, a) in factors.iter().enumerate() {
                    diagonal[start + i] += weight * a * a;
                    for (j, b) in factors[..i].iter().enumerate() {
                        lower[start + i][i - j - 1] += weight * a * b;
                    }
                }
            }
        };
        add_squared_difference(&SECOND_DIFFERENCE, &|_| second);
        add_squared_difference(&THIRD_DIFFERENCE, &third);
        for t in 0..frames {
            for k in (0..BANDWIDTH.min(t)).rev() {
                // The entry at (t, t - 1 - k), less the contributions of the columns before it.
                let column = t - 1 - k;
                let mut value = lower[t][k];
                for m in k + 1..BANDWIDTH.min(t) {
                    let previous = t - 1 - m;
                    if column - previous <= BANDWIDTH {
                        value -=
                            lower[t][m] * diagonal[previous] * lower[column][column - previous - 1];
                    }
                }
                lower[t][k] = value / diagonal[column];
            }
            for k in 0..BANDWIDTH.min(t) {
                diagonal[t] -= lower[t][k] * lower[t][k] * diagonal[t - 1 - k];
            }
        }
        BandedFactorization { diagonal, lower }
    }

    /// Solves the system in place for `W` right-hand sides at once. Those of a frame stand in `values` beside each other, the
    /// first frame's at `offset`, and those of the following frames `stride` numbers further each; the solutions are written there.
    pub(crate) fn solve<const W: usize>(&self, values: &mut [f64], offset: usize, stride: usize) {
        let rows = values[offset..].chunks_mut(stride);
        let rows = rows.zip(self.lower.iter().zip(&self.diagonal));
        // The solutions of the frames before, the nearest first.
        let mut before = [[0.0; W]; BANDWIDTH];
        for (row, (lower, diagonal)) in rows {
            let row = row.first_chunk_mut::<W>().expect("a row for every frame");
            let mut solved = *row;
            for (factor, other) in lower.iter().zip(&before) {
                subtract(&mut solved, *factor, other);
            }
            *row = solved.map(|x| x / diagonal);
            before = [solved, before[0], before[1]];
        }
        // The solutions of the frames after, with the rows of the factor that belong to them.
        let mut after = [([0.0; W], [0.0; BANDWIDTH]); BANDWIDTH];
        for (t, lower) in self.lower.iter().enumerate().rev() {
            let place = offset + t * stride;
            let row = values[place..].first_chunk_mut::<W>();
            let row = row.expect("a row for every frame");
            for (k, (other, factors)) in after.iter().enumerate().rev() {
                subtract(row, factors[k], other);
            }
            after = [(*row, *lower), after[0], after[1]];
        }
    }
}

/// Subtracts `factor * other` from `values`.
fn subtract<const W: usize>(values: &mut [f64; W], factor: f64, other: &[f64; W]) {
    for (value, other) in values.iter_mut().zip(other) {
        *value -= factor * other;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_solved_gives_the_right_side_again() {
        for frames in [1, 2, 3, 4, 5, 30] {
            let diagonal = |t: usize| 0.1 + 0.05 * (t as f64).sin().abs();
            let banded = BandedFactorization::new(frames, diagonal, 2.0, |_| 5.0);
            let right: Vec<f64> = (0..3 * frames).map(|i| (i as f64 * 0.7).cos()).collect();
            let mut solved = right.clone();
            banded.solve::<2>(&mut solved, 1, 3);
            for column in [1, 2] {
                let x: Vec<f64> = (0..frames).map(|t| solved[column + 3 * t]).collect();
                let mut product: Vec<f64> = (0..frames).map(|t| diagonal(t) * x[t]).collect();
                for (factors, weight) in
                    [(&SECOND_DIFFERENCE[..], 2.0), (&THIRD_DIFFERENCE[..], 5.0)]
                {
                    for start in 0..(frames + 1).saturating_sub(factors.len()) {
                        let difference: f64 = { factors.iter().enumerate() }
                            .map(|(i, a)| a * x[start + i])
                            .sum();
                        for (i, a) in factors.iter().enumerate() {
                            product[start + i] += weight * a * difference;
                        }
                    }
                }
                for t in 0..frames {
                    assert!(
                        (product[t] - right[column + 3 * t]).abs() < 1e-9,
                        "{frames} frames, {t}"
                    );
                    assert_eq!(solved[3 * t], right[3 * t]);
                }
            }
        }
    }
}
