//! Whether what was asked for changes, and nothing else.

use super::MetricError;

/// Components of a motion that can be asked for: Weight, Time, Flow, Shape.
const COMPONENTS: usize = 4;

/// What a motion's Laban features are when little of a component is asked for, and when much is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ControlExtremes {
    /// Of the motion with the small tag.
    pub small: [f64; COMPONENTS],
    /// Of the motion with the large tag.
    pub large: [f64; COMPONENTS],
}

/// How much every component changes when one is asked to: the paper's 4 × 4 matrix (section "Controllability and Disentanglement").
#[derive(Clone, Debug, PartialEq)]
pub struct ChangeMatrix {
    /// The mean of `(large - small) / small` over motions: `[asked component][measured component]`.
    pub mean: [[f64; COMPONENTS]; COMPONENTS],
    /// Its standard deviation over motions (that of numpy, which divides by their number).
    pub std: [[f64; COMPONENTS]; COMPONENTS],
    /// How many motions are left out of a cell because theirs is 0 with the small tag, and cannot be divided by.
    pub undefined: [[usize; COMPONENTS]; COMPONENTS],
}

impl ChangeMatrix {
    /// The matrix of motions: of each component that was asked for, the extremes of every motion.
    ///
    /// # Errors
    ///
    /// If a component has no motion that can be divided by, or a number is not finite.
    pub fn of(asked: [&[ControlExtremes]; COMPONENTS]) -> Result<Self, MetricError> {
        let mut matrix = ChangeMatrix {
            mean: [[0.0; COMPONENTS]; COMPONENTS],
            std: [[0.0; COMPONENTS]; COMPONENTS],
            undefined: [[0; COMPONENTS]; COMPONENTS],
        };
        for (row, motions) in asked.into_iter().enumerate() {
            let is_broken = |motion: &ControlExtremes| {
                let mut numbers = motion.small.iter().chain(&motion.large);
                numbers.any(|number| !number.is_finite())
            };
            if let Some(place) = motions.iter().position(is_broken) {
                return Err(MetricError::Features { motion: place });
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

    /// The share of the matrix's energy on its diagonal, `Σ Aᵢᵢ² / Σ Aᵢⱼ²`: 1 where nothing changes but what is asked for; 0 where
    /// nothing changes at all.
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

    fn only(component: usize, factor: f64) -> ControlExtremes {
        let small = [2.0, 3.0, 5.0, 7.0];
        let mut large = small;
        large[component] *= factor;
        ControlExtremes { small, large }
    }

    #[test]
    fn what_alone_changes_is_all_of_the_diagonal() {
        let rows = [0, 1, 2, 3].map(|component| vec![only(component, 3.0); 2]);
        let matrix = ChangeMatrix::of(rows.each_ref().map(Vec::as_slice)).unwrap();
        assert_eq!(matrix.diagonality(), 1.0);
        assert_eq!(matrix.mean[2], [0.0, 0.0, 2.0, 0.0]);
        assert_eq!(matrix.std, [[0.0; 4]; 4]);
        // Asked for one, another changes.
        let rows = [1, 2, 3, 0].map(|component| vec![only(component, 3.0)]);
        let matrix = ChangeMatrix::of(rows.each_ref().map(Vec::as_slice)).unwrap();
        assert_eq!(matrix.diagonality(), 0.0);
        let rows = [0; 4].map(|component| vec![only(component, 1.0)]);
        let matrix = ChangeMatrix::of(rows.each_ref().map(Vec::as_slice)).unwrap();
        assert_eq!(matrix.diagonality(), 0.0, "nothing changed");
    }

    #[test]
    fn motions_that_rest_are_counted_and_broken_ones_refused() {
        let still = ControlExtremes {
            small: [0.0, 1.0, 1.0, 1.0],
            large: [1.0; 4],
        };
        let rows = [0, 1, 2, 3].map(|component| vec![only(component, 3.0), still]);
        let matrix = ChangeMatrix::of(rows.each_ref().map(Vec::as_slice)).unwrap();
        assert_eq!(matrix.undefined[0], [1, 0, 0, 0]);
        assert_eq!(matrix.mean[0][0], 2.0);
        let all_still = [[still]; 4];
        let error = ChangeMatrix::of(all_still.each_ref().map(|row| &row[..])).unwrap_err();
        assert!(error.to_string().contains("does not rest"), "{error}");
        let broken = [[ControlExtremes {
            large: [f64::NAN; 4],
            ..still
        }]; 4];
        let error = ChangeMatrix::of(broken.each_ref().map(|row| &row[..])).unwrap_err();
        assert_eq!(error, MetricError::Features { motion: 0 });
    }
}
