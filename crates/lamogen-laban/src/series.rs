//! Laban features of one motion on the host.

use std::ops::Range;

use burn::tensor::{Device, Tensor, TensorData};
use lamogen_motion::{JOINTS, Motion};

use crate::features::{LabanFeatures, LabanOptions};
use crate::tags::{COMPONENTS, Component};

/// How a series becomes one number.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TimeSummary {
    /// The largest value over time: the original definition of the Laban components (paper,
    /// section "Laban Effort and Shape Quantification").
    #[default]
    Maximum,
    /// The mean over all frames.
    Mean,
}

/// Weight, Time, Flow and Shape of one motion, a row a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct LabanSeries {
    frames: Vec<[f32; COMPONENTS]>,
}

impl LabanSeries {
    /// Measures a motion, computing on a device.
    pub fn of(motion: &Motion, options: &LabanOptions, device: &Device) -> LabanSeries {
        let frames = motion.frames();
        let positions = motion.joints().as_flattened().as_flattened().to_vec();
        let joints = TensorData::new(positions, [1, frames, JOINTS, 3]);
        let features = LabanFeatures::new(options, frames, &[frames], device);
        let measured = features.measure(Tensor::from_data(joints, device));
        LabanSeries::from_tensor(measured.reshape([frames, COMPONENTS]))
    }

    /// The series of features `[frames, 4]`.
    ///
    /// # Panics
    ///
    /// If there are not four features a frame.
    pub fn from_tensor(features: Tensor<2>) -> LabanSeries {
        assert_eq!(features.dims()[1], COMPONENTS, "four features a frame");
        let values: Vec<f32> = features.try_into_vec_as().expect("floats convert to f32");
        LabanSeries {
            frames: values.as_chunks().0.to_vec(),
        }
    }

    /// `[Weight, Time, Flow, Shape]` at every frame.
    pub fn frames(&self) -> &[[f32; COMPONENTS]] {
        &self.frames
    }

    /// One component over time.
    pub fn component(
        &self,
        component: Component,
    ) -> impl ExactSizeIterator<Item = f32> + Clone + '_ {
        self.frames.iter().map(move |row| row[component.index()])
    }

    /// A part of the series; frames past its end are left out.
    pub fn section(&self, frames: Range<usize>) -> LabanSeries {
        let end = frames.end.min(self.frames.len());
        LabanSeries {
            frames: self.frames[frames.start.min(end)..end].to_vec(),
        }
    }

    /// The mean of each component over those of the frames at which it is known: Weight, Time and Flow need one, two and three frames before
    /// theirs. 0 where there is none; the frames must be within the series.
    pub fn known_means(&self, frames: Range<usize>) -> [f32; COMPONENTS] {
        const FIRST_KNOWN: [usize; COMPONENTS] = [1, 2, 3, 0];
        Component::ALL.map(|component| {
            let first = FIRST_KNOWN[component.index()];
            let start = frames.start.max(first).min(frames.end);
            let rows = &self.frames[start..frames.end];
            mean(rows.iter().map(|row| row[component.index()]))
        })
    }

    /// One number a component.
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

/// The mean of some numbers; 0 of none.
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
    fn means_leave_out_the_frames_at_which_a_component_is_not_known() {
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
    fn a_motion_is_measured_on_the_host() {
        let mut pose = [[0.0; 3]; JOINTS];
        pose[15] = [1.0, 2.0, 0.5];
        let motion = Motion::from_joints(vec![pose; 10]).unwrap();
        let series = LabanSeries::of(&motion, &LabanOptions::default(), &Device::flex());
        let summary = series.summary(TimeSummary::Maximum);
        assert!((summary[3] - 1.0).abs() < 1e-5);
        assert!(summary[..3].iter().all(|&effort| effort < 1e-5));
    }
}
