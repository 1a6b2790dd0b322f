//! Natural cubic splines.

/// A natural cubic spline through values at knots: the smoothest curve through them, which goes on straight beyond the
/// first and the last knot.
pub(super) struct CubicSpline {
    knots: Vec<f64>,
    values: Vec<[f64; 2]>,
    /// The second derivatives at the knots.
    bends: Vec<[f64; 2]>,
}

impl CubicSpline {
    /// Creates the spline through points in the plane.
    ///
    /// # Panics
    ///
    /// If there are no points, or their knots do not rise.
    pub(super) fn new(points: &[(f64, [f64; 2])]) -> CubicSpline {
        assert!(!points.is_empty(), "a spline needs a point");
        assert!(points.is_sorted_by(|a, b| a.0 < b.0), "knots rise");
        let (knots, values): (Vec<f64>, Vec<[f64; 2]>) = points.iter().copied().unzip();
        let mut bends = vec![[0.0; 2]; knots.len()];
        // The tridiagonal system of the inner knots, solved by elimination.
        let inner = knots.len().saturating_sub(2);
        let mut shares = vec![0.0; inner];
        for axis in 0..2 {
            let mut rest = vec![0.0; inner];
            for i in 0..inner {
                let (before, after) = (knots[i + 1] - knots[i], knots[i + 2] - knots[i + 1]);
                let slope =
                    |k: usize| (values[k + 1][axis] - values[k][axis]) / (knots[k + 1] - knots[k]);
                let (share, earlier) = match i {
                    0 => (0.0, 0.0),
                    _ => (shares[i - 1], rest[i - 1]),
                };
                let pivot = 2.0 * (before + after) - before * share;
                shares[i] = after / pivot;
                rest[i] = (6.0 * (slope(i + 1) - slope(i)) - before * earlier) / pivot;
            }
            for i in (0..inner).rev() {
                bends[i + 1][axis] = rest[i] - shares[i] * bends[i + 2][axis];
            }
        }
        CubicSpline {
            knots,
            values,
            bends,
        }
    }

    /// Returns the point at a time.
    pub(super) fn at(&self, time: f64) -> [f64; 2] {
        let last = self.knots.len() - 1;
        if last == 0 {
            return self.values[0];
        }
        let piece = self.knots.partition_point(|knot| *knot <= time);
        let i = piece.clamp(1, last) - 1;
        let width = self.knots[i + 1] - self.knots[i];
        std::array::from_fn(|axis| {
            let [from, to] = [i, i + 1].map(|k| self.values[k][axis]);
            let [bend, next_bend] = [i, i + 1].map(|k| self.bends[k][axis]);
            let inside = time.clamp(self.knots[0], self.knots[last]);
            let (a, b) = (self.knots[i + 1] - inside, inside - self.knots[i]);
            let cubes = (bend * a.powi(3) + next_bend * b.powi(3)) / (6.0 * width);
            let lines = (from / width - bend * width / 6.0) * a
                + (to / width - next_bend * width / 6.0) * b;
            // The slope at the end of the piece, with which the curve goes on.
            let slope = (to - from) / width
                + match time < self.knots[0] {
                    true => -width / 6.0 * (2.0 * bend + next_bend),
                    false => width / 6.0 * (bend + 2.0 * next_bend),
                };
            cubes + lines + slope * (time - inside)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spline_passes_its_points_smoothly_and_goes_on_straight() {
        let points = [
            (0.0, [0.0, 0.0]),
            (10.0, [1.0, 0.0]),
            (25.0, [1.0, 2.0]),
            (30.0, [0.0, 2.0]),
        ];
        let spline = CubicSpline::new(&points);
        for (time, point) in points {
            for (own, asked) in spline.at(time).into_iter().zip(point) {
                assert!((own - asked).abs() < 1e-12);
            }
        }
        let second = |t: f64, h: f64| {
            let [a, b, c] = [t - h, t, t + h].map(|t| spline.at(t)[1]);
            (a - 2.0 * b + c) / (h * h)
        };
        // The second derivative has no jump at the inner knots, and is 0 at the ends and beyond.
        for knot in [10.0, 25.0] {
            let [before, after] = [-0.01, 0.01].map(|step| second(knot + step, 1e-3));
            assert!((before - after).abs() < 2e-3, "{before} {after}");
        }
        for outside in [-5.0, 35.0] {
            assert!(second(outside, 1.0).abs() < 1e-9);
        }
        let slope = |t: f64| (spline.at(t + 1e-4)[0] - spline.at(t - 1e-4)[0]) / 2e-4;
        for end in [0.0, 30.0] {
            assert!((slope(end - 0.01) - slope(end + 0.01)).abs() < 1e-3);
        }
    }

    #[test]
    fn a_spline_through_two_points_is_a_line() {
        let spline = CubicSpline::new(&[(0.0, [0.0, 1.0]), (4.0, [2.0, 1.0])]);
        assert_eq!([1.0, 6.0].map(|t| spline.at(t)), [[0.5, 1.0], [3.0, 1.0]]);
        assert_eq!(CubicSpline::new(&[(3.0, [1.0, 2.0])]).at(9.0), [1.0, 2.0]);
    }
}
