//! The peaks of a Laban series.

use crate::series::LabanSeries;
use crate::tags::Component;

/// The number of frames before and after a peak that have no larger value: a quarter of a second.
const PEAK_DISTANCE: usize = 5;
/// The smallest ratio of a peak to the largest value of the motion.
const PEAK_RATIO: f32 = 0.5;

impl LabanSeries {
    /// Returns the frames at which a component has a peak, the highest peak first. The value of a peak is the largest
    /// within a quarter of a second before and after it, and at least half of the largest value in the motion. The peak
    /// of a plateau is its first frame. A component that is 0 at all frames has no peak.
    pub fn peaks(&self, component: Component) -> Vec<usize> {
        let values: Vec<f32> = self.component(component).collect();
        let largest = values.iter().copied().fold(0.0, f32::max);
        let is_peak = |&frame: &usize| {
            let value = values[frame];
            let before = &values[frame.saturating_sub(PEAK_DISTANCE)..frame];
            let after = &values[frame + 1..values.len().min(frame + 1 + PEAK_DISTANCE)];
            value > 0.0
                && value >= PEAK_RATIO * largest
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
