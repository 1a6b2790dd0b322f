//! Laban features of the training motions, measured as labels that nobody has to annotate.

use std::collections::BTreeMap;

use burn::tensor::{Device, Tensor, TensorData};
use lamogen_data::Dataset;
use lamogen_laban::{COMPONENTS, LabanFeatures, LabanOptions, LabanSeries};
use lamogen_model::{LABAN_FEATURES, LabanCondition};
use lamogen_motion::{POSE_FEATURES, joints};

use crate::batches::BatchItem;

/// The Laban features of every frame of the training motions, by the index of the motion's entry.
#[derive(Clone, Debug)]
pub(crate) struct LabanLabels(BTreeMap<usize, LabanSeries>);

impl LabanLabels {
    /// Measures the motions of some entries with the default options.
    pub(crate) fn measure(
        dataset: &Dataset,
        entries: impl Iterator<Item = usize>,
        device: &Device,
    ) -> Self {
        let normalization = dataset.normalization(device);
        let measure = |entry: usize| {
            let frames = dataset.entries()[entry].frames;
            let mut rows = Vec::new();
            dataset.normalized(&dataset.entries()[entry], 0..frames, &mut rows);
            let rows = TensorData::new(rows, [1, frames, POSE_FEATURES]);
            let joints = joints(normalization.denormalize(Tensor::from_data(rows, device)));
            let features = LabanFeatures::new(&LabanOptions::default(), frames, &[frames], device);
            LabanSeries::from_tensor(features.measure(joints).reshape([frames, COMPONENTS]))
        };
        LabanLabels(entries.map(|entry| (entry, measure(entry))).collect())
    }

    /// Computes the statistics of the features, which a network with this condition needs.
    pub(crate) fn condition(&self) -> LabanCondition {
        let series = self.0.values();
        LabanCondition::of(series.map(|series| series.known_means(0..series.frames().len())))
    }

    /// Returns the Laban features that the network sees of a batch item: the means over its frames, `None` where the item leaves
    /// a feature out.
    pub(crate) fn condition_values(&self, item: &BatchItem) -> [Option<f32>; LABAN_FEATURES] {
        if item.laban == [false; LABAN_FEATURES] {
            return [None; LABAN_FEATURES];
        }
        let means = self.0[&item.motion].known_means(item.frames.clone());
        std::array::from_fn(|feature| item.laban[feature].then_some(means[feature]))
    }
}
