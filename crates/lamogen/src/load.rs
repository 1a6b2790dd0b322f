//! Where models come from.

use std::path::Path;

use burn::tensor::Device;
use lamogen_guide::Preset;
use lamogen_model::{Checkpoint, ModelConfig, MotionDiffuse, Tokenizer};
use lamogen_motion::{Normalization, POSE_FEATURES};

use crate::error::LoadError;
use crate::generation::LaMoGen;
use crate::licence::Licence;

impl LaMoGen<MotionDiffuse> {
    /// The compact model that is part of the program. Its licence, CC BY-NC 4.0, excludes
    /// commercial use.
    ///
    /// # Errors
    ///
    /// None in a build that passes its tests: the same checks run as for a model from a folder.
    #[cfg(feature = "compact")]
    pub fn embedded(device: &Device) -> Result<Self, LoadError> {
        use lamogen_compact as compact;
        let name = |file: &str| format!("lamogen-compact/{file}");
        let config = ModelConfig::from_json(compact::CONFIG, name("config.json"))?;
        let checkpoint = Checkpoint::embedded(compact::WEIGHTS, &name("model.safetensors"))?;
        let tokenizer = Tokenizer::from_json(
            compact::TOKENIZER,
            name("tokenizer.json"),
            config.clip.vocab_size,
            config.clip.context_length,
        )?;
        let normalization =
            Normalization::from_bytes(compact::MEAN, compact::STD, config.input_feats, device)?;
        let network = checkpoint.load(&config, device)?;
        Ok(LaMoGen::new(network, tokenizer, normalization)
            .with_licence(Licence::of(&checkpoint))
            .with_preset(Preset::Fast))
    }

    /// A model from a folder: `config.json`, `model.safetensors` or `latest.tar` (the first where
    /// both are there), `tokenizer.json`, `mean.npy` and `std.npy`. Requests that say nothing else
    /// run with the paper's numbers ([`Preset::Paper`]).
    ///
    /// # Errors
    ///
    /// If a file is missing or damaged, or the files do not fit each other.
    pub fn load(folder: impl AsRef<Path>, device: &Device) -> Result<Self, LoadError> {
        let folder = folder.as_ref();
        let config_path = folder.join("config.json");
        let config = ModelConfig::from_file(&config_path)?;
        if config.input_feats != POSE_FEATURES {
            return Err(LoadError::PoseFeatures {
                path: config_path,
                found: config.input_feats,
            });
        }
        let tokenizer = Tokenizer::from_file(
            folder.join("tokenizer.json"),
            config.clip.vocab_size,
            config.clip.context_length,
        )?;
        let normalization = Normalization::from_files(
            folder.join("mean.npy"),
            folder.join("std.npy"),
            config.input_feats,
            device,
        )?;
        let weights = ["model.safetensors", "latest.tar"]
            .map(|name| folder.join(name))
            .into_iter()
            .find(|path| path.exists())
            .ok_or_else(|| LoadError::NoWeights {
                folder: folder.to_owned(),
                found: content(folder),
            })?;
        let checkpoint = Checkpoint::open(weights)?;
        let network = checkpoint.load(&config, device)?;
        Ok(LaMoGen::new(network, tokenizer, normalization)
            .with_licence(Licence::of(&checkpoint))
            .with_preset(Preset::Paper))
    }

    /// Sizes of the network.
    pub fn config(&self) -> &ModelConfig {
        self.network().config()
    }
}

/// The names of a folder's files, for messages.
fn content(folder: &Path) -> String {
    let mut names: Vec<String> = std::fs::read_dir(folder)
        .into_iter()
        .flatten()
        .flatten()
        .map(|entry| entry.file_name().to_string_lossy().into_owned())
        .collect();
    names.sort_unstable();
    match names.is_empty() {
        true => "nothing".into(),
        false => names.join(", "),
    }
}
