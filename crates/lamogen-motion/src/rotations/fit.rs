//! The rotation that maps three points onto three others with the least squared error.

use glam::{DMat3, DQuat, DVec3};

/// The weight of the expected rotation relative to the points. It is large enough to decide where the points leave the
/// rotation undetermined, and negligible where they do not.
const EXPECTED_WEIGHT: f64 = 1e-9;

/// Returns the rotation `R` with the least `Σ |R from - to|²`. If several rotations are equally good, it returns the
/// one nearest to `expected`.
///
/// The rotation, as a quaternion, is the eigenvector of the largest eigenvalue of a symmetric 4×4 matrix (Davenport's q-method;
/// Horn 1987).
pub(super) fn fit_rotation(from: &[DVec3; 3], to: &[DVec3; 3], expected: DQuat) -> DQuat {
    // Σ to ⊗ from, the correlation matrix of the points.
    let mut b = DMat3::ZERO;
    let mut size = 0.0;
    for (&from, &to) in from.iter().zip(to) {
        b += DMat3::from_cols(to * from.x, to * from.y, to * from.z);
        size += from.length() * to.length();
    }
    let at = |row: usize, column: usize| b.col(column)[row];
    let z = [
        at(2, 1) - at(1, 2),
        at(0, 2) - at(2, 0),
        at(1, 0) - at(0, 1),
    ];
    let trace = at(0, 0) + at(1, 1) + at(2, 2);
    let q = expected.to_array();
    let prior = EXPECTED_WEIGHT * size.max(1e-6);
    let k = std::array::from_fn(|row| {
        std::array::from_fn(|column| {
            let data = match (row, column) {
                (3, 3) => trace,
                (3, i) | (i, 3) => z[i],
                (i, j) => at(i, j) + at(j, i) - if i == j { trace } else { 0.0 },
            };
            data + 4.0 * prior * q[row] * q[column]
        })
    });
    let best = DQuat::from_array(largest_eigenvector(k));
    match best.is_finite() && best.length() > 0.5 {
        true => best.normalize(),
        false => expected,
    }
}

/// Returns the eigenvector of the largest eigenvalue of a symmetric matrix, found by Jacobi rotations.
fn largest_eigenvector(mut a: [[f64; 4]; 4]) -> [f64; 4] {
    /// Each sweep squares the error; the matrices of real motions need four or five sweeps.
    const SWEEPS: usize = 12;
    let mut vectors = [[0.0; 4]; 4];
    for (i, row) in vectors.iter_mut().enumerate() {
        row[i] = 1.0;
    }
    for _ in 0..SWEEPS {
        for p in 0..3 {
            for q in p + 1..4 {
                if a[p][q] == 0.0 {
                    continue;
                }
                let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
                let t = theta.signum() / (theta.abs() + theta.hypot(1.0));
                let c = t.hypot(1.0).recip();
                let s = t * c;
                for row in &mut a {
                    (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
                }
                let (above, below) = (a[p], a[q]);
                a[p] = std::array::from_fn(|i| c * above[i] - s * below[i]);
                a[q] = std::array::from_fn(|i| s * above[i] + c * below[i]);
                for row in &mut vectors {
                    (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
                }
            }
        }
    }
    let largest = (0..4).fold(0, |best, i| if a[i][i] > a[best][best] { i } else { best });
    vectors.map(|row| row[largest])
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHAPE: [DVec3; 3] = [
        DVec3::new(0.06, -0.09, -0.01),
        DVec3::new(-0.07, -0.08, -0.02),
        DVec3::new(0.0, 0.12, -0.03),
    ];

    #[test]
    fn any_rotation_of_a_body_is_found() {
        for i in 0..200 {
            let i = f64::from(i);
            let axis = DVec3::new((i * 1.1).sin(), (i * 1.7).cos(), (i * 2.3).sin());
            let turn = DQuat::from_axis_angle(axis.normalize(), i * 0.4);
            let found = fit_rotation(&SHAPE, &SHAPE.map(|point| turn * point), DQuat::IDENTITY);
            assert!(found.dot(turn).abs() > 1.0 - 1e-12, "{i}: {found} {turn}");
        }
    }

    #[test]
    fn no_rotation_nearby_is_better() {
        let to = [
            DVec3::new(0.05, -0.1, 0.03),
            DVec3::new(-0.09, -0.06, 0.0),
            DVec3::new(0.02, 0.1, 0.05),
        ];
        let error = |turn: DQuat| -> f64 {
            let pairs = SHAPE.iter().zip(&to);
            pairs
                .map(|(&from, &to)| (turn * from - to).length_squared())
                .sum()
        };
        let best = fit_rotation(&SHAPE, &to, DQuat::IDENTITY);
        for axis in DVec3::AXES {
            for angle in [-1e-3, 1e-3, 0.5, 3.0] {
                assert!(error(DQuat::from_axis_angle(axis, angle) * best) > error(best));
            }
        }
    }

    #[test]
    fn points_that_leave_it_open_give_what_was_expected() {
        let expected = DQuat::from_axis_angle(DVec3::Y, 1.0);
        let found = fit_rotation(&[DVec3::ZERO; 3], &[DVec3::ZERO; 3], expected);
        assert!(found.angle_between(expected) < 1e-6, "{found}");
        // If all points are on one line, every twist about it is equally good.
        let line = [DVec3::Y, -DVec3::Y, DVec3::Y * 0.5];
        let found = fit_rotation(&line, &line, expected);
        assert!(found.angle_between(expected) < 1e-6, "{found}");
    }
}
