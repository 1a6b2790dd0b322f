//! Metrics of control: whether the requested component of a motion changes, and no other.

use super::MetricError;

/// The number of components that can be requested: Weight, Time, Flow, Shape.
const COMPONENTS: usize = 4;

/// The Laban features of a motion when a small value of a component is requested, and when a large value is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ControlRange {
    /// The features of the motion with the small tag.
    pub small: [f64; COMPONENTS],
    /// The features of the motion with the large tag.
    pub large: [f64; COMPONENTS],
}

/// The relative changes of every component when one of them is requested: the paper's 4 × 4 matrix (section
/// "Controllability and Disentanglement").
#[derive(Clone, Debug, PartialEq)]
pub struct ChangeMatrix {
    /// The mean of `(large - small) / small` over motions: `[requested component][measured component]`.
    pub mean: [[f64; COMPONENTS]; COMPONENTS],
    /// The standard deviation of the same over motions, divided by their number, as in numpy.
    pub std: [[f64; COMPONENTS]; COMPONENTS],
    /// The number of motions that are left out of a cell because their feature is 0 with the small tag, by which nothing
    /// can be divided.
    pub undefined: [[usize; COMPONENTS]; COMPONENTS],
}

impl ChangeMatrix {
    /// Computes the matrix from the extremes of every motion, `[requested component][motion]`.
    ///
    /// # Errors
    ///
    /// If a cell has no motion with a feature other than 0 for the small tag, or a number is not finite.
    pub fn of(requested: [&[ControlRange]; COMPONENTS]) -> Result<Self, MetricError> {
        let mut matrix = ChangeMatrix {
            mean: [[0.0; COMPONENTS]; COMPONENTS],
            std: [[0.0; COMPONENTS]; COMPONENTS],
            undefined: [[0; COMPONENTS]; COMPONENTS],
        };
        for (row, motions) in requested.into_iter().enumerate() {
            let is_broken = |motion: &ControlRange| {
                let mut numbers = motion.small.iter().chain(&motion.large);
                numbers.any(|number| !number.is_finite())
            };
            if let Some(index) = motions.iter().position(is_broken) {
                return Err(MetricError::Features { motion: index });
            }
            for column in 0..COMPONENTS {
                let pairs = motions.iter().map(|m| (m.small[column], m.large[column]));
                let defined = pairs.filter(|(small, _)| *small != 0.0);
                let changes: Vec<f64> = defined.map(|(a, b)| (b - a) / a).collect();
                if changes.is_empty() {
                    return Err(MetricError::TooFew {
                        metric: "the change matrix",
                        what: "motion for each component that does not rest",
                        needed: 1,
                        found: 0,
                    });
                }
                let count = changes.len() as f64;
                let mean = changes.iter().sum::<f64>() / count;
                let squares = changes.iter().map(|change| (change - mean).powi(2));
                matrix.mean[row][column] = mean;
                matrix.std[row][column] = (squares.sum::<f64>() / count).sqrt();
                matrix.undefined[row][column] = motions.len() - changes.len();
            }
        }
        Ok(matrix)
    }

    /// Returns the share of the squares on the matrix's diagonal, `Σ Aᵢᵢ² / Σ Aᵢⱼ²`. It is 1 if only the requested
    /// components change, and 0 if nothing changes.
    pub fn diagonality(&self) -> f64 {
        let all: f64 = self
            .mean
            .iter()
            .flatten()
            .map(|change| change * change)
            .sum();
        let diagonal: f64 = (0..COMPONENTS).map(|i| self.mean[i][i].powi(2)).sum();
        match all > 0.0 {
            true => diagonal / all,
            false => 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scaled_in(component: usize, factor: f64) -> ControlRange {
        let small = [2.0, 3.0, 5.0, 7.0];
        let mut large = small;
        large[component] *= factor;
        ControlRange { small, large }
    }

    #[test]
    fn diagonality_is_1_if_only_requested_components_change() {
        let rows = [0, 1, 2, 3].map(|component| vec![scaled_in(component, 3.0); 2]);
        let matrix = ChangeMatrix::of(rows.each_ref().map(Vec::as_slice)).unwrap();
        assert_eq!(matrix.diagonality(), 1.0);
        assert_eq!(matrix.mean[2], [0.0, 0.0, 2.0, 0.0]);
        assert_eq!(matrix.std, [[0.0; 4]; 4]);
        // Another component changes than the requested one.
        let rows = [1, 2, 3, 0].map(|component| vec![scaled_in(component, 3.0)]);
        let matrix = ChangeMatrix::of(rows.each_ref().map(Vec::as_slice)).unwrap();
        assert_eq!(matrix.diagonality(), 0.0);
        let rows = [0; 4].map(|component| vec![scaled_in(component, 1.0)]);
        let matrix = ChangeMatrix::of(rows.each_ref().map(Vec::as_slice)).unwrap();
        assert_eq!(matrix.diagonality(), 0.0, "nothing changed");
    }

    #[test]
    fn motions_that_rest_are_counted_and_broken_ones_refused() {
        let still = ControlRange {
            small: [0.0, 1.0, 1.0, 1.0],
            large: [1.0; 4],
        };
        let rows = [0, 1, 2, 3].map(|component| vec![scaled_in(component, 3.0), still]);
        let matrix = ChangeMatrix::of(rows.each_ref().map(Vec::as_slice)).unwrap();
        assert_eq!(matrix.undefined[0], [1, 0, 0, 0]);
        assert_eq!(matrix.mean[0][0], 2.0);
        let all_still = [[still]; 4];
        let error = ChangeMatrix::of(all_still.each_ref().map(|row| &row[..])).unwrap_err();
        assert!(error.to_string().contains("does not rest"), "{error}");
        let broken = [[ControlRange {
            large: [f64::NAN; 4],
            ..still
        }]; 4];
        let error = ChangeMatrix::of(broken.each_ref().map(|row| &row[..])).unwrap_err();
        assert_eq!(error, MetricError::Features { motion: 0 });
    }
}
