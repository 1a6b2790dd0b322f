//! Smoothing and differences along time as matrices.
//!
//! Both are linear in the positions, so a whole chain of them is one matrix `[frames, frames]`,
//! built once for a length in 64-bit floats. Applying it is one matrix product forwards and one
//! backwards, and the length of each motion (beyond which the last frame repeats) is built in.

use crate::smoothing::{Gaussian, Smoothing};

/// A linear map from the positions of `frames` frames to a series that starts at frame `first`
/// and ends where the motion does. Rows outside hold 0.
#[derive(Clone)]
pub(crate) struct TimeOperator {
    rows: Vec<Vec<f64>>,
    first: usize,
    length: usize,
}

impl TimeOperator {
    /// Every frame as it is.
    fn identity(frames: usize, length: usize) -> Self {
        let rows = (0..frames)
            .map(|t| {
                let mut row = vec![0.0; frames];
                if t < length {
                    row[t] = 1.0;
                }
                row
            })
            .collect();
        TimeOperator {
            rows,
            first: 0,
            length,
        }
    }

    /// Positions, velocity, acceleration and jerk of a motion of `length` frames (difference per
    /// frame) among `frames`.
    pub(crate) fn kinematics(smoothing: Smoothing, frames: usize, length: usize) -> [Self; 4] {
        let (once, each) = match smoothing {
            Smoothing::None => (None, None),
            Smoothing::Positions(gaussian) => (Some(gaussian), None),
            Smoothing::EachDifference(gaussian) => (Some(gaussian), Some(gaussian)),
        };
        let position = TimeOperator::identity(frames, length).smoothed(once);
        let velocity = position.difference();
        let acceleration = velocity.smoothed(each).difference();
        let jerk = acceleration.smoothed(each).difference();
        [position, velocity, acceleration, jerk]
    }

    fn smoothed(&self, gaussian: Option<Gaussian>) -> Self {
        let Some(gaussian) = gaussian.filter(|_| self.first < self.length) else {
            return self.clone();
        };
        let kernel = gaussian.kernel();
        let reach = kernel.len() / 2;
        let (first, last) = (self.first, self.length - 1);
        let mut smoothed = self.blank(first);
        for t in first..=last {
            for (offset, weight) in kernel.iter().enumerate() {
                let from = (t + offset).saturating_sub(reach).clamp(first, last);
                for (to, from) in smoothed.rows[t].iter_mut().zip(&self.rows[from]) {
                    *to += weight * from;
                }
            }
        }
        smoothed
    }

    fn difference(&self) -> Self {
        let mut difference = self.blank(self.first + 1);
        for t in difference.first..self.length {
            for (column, to) in difference.rows[t].iter_mut().enumerate() {
                *to = self.rows[t][column] - self.rows[t - 1][column];
            }
        }
        difference
    }

    fn blank(&self, first: usize) -> Self {
        TimeOperator {
            rows: vec![vec![0.0; self.rows.len()]; self.rows.len()],
            first,
            length: self.length,
        }
    }

    /// The matrix, row by row.
    pub(crate) fn values(&self) -> impl Iterator<Item = f32> + '_ {
        self.rows.iter().flatten().map(|&value| value as f32)
    }

    /// 1 at the frames where the series has a value, else 0.
    pub(crate) fn mask(&self) -> Vec<f32> {
        (0..self.rows.len())
            .map(|t| f32::from(u8::from(t >= self.first && t < self.length)))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn apply(operator: &TimeOperator, positions: &[f64]) -> Vec<f64> {
        let row = |row: &Vec<f64>| row.iter().zip(positions).map(|(a, b)| a * b).sum();
        operator.rows.iter().map(row).collect()
    }

    #[test]
    fn differences_of_a_cube_are_known() {
        let positions: Vec<f64> = (0..6).map(|t| f64::from(t).powi(3)).collect();
        let [x, v, a, j] = TimeOperator::kinematics(Smoothing::None, 6, 6);
        assert_eq!(apply(&x, &positions), positions);
        assert_eq!(apply(&v, &positions), [0.0, 1.0, 7.0, 19.0, 37.0, 61.0]);
        assert_eq!(apply(&a, &positions), [0.0, 0.0, 6.0, 12.0, 18.0, 24.0]);
        assert_eq!(apply(&j, &positions), [0.0, 0.0, 0.0, 6.0, 6.0, 6.0]);
        assert_eq!(j.mask(), [0.0, 0.0, 0.0, 1.0, 1.0, 1.0]);
    }

    #[test]
    fn smoothing_keeps_a_still_pose_still() {
        for smoothing in [
            Smoothing::Positions(Gaussian::PAPER),
            Smoothing::EachDifference(Gaussian::PAPER),
        ] {
            let [x, v, a, j] = TimeOperator::kinematics(smoothing, 9, 9);
            assert!(apply(&x, &[2.0; 9]).iter().all(|x| (x - 2.0).abs() < 1e-12));
            for series in [v, a, j] {
                assert!(apply(&series, &[2.0; 9]).iter().all(|x| x.abs() < 1e-12));
            }
        }
    }

    #[test]
    fn frames_past_the_end_count_nowhere() {
        let mut positions: Vec<f64> = (0..12).map(|t| f64::from(t * t)).collect();
        let short = TimeOperator::kinematics(Smoothing::default(), 8, 8);
        let long = TimeOperator::kinematics(Smoothing::default(), 12, 8);
        positions[8..].fill(f64::MAX / 1e9);
        for (short, long) in short.iter().zip(&long) {
            let alone = apply(short, &positions[..8]);
            let padded = apply(long, &positions);
            assert_eq!(alone, padded[..8]);
            assert!(padded[8..].iter().all(|&x| x == 0.0));
        }
    }

    #[test]
    fn a_motion_shorter_than_its_differences_has_none() {
        for length in 1..4 {
            let series =
                TimeOperator::kinematics(Smoothing::EachDifference(Gaussian::PAPER), 4, length);
            for (order, series) in series.iter().enumerate() {
                let values = series.mask().iter().filter(|&&x| x == 1.0).count();
                assert_eq!(values, length.saturating_sub(order));
            }
        }
    }
}
