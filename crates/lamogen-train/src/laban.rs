//! Laban features of the motions that a network is trained on, as labels that cost nothing.

use std::collections::HashMap;

use burn::tensor::{Device, Tensor, TensorData};
use lamogen_data::Dataset;
use lamogen_laban::{LabanFeatures, LabanOptions};
use lamogen_model::{LABAN_FEATURES, LabanCondition};
use lamogen_motion::{POSE_FEATURES, joints};

use crate::batches::Visit;

/// The features of every frame of every motion.
#[derive(Clone, Debug)]
pub(crate) struct TrainingLaban {
    /// `[entry][frame]`, empty for entries that are not trained on; a mirror image shares those of its motion.
    series: HashMap<usize, Vec<[f32; LABAN_FEATURES]>>,
}

/// Frames without a difference of that order, at the start of a motion.
const UNKNOWN: [usize; LABAN_FEATURES] = [1, 2, 3, 0];

impl TrainingLaban {
    /// Measures motions with the default options, on the host's own device.
    pub(crate) fn measure(
        dataset: &Dataset,
        entries: impl Iterator<Item = usize>,
        device: &Device,
    ) -> Self {
        let normalization = dataset.normalization(device);
        let measured = |entry: usize| {
            let frames = dataset.entries()[entry].frames;
            let mut rows = Vec::new();
            dataset.normalized(&dataset.entries()[entry], 0..frames, &mut rows);
            let rows = TensorData::new(rows, [1, frames, POSE_FEATURES]);
            let joints = joints(normalization.denormalize(Tensor::from_data(rows, device)));
            let features = LabanFeatures::new(&LabanOptions::default(), frames, &[frames], device)
                .measure(joints);
            let values: Vec<f32> = features.try_into_vec_as().expect("floats convert to f32");
            let rows = values.chunks_exact(LABAN_FEATURES);
            rows.map(|row| std::array::from_fn(|feature| row[feature]))
                .collect()
        };
        TrainingLaban {
            series: entries.map(|entry| (entry, measured(entry))).collect(),
        }
    }

    /// Mean and standard deviation of the logarithms of the means over time of whole motions.
    pub(crate) fn statistics(&self) -> LabanCondition {
        let mut entries: Vec<&usize> = self.series.keys().collect();
        entries.sort();
        let plain = LabanCondition {
            mean: [0.0; LABAN_FEATURES],
            std: [1.0; LABAN_FEATURES],
        };
        let rows: Vec<[f64; LABAN_FEATURES]> = { entries.iter() }
            .map(|&&entry| {
                let means = self.means(entry, 0, self.series[&entry].len());
                means.map(|mean| f64::from(mean.max(LEAST).ln()))
            })
            .collect();
        let count = rows.len().max(1) as f64;
        let mean: [f64; LABAN_FEATURES] =
            std::array::from_fn(|feature| rows.iter().map(|row| row[feature]).sum::<f64>() / count);
        let variance = |feature: usize| {
            rows.iter()
                .map(|row| (row[feature] - mean[feature]).powi(2))
                .sum::<f64>()
                / count
        };
        LabanCondition {
            mean: mean.map(|mean| mean as f32),
            std: std::array::from_fn(|feature| match variance(feature).sqrt() as f32 {
                deviation if deviation > 0.0 => deviation,
                _ => plain.std[feature],
            }),
        }
    }

    /// What is told of a visit.
    pub(crate) fn told(&self, visit: &Visit) -> [Option<f32>; LABAN_FEATURES] {
        if visit.laban == [false; LABAN_FEATURES] {
            return [None; LABAN_FEATURES];
        }
        let means = self.means(visit.entry, visit.frames.start, visit.frames.end);
        std::array::from_fn(|feature| visit.laban[feature].then_some(means[feature]))
    }

    /// Means over frames that are known.
    fn means(&self, entry: usize, start: usize, end: usize) -> [f32; LABAN_FEATURES] {
        let series = &self.series[&entry];
        std::array::from_fn(|feature| {
            let rows = &series[start.max(UNKNOWN[feature]).min(end)..end];
            let sum: f64 = rows.iter().map(|row| f64::from(row[feature])).sum();
            (sum / rows.len().max(1) as f64) as f32
        })
    }
}

/// Keeps the logarithm of a motion at rest finite.
const LEAST: f32 = 1e-12;
