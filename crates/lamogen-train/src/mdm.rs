//! Training of MDM (Tevet et al. 2023) with a text encoder of its own.

use std::collections::HashMap;
use std::ops::RangeInclusive;
use std::path::Path;

use burn::tensor::Device;
use lamogen_guide::Preset;
use lamogen_model::{
    ClipTextConfig, Mdm, MdmArchitecture, MdmConfig, MdmText, MdmTextConfig, NoiseSchedule,
    Precision, Prediction, SamplingDefaults, TextEncoderKind,
};
use serde::{Deserialize, Serialize};

use crate::config::DenoisingConfig;
use crate::error::TrainError;
use crate::model_folder::write_file;
use crate::network_config::{NetworkConfig, sampling_defaults};

/// The sizes of an MDM that is trained together with its text encoder, a small CLIP text tower. The public networks read
/// the frozen tower of CLIP ViT-B/32 instead.
///
/// A file with an `arch` among the sizes of its network is read as this.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MdmModelConfig {
    /// The part that attends to the frames.
    pub arch: MdmArchitecture,
    /// The number of layers.
    pub layers: usize,
    /// The width of the hidden state, a multiple of 8.
    pub latent_dim: usize,
    /// The width inside the feed-forward layers.
    pub ff_size: usize,
    /// The number of timesteps of the cosine schedule.
    pub diffusion_steps: usize,
    /// The sizes of the text tower, whose heads are 64 wide. Its embedding of a sentence is as wide as its tokens' features.
    pub clip: ClipTextConfig,
    /// The sampling settings that the folder of the finished model recommends.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sampling: Option<SamplingDefaults>,
}

/// The number of channels of an attention head in CLIP's text towers of any width.
const TEXT_HEAD_WIDTH: usize = 64;

/// The lengths in frames of HumanML3D's clips.
const CLIP_FRAMES: RangeInclusive<usize> = 40..=196;

impl MdmModelConfig {
    /// Returns the config of the network.
    fn network(&self) -> MdmConfig {
        MdmConfig {
            arch: self.arch,
            text_encoder_type: TextEncoderKind::Clip,
            latent_dim: self.latent_dim,
            ff_size: self.ff_size,
            layers: self.layers,
            text_width: self.clip.width,
            noise_schedule: self.noise_schedule(),
            mask_frames: true,
            ..MdmConfig::default()
        }
    }
}

impl NetworkConfig for MdmModelConfig {
    type Network = Mdm;

    fn problem(&self) -> Option<String> {
        /// The largest allowed size, which is beyond any network of this kind.
        const MAX_SIZE: usize = 1 << 24;
        let clip = &self.clip;
        for (name, found) in [
            ("ff_size", self.ff_size),
            ("clip.vocab_size", clip.vocab_size),
            ("clip.context_length", clip.context_length),
            ("clip.width", clip.width),
        ] {
            if !(1..=MAX_SIZE).contains(&found) {
                return Some(format!(
                    "{name} must be from 1 to {MAX_SIZE}, found {found}"
                ));
            }
        }
        // The number of heads is in no file of a text tower.
        let heads = clip.width.div_ceil(TEXT_HEAD_WIDTH);
        if !clip.width.is_multiple_of(TEXT_HEAD_WIDTH) || clip.heads != heads {
            return Some(format!(
                "clip must have a width of a multiple of {TEXT_HEAD_WIDTH}, with a head for each {TEXT_HEAD_WIDTH} channels; \
                 found {} heads and a width of {}",
                clip.heads, clip.width
            ));
        }
        self.network().problem()
    }

    fn unsupported(&self, denoising: &DenoisingConfig) -> Option<String> {
        let share = denoising.laban_share;
        (share > 0.0).then(|| {
            format!("denoising.laban_share must be 0, because MDM reads no Laban features, found {share}")
        })
    }

    fn lengths(&self) -> RangeInclusive<usize> {
        CLIP_FRAMES
    }

    fn text_tower(&self) -> &ClipTextConfig {
        &self.clip
    }

    fn noise_schedule(&self) -> NoiseSchedule {
        NoiseSchedule::Cosine {
            timesteps: self.diffusion_steps,
        }
    }

    fn prediction(&self) -> Prediction {
        Prediction::Sample
    }

    fn initial_network(&self, seed: u64, device: &Device) -> Mdm {
        let text = MdmTextConfig::Clip {
            tower: self.clip.clone(),
            output: self.clip.width,
        };
        Mdm::initial(&self.network(), MdmText::new(&text, device), seed, device)
    }

    fn save(
        &self,
        network: &Mdm,
        denoising: &DenoisingConfig,
        folder: &Path,
        metadata: &HashMap<String, String>,
    ) -> Result<(), TrainError> {
        let path = |name: &str| folder.join(name);
        network.save(path("model.safetensors"), Precision::F32, metadata.clone())?;
        let text = network.text();
        text.save(path("clip.safetensors"), Precision::F32, metadata.clone())?;
        let defaults = || sampling_defaults(self.latent_dim, Preset::Fast);
        let arguments = MdmConfig {
            text_dropout: denoising.text_dropout,
            sampling: Some(self.sampling.clone().unwrap_or_else(defaults)),
            ..self.network()
        };
        write_file(&path("args.json"), &arguments.to_json())
    }
}
