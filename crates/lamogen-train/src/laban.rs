//! Laban features of the motions that a network is trained on, as labels that cost nothing.

use std::collections::BTreeMap;

use burn::tensor::{Device, Tensor, TensorData};
use lamogen_data::Dataset;
use lamogen_laban::{COMPONENTS, LabanFeatures, LabanOptions, LabanSeries};
use lamogen_model::{LABAN_FEATURES, LabanCondition};
use lamogen_motion::{POSE_FEATURES, joints};

use crate::batches::Visit;

/// The features of every frame of every motion that is trained on, by its entry.
#[derive(Clone, Debug)]
pub(crate) struct TrainingLaban(BTreeMap<usize, LabanSeries>);

impl TrainingLaban {
    /// Measures motions with the default options.
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
            let features = LabanFeatures::new(&LabanOptions::default(), frames, &[frames], device);
            LabanSeries::from_tensor(features.measure(joints).reshape([frames, COMPONENTS]))
        };
        TrainingLaban(entries.map(|entry| (entry, measured(entry))).collect())
    }

    /// What a network has to know of them to be told any.
    pub(crate) fn condition(&self) -> LabanCondition {
        let series = self.0.values();
        LabanCondition::of(series.map(|series| series.known_means(0..series.frames().len())))
    }

    /// What is told of a visit.
    pub(crate) fn told(&self, visit: &Visit) -> [Option<f32>; LABAN_FEATURES] {
        if visit.laban == [false; LABAN_FEATURES] {
            return [None; LABAN_FEATURES];
        }
        let means = self.0[&visit.motion].known_means(visit.frames.clone());
        std::array::from_fn(|feature| visit.laban[feature].then_some(means[feature]))
    }
}
