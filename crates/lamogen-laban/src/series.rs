//! The Laban features of one motion, in main memory.

use std::ops::Range;

use burn::tensor::{Device, Tensor, TensorData};
use lamogen_motion::{JOINTS, Motion};

use crate::features::{LabanFeatures, LabanOptions};
use crate::tags::{COMPONENTS, Component};

/// The summary of a series over time as one number.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TimeSummary {
    /// The largest value over time: the original definition of the Laban components (paper,
    /// section "Laban Effort and Shape Quantification").
    #[default]
    Maximum,
    /// The mean over all frames.
    Mean,
}

/// Weight, Time, Flow and Shape of one motion at every frame.
#[derive(Clone, Debug, PartialEq)]
pub struct LabanSeries {
    frames: Vec<[f32; COMPONENTS]>,
}

impl LabanSeries {
    /// Measures a motion. The computation runs on `device`.
    pub fn of(motion: &Motion, options: &LabanOptions, device: &Device) -> LabanSeries {
        let frames = motion.frames();
        let positions = motion.joints().as_flattened().as_flattened().to_vec();
        let joints = TensorData::new(positions, [1, frames, JOINTS, 3]);
        let features = LabanFeatures::new(options, frames, &[frames], device);
        let measured = features.measure(Tensor::from_data(joints, device));
        LabanSeries::from_tensor(measured.reshape([frames, COMPONENTS]))
    }

    /// Makes the series of features that are known: `[Weight, Time, Flow, Shape]` at every frame.
    pub fn from_frames(frames: Vec<[f32; COMPONENTS]>) -> LabanSeries {
        LabanSeries { frames }
    }

    /// Reads the series of features `[frames, 4]` from a tensor.
    ///
    /// # Panics
    ///
    /// If the tensor has not four features per frame.
    pub fn from_tensor(features: Tensor<2>) -> LabanSeries {
        assert_eq!(features.dims()[1], COMPONENTS, "four features a frame");
        let values: Vec<f32> = features.try_into_vec_as().expect("floats convert to f32");
        LabanSeries {
            frames: values.as_chunks().0.to_vec(),
        }
    }

    /// Returns `[Weight, Time, Flow, Shape]` at every frame.
    pub fn frames(&self) -> &[[f32; COMPONENTS]] {
        &self.frames
    }

    /// Iterates over the values of one component.
    pub fn component(
        &self,
        component: Component,
    ) -> impl ExactSizeIterator<Item = f32> + Clone + '_ {
        self.frames.iter().map(move |row| row[component.index()])
    }

    /// Returns the series of some of the frames. Frames past the end of the series are left out.
    pub fn section(&self, frames: Range<usize>) -> LabanSeries {
        let end = frames.end.min(self.frames.len());
        LabanSeries {
            frames: self.frames[frames.start.min(end)..end].to_vec(),
        }
    }

    /// Returns the mean of each component over those of the given frames at which its value is known: Weight, Time and
    /// Flow need one, two and three earlier frames. The mean is 0 where there is no such frame. The frames must be
    /// within the series.
    pub fn known_means(&self, frames: Range<usize>) -> [f32; COMPONENTS] {
        const FIRST_KNOWN: [usize; COMPONENTS] = [1, 2, 3, 0];
        Component::ALL.map(|component| {
            let first = FIRST_KNOWN[component.index()];
            let start = frames.start.max(first).min(frames.end);
            let rows = &self.frames[start..frames.end];
            mean(rows.iter().map(|row| row[component.index()]))
        })
    }

    /// Returns the summary of each component over time.
    pub fn summary(&self, summary: TimeSummary) -> [f32; COMPONENTS] {
        Component::ALL.map(|component| {
            let values = self.component(component);
            match summary {
                TimeSummary::Maximum => values.fold(0.0, f32::max),
                TimeSummary::Mean => mean(values),
            }
        })
    }
}

/// Returns the mean of some numbers, or 0 if there are none.
pub(crate) fn mean(values: impl ExactSizeIterator<Item = f32>) -> f32 {
    let count = values.len().max(1) as f64;
    (values.map(f64::from).sum::<f64>() / count) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn summaries_are_maximum_and_mean_over_time() {
        let series = LabanSeries::from_tensor(Tensor::from([
            [0.0, 1.0, 4.0, 2.0],
            [3.0, 0.0, 0.0, 2.0],
            [3.0, 2.0, 2.0, 2.0],
        ]));
        assert_eq!(series.summary(TimeSummary::Maximum), [3.0, 2.0, 4.0, 2.0]);
        assert_eq!(series.summary(TimeSummary::Mean), [2.0, 1.0, 2.0, 2.0]);
        let time: Vec<_> = series.component(Component::Time).collect();
        assert_eq!(time, [1.0, 0.0, 2.0]);
    }

    #[test]
    fn means_leave_out_frames_without_a_known_value() {
        let rows = [
            [0.0, 0.0, 0.0, 1.0],
            [2.0, 0.0, 0.0, 1.0],
            [4.0, 3.0, 0.0, 1.0],
            [6.0, 5.0, 7.0, 5.0],
        ];
        let series = LabanSeries::from_tensor(Tensor::from(rows));
        assert_eq!(series.known_means(0..4), [4.0, 4.0, 7.0, 2.0]);
        assert_eq!(series.known_means(2..4), [5.0, 4.0, 7.0, 3.0]);
        assert_eq!(series.known_means(0..2), [2.0, 0.0, 0.0, 1.0]);
    }

    #[test]
    fn a_section_is_a_series_of_its_own() {
        let rows = [
            [0.0, 1.0, 4.0, 2.0],
            [3.0, 0.0, 0.0, 2.0],
            [3.0, 2.0, 2.0, 2.0],
        ];
        let series = LabanSeries::from_tensor(Tensor::from(rows));
        assert_eq!(series.section(1..3).frames(), &rows[1..]);
        assert_eq!(
            series.section(1..3).summary(TimeSummary::Mean),
            [3.0, 1.0, 1.0, 2.0]
        );
        for beyond in [3..9, 7..9] {
            assert!(series.section(beyond).frames().is_empty());
        }
    }

    #[test]
    fn the_series_of_a_motion_at_rest_has_shape_alone() {
        let mut pose = [[0.0; 3]; JOINTS];
        pose[15] = [1.0, 2.0, 0.5];
        let motion = Motion::from_joints(vec![pose; 10]).unwrap();
        let series = LabanSeries::of(&motion, &LabanOptions::default(), &Device::flex());
        let summary = series.summary(TimeSummary::Maximum);
        assert!((summary[3] - 1.0).abs() < 1e-5);
        assert!(summary[..3].iter().all(|&effort| effort < 1e-5));
    }
}
