//! Where a series is largest.

use crate::series::LabanSeries;
use crate::tags::Component;

/// Two peaks are at least this many frames apart: a quarter of a second.
const APART: usize = 5;
/// A peak has at least this share of the largest value.
const LEAST: f32 = 0.5;

impl LabanSeries {
    /// The frames at which a component peaks, the highest first: frames with the largest value of a quarter of
    /// a second around them, and at least half of the largest in the motion. A component that is 0 all the time
    /// has none; of a plateau it is the first frame.
    pub fn peaks(&self, component: Component) -> Vec<usize> {
        let values: Vec<f32> = self.component(component).collect();
        let largest = values.iter().copied().fold(0.0, f32::max);
        let is_peak = |&frame: &usize| {
            let value = values[frame];
            let before = &values[frame.saturating_sub(APART)..frame];
            let after = &values[frame + 1..values.len().min(frame + 1 + APART)];
            value > 0.0
                && value >= LEAST * largest
                && before.iter().all(|&other| other < value)
                && after.iter().all(|&other| other <= value)
        };
        let mut peaks: Vec<usize> = (0..values.len()).filter(is_peak).collect();
        peaks.sort_by(|&a, &b| values[b].total_cmp(&values[a]));
        peaks
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::{Device, Tensor, TensorData};

    #[test]
    fn peaks_are_sorted_by_height_and_small_ones_left_out() {
        let mut rows = [[0.0; 4]; 40];
        for (frame, weight) in [(5, 2.0), (7, 1.9), (20, 4.0), (21, 4.0), (33, 1.9)] {
            rows[frame][0] = weight;
        }
        let data = TensorData::new(rows.as_flattened().to_vec(), [40, 4]);
        let series = LabanSeries::from_tensor(Tensor::from_data(data, &Device::flex()));
        assert_eq!(series.peaks(Component::Weight), [20, 5]);
        assert_eq!(series.peaks(Component::Shape), [0; 0]);
    }
}
