//! The families of denoisers that can be trained.

use std::collections::HashMap;
use std::ops::RangeInclusive;
use std::path::Path;

use burn::tensor::Device;
use lamogen_guide::{Preset, TemporalSmoothing};
use lamogen_model::{
    ClipTextConfig, LabanCondition, ModelConfig, MotionDiffuse, NoiseSchedule, Precision,
    Prediction, SamplingDefaults, TrainableDenoiser,
};
use lamogen_motion::POSE_FEATURES;
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::config::DenoisingConfig;
use crate::error::TrainError;
use crate::model_folder::write_file;

/// The sizes of a denoiser of one family, which say all that training needs to know of the family.
pub trait NetworkConfig: Clone + PartialEq + Serialize + DeserializeOwned {
    /// The network.
    type Network: TrainableDenoiser;

    /// Describes the first size that makes no sense; `None` if there is none.
    fn problem(&self) -> Option<String>;

    /// Describes the first option of the training that this family cannot follow; `None`, the default, if there is none.
    fn unsupported(&self, denoising: &DenoisingConfig) -> Option<String> {
        let _ = denoising;
        None
    }

    /// Returns the lengths in frames of the motions that the network makes.
    fn lengths(&self) -> RangeInclusive<usize>;

    /// Returns the sizes of the text tower, which reads the captions.
    fn text_tower(&self) -> &ClipTextConfig;

    /// Returns the noise schedule for which the network is trained.
    fn noise_schedule(&self) -> NoiseSchedule;

    /// Returns what the network predicts.
    fn prediction(&self) -> Prediction;

    /// Returns the statistics of Laban features as a condition, which training fills in, or `None`, the default, if the
    /// family has no such condition.
    fn laban_condition(&mut self) -> Option<&mut Option<LabanCondition>> {
        None
    }

    /// Creates the network with random weights.
    fn initial_network(&self, seed: u64, device: &Device) -> Self::Network;

    /// Writes the weights and the config of a network of these sizes to the folder of the finished model.
    ///
    /// # Errors
    ///
    /// If a file cannot be written.
    fn save(
        &self,
        network: &Self::Network,
        denoising: &DenoisingConfig,
        folder: &Path,
        metadata: &HashMap<String, String>,
    ) -> Result<(), TrainError>;
}

impl NetworkConfig for ModelConfig {
    type Network = MotionDiffuse;

    fn problem(&self) -> Option<String> {
        let found = self.input_feats;
        let features = (found != POSE_FEATURES).then(|| {
            format!("input_feats must be {POSE_FEATURES}, those of HumanML3D, found {found}")
        });
        ModelConfig::problem(self).or(features)
    }

    fn lengths(&self) -> RangeInclusive<usize> {
        self.shortest()..=self.num_frames
    }

    fn text_tower(&self) -> &ClipTextConfig {
        &self.clip
    }

    fn noise_schedule(&self) -> NoiseSchedule {
        NoiseSchedule::default()
    }

    fn prediction(&self) -> Prediction {
        self.prediction
    }

    fn laban_condition(&mut self) -> Option<&mut Option<LabanCondition>> {
        Some(&mut self.laban_condition)
    }

    fn initial_network(&self, seed: u64, device: &Device) -> MotionDiffuse {
        MotionDiffuse::initial(self, seed, device)
    }

    fn save(
        &self,
        network: &MotionDiffuse,
        _: &DenoisingConfig,
        folder: &Path,
        metadata: &HashMap<String, String>,
    ) -> Result<(), TrainError> {
        let path = folder.join("model.safetensors");
        network.save(path, Precision::F32, metadata.clone())?;
        let mut config = self.clone();
        let defaults = || sampling_defaults(self.latent_dim, Preset::Precise);
        config.sampling.get_or_insert_with(defaults);
        let config = serde_json::to_vec_pretty(&config).expect("sizes are JSON");
        write_file(&folder.join("config.json"), &config)
    }
}

/// Returns the sampling defaults of a trained network whose config has none. A network that is narrower than a pose needs smoothing
/// over neighbouring frames (docs/method.md, "Frames that agree").
pub(crate) fn sampling_defaults(width: usize, preset: Preset) -> SamplingDefaults {
    SamplingDefaults {
        preset: Some(preset.name().to_owned()),
        temporal_smoothing: (width < POSE_FEATURES).then_some(TemporalSmoothing::default().frames),
        text_scale: None,
        text_scale_until: None,
        stand_in: None,
    }
}
