//! Baselines that are kept, so that requests which differ in their goals alone need not make them again.

use std::collections::VecDeque;
use std::sync::{Mutex, PoisonError};

use burn::tensor::Tensor;
use lamogen_guide::{Body, FitOptions, TemporalSmoothing, TextScale};
use lamogen_model::{SamplingMethod, Tokens};
use lamogen_motion::{Motion, POSE_FEATURES, Rotations};

/// All that a baseline depends on, for one model.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct BaselineKey {
    /// The tokens of each sentence, with its number of frames.
    pub(crate) sentences: Vec<(Tokens, usize)>,
    /// The end of the motion that this one continues, as the network and the body see it.
    pub(crate) start: Option<(Vec<[f32; POSE_FEATURES]>, Rotations)>,
    /// The beginning of the motion that this one leads to.
    pub(crate) end: Vec<[f32; POSE_FEATURES]>,
    pub(crate) frames: usize,
    pub(crate) seed: u64,
    pub(crate) steps: usize,
    pub(crate) is_looped: bool,
    pub(crate) body: Body,
    pub(crate) fit: FitOptions,
    pub(crate) text_scale: TextScale,
    pub(crate) temporal_smoothing: Option<TemporalSmoothing>,
    pub(crate) sampling_method: SamplingMethod,
}

/// The motion of a text alone.
#[derive(Clone, Debug)]
pub(crate) struct Baseline {
    /// The normalised pose features of the network, `(1, frames, features)`.
    pub(crate) normalized: Tensor<3>,
    /// The network's motion.
    pub(crate) network: Motion,
    /// The motion that is measured and guided: that of the rigid body, or the network's.
    pub(crate) motion: Motion,
}

/// The last baselines of a model.
#[derive(Debug, Default)]
pub(crate) struct BaselineCache {
    capacity: usize,
    /// The baselines, the one that was used last at the end.
    entries: Mutex<VecDeque<(BaselineKey, Baseline)>>,
}

impl BaselineCache {
    /// Makes a cache of so many baselines.
    pub(crate) fn new(capacity: usize) -> BaselineCache {
        BaselineCache {
            capacity,
            entries: Mutex::default(),
        }
    }

    /// Whether baselines are kept at all.
    pub(crate) fn is_on(&self) -> bool {
        self.capacity > 0
    }

    /// Returns a baseline that was kept.
    pub(crate) fn get(&self, key: &BaselineKey) -> Option<Baseline> {
        let mut entries = self.entries.lock().unwrap_or_else(PoisonError::into_inner);
        let place = entries.iter().position(|(kept, _)| kept == key)?;
        let entry = entries.remove(place)?;
        let baseline = entry.1.clone();
        entries.push_back(entry);
        Some(baseline)
    }

    /// Keeps a baseline, in place of the one that has not been used for longest.
    pub(crate) fn insert(&self, key: BaselineKey, baseline: Baseline) {
        let mut entries = self.entries.lock().unwrap_or_else(PoisonError::into_inner);
        entries.retain(|(kept, _)| *kept != key);
        entries.push_back((key, baseline));
        while entries.len() > self.capacity {
            entries.pop_front();
        }
    }
}
