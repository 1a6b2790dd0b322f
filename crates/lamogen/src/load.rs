//! Where models come from.

use std::fmt;
use std::path::{Path, PathBuf};

use burn::tensor::Device;
use lamogen_guide::{Preset, PresetError, TemporalSmoothing};
use lamogen_model::{Checkpoint, KnownWords, ModelConfig, MotionDiffuse, Tokenizer};
use lamogen_motion::{Normalization, POSE_FEATURES};

use crate::error::LoadError;
use crate::generation::LaMoGen;
use crate::licence::Licence;

impl LaMoGen<MotionDiffuse> {
    /// The compact model that is part of the program. Its licence, CC BY 4.0, allows products that name its sources
    /// ([`licence`](Self::licence)). Requests that say nothing else run with [`Preset::Precise`], and predictions are smoothed
    /// along time ([`TemporalSmoothing`]), as its `config.json` says.
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
        LaMoGen::new(network, tokenizer, normalization)
            .with_licence(Licence::of(&checkpoint))
            .with_known_words(Some(KnownWords::from_lines(compact::WORDS)))
            .sampled_by_default(Path::new(&name("config.json")))
    }

    /// A model from a folder: weights in `model.safetensors` or `latest.tar` (the first where both are
    /// there), and `mean.npy` and `std.npy`; or MotionDiffuse's own folder with `model/latest.tar`,
    /// `meta/mean.npy` and `meta/std.npy`.
    ///
    /// A `config.json` states the sizes of the network; without one they are read off the weights (see
    /// [`Checkpoint::config`]), as for MotionDiffuse's `latest.tar`. A `tokenizer.json` holds the
    /// tokenizer; without one it is CLIP's own, if the network has CLIP's vocabulary. A `words.txt` lists the words of the captions that it was
    /// trained on, one a line.
    ///
    /// Requests that say nothing else run as the `sampling` of `config.json` says ([`SamplingDefaults`](lamogen_model::SamplingDefaults)); where it
    /// says nothing, with the paper's numbers ([`Preset::Paper`]) and without smoothing.
    ///
    /// # Errors
    ///
    /// If a file is missing or damaged, or the files do not fit each other.
    pub fn load(folder: impl AsRef<Path>, device: &Device) -> Result<Self, LoadError> {
        let folder = folder.as_ref();
        let weights =
            ["model.safetensors", "latest.tar", "model/latest.tar"].map(|name| folder.join(name));
        let weights = weights.into_iter().find(|path| path.exists());
        let weights = weights.ok_or_else(|| LoadError::NoWeights {
            folder: folder.to_owned(),
            found: content(folder),
        })?;
        let (config, sizes_from, checkpoint) = sizes(folder, weights)?;
        if config.input_feats != POSE_FEATURES {
            return Err(LoadError::PoseFeatures {
                path: sizes_from,
                found: config.input_feats,
            });
        }
        let tokenizer = tokenizer(folder, &config)?;
        let normalization = Normalization::from_files(
            statistics(folder, "mean.npy"),
            statistics(folder, "std.npy"),
            config.input_feats,
            device,
        )?;
        let known_words = known_words(folder)?;
        let network = checkpoint.load(&config, device)?;
        LaMoGen::new(network, tokenizer, normalization)
            .with_licence(Licence::of(&checkpoint))
            .with_known_words(known_words)
            .sampled_by_default(&sizes_from)
    }

    /// Samples as the network's config says; `path` is where it stands.
    fn sampled_by_default(self, path: &Path) -> Result<Self, LoadError> {
        let sampling = self.config().sampling.clone().unwrap_or_default();
        let problem = |problem: &dyn fmt::Display| LoadError::Sampling {
            path: path.to_owned(),
            problem: problem.to_string(),
        };
        let preset = match &sampling.preset {
            Some(name) => name.parse().map_err(|error: PresetError| problem(&error))?,
            None => Preset::Paper,
        };
        let frames = sampling.temporal_smoothing.filter(|frames| *frames != 0.0);
        let temporal_smoothing = frames.map(|frames| TemporalSmoothing {
            frames,
            ..TemporalSmoothing::default()
        });
        self.with_preset(preset)
            .with_stand_in(sampling.stand_in)
            .with_temporal_smoothing(temporal_smoothing)
            .and_then(|model| model.with_text_scale(sampling.text_scale.unwrap_or(1.0)))
            .map_err(|error| problem(&error))
    }

    /// Sizes of the network.
    pub fn config(&self) -> &ModelConfig {
        self.network().config()
    }
}

/// Sizes of the network, the file that tells them, and the opened weights.
fn sizes(folder: &Path, weights: PathBuf) -> Result<(ModelConfig, PathBuf, Checkpoint), LoadError> {
    let path = folder.join("config.json");
    if path.exists() {
        let config = ModelConfig::from_file(&path)?;
        return Ok((config, path, Checkpoint::open(weights)?));
    }
    let checkpoint = Checkpoint::open(&weights)?;
    let config = checkpoint.config()?;
    // Heads and prediction are in no shape: they are known of MotionDiffuse alone.
    let (public, found) = (
        ModelConfig::motion_diffuse().clip.vocab_size,
        config.clip.vocab_size,
    );
    match found == public {
        true => Ok((config, weights, checkpoint)),
        false => Err(LoadError::NoConfig {
            path,
            public,
            found,
        }),
    }
}

/// Mean or standard deviation: in the folder or, as MotionDiffuse has them, in `meta`.
fn statistics(folder: &Path, name: &str) -> PathBuf {
    let (here, meta) = (folder.join(name), folder.join("meta").join(name));
    match !here.exists() && meta.exists() {
        true => meta,
        false => here,
    }
}

/// The folder's tokenizer, or CLIP's.
fn tokenizer(folder: &Path, config: &ModelConfig) -> Result<Tokenizer, LoadError> {
    let path = folder.join("tokenizer.json");
    if path.exists() {
        let clip = &config.clip;
        return Ok(Tokenizer::from_file(
            path,
            clip.vocab_size,
            clip.context_length,
        )?);
    }
    let tokenizer = Tokenizer::clip(config.clip.context_length);
    match tokenizer.vocab_size() == config.clip.vocab_size {
        true => Ok(tokenizer),
        false => Err(LoadError::NoTokenizer {
            path,
            clip: tokenizer.vocab_size(),
            found: config.clip.vocab_size,
        }),
    }
}

/// The words of the captions that the model was trained on, where the folder says them.
fn known_words(folder: &Path) -> Result<Option<KnownWords>, LoadError> {
    let path = folder.join("words.txt");
    if !path.exists() {
        return Ok(None);
    }
    let lines =
        std::fs::read_to_string(&path).map_err(|reason| LoadError::Words { path, reason })?;
    Ok(Some(KnownWords::from_lines(&lines)))
}

/// The names of a folder's files, for messages.
fn content(folder: &Path) -> String {
    let entries = match std::fs::read_dir(folder) {
        Ok(entries) => entries.flatten(),
        Err(error) => return format!("no folder that can be read ({error})"),
    };
    let mut names: Vec<String> = entries
        .map(|entry| entry.file_name().to_string_lossy().into_owned())
        .collect();
    names.sort_unstable();
    match names.is_empty() {
        true => "an empty folder".into(),
        false => names.join(", "),
    }
}
