//! Loading models: the embedded one, and those in folders.

mod mdm;
mod text_encoder;

use std::fmt;
use std::path::{Path, PathBuf};

use burn::tensor::Device;
use lamogen_guide::{Preset, PresetError, TemporalSmoothing, TextScale};
use lamogen_model::{
    AnyConfig, AnyNetwork, Checkpoint, ModelConfig, SamplingDefaults, Tokenizer, WordList,
};
use lamogen_motion::{Normalization, POSE_FEATURES};

use crate::error::LoadError;
use crate::generation::LaMoGen;
use crate::licence::Licence;
use mdm::MdmFiles;

impl LaMoGen {
    /// Loads the compact model that is part of the program.
    ///
    /// Its licence, CC BY 4.0, allows products that name its sources ([`licence`](Self::licence)). As its `config.json`
    /// says, requests without a preset run with [`Preset::Precise`], and predictions are smoothed along time
    /// ([`TemporalSmoothing`]).
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
        LaMoGen::new(AnyNetwork::from(network), tokenizer, normalization)
            .with_licence(Licence::of(&checkpoint))
            .with_known_words(Some(WordList::from_lines(compact::WORDS)))
            .with_sampling_defaults(
                config.sampling.unwrap_or_default(),
                Path::new(&name("config.json")),
            )
    }

    /// Loads a model from a folder.
    ///
    /// The folder has the weights in `model.safetensors` or `latest.tar` (the first where both are there), and
    /// `mean.npy` and `std.npy`. MotionDiffuse's own folder with `model/latest.tar`, `meta/mean.npy` and
    /// `meta/std.npy` is read too.
    ///
    /// A `config.json` states the sizes of the network; without one they are derived from the weights (see
    /// [`Checkpoint::config`]), as for MotionDiffuse's `latest.tar`. A `tokenizer.json` holds the tokenizer; without
    /// one the tokenizer is CLIP's own, if the network has CLIP's vocabulary. A `words.txt` lists the words of the
    /// captions that the model was trained on, one a line.
    ///
    /// A folder with an `args.json` has an MDM or a DiP (Tevet et al.), with its weights in `model….pt` (or
    /// `model.safetensors`, where lamogen trained it) and HumanML3D's `Mean.npy` and `Std.npy`. Where there are several weights, those with the highest number are read; the path of a
    /// `model….pt` in the place of the folder names others. The text encoder is found in the folder or the one above:
    /// CLIP's text tower in `clip.safetensors`, `clip-vit-base-patch32/model.safetensors` or MotionDiffuse's
    /// `latest.tar`, DistilBERT in `distilbert-base-uncased/` with its `tokenizer.json` (all names: docs/checkpoints.md).
    ///
    /// Requests without a preset run as the `sampling` of `config.json` says
    /// ([`SamplingDefaults`]). Where it says nothing, they run with the paper's
    /// numbers ([`Preset::Paper`]) and without smoothing. An MDM runs with [`Preset::Fast`], with its own sampler and the
    /// text scale of its authors.
    ///
    /// # Errors
    ///
    /// If a file is missing or damaged, or the files do not fit each other.
    pub fn load(folder: impl AsRef<Path>, device: &Device) -> Result<Self, LoadError> {
        let folder = folder.as_ref();
        if let Some(files) = MdmFiles::find(folder)? {
            return files.load(device);
        }
        let weights =
            ["model.safetensors", "latest.tar", "model/latest.tar"].map(|name| folder.join(name));
        let weights = weights.into_iter().find(|path| path.exists());
        let weights = weights.ok_or_else(|| LoadError::NoWeights {
            folder: folder.to_owned(),
            found: folder_contents(folder),
        })?;
        let (config, config_source, checkpoint) = open_weights(folder, weights)?;
        if config.input_feats != POSE_FEATURES {
            return Err(LoadError::PoseFeatures {
                path: config_source,
                found: config.input_feats,
            });
        }
        let tokenizer = load_tokenizer(folder, &config)?;
        let normalization = Normalization::from_files(
            statistics_path(folder, "mean.npy"),
            statistics_path(folder, "std.npy"),
            config.input_feats,
            device,
        )?;
        let known_words = load_known_words(folder)?;
        let network = checkpoint.load(&config, device)?;
        LaMoGen::new(AnyNetwork::from(network), tokenizer, normalization)
            .with_licence(Licence::of(&checkpoint))
            .with_known_words(known_words)
            .with_sampling_defaults(config.sampling.unwrap_or_default(), &config_source)
    }

    /// Sets the preset and the other sampling options that the network's config states. Errors name `path`, the file
    /// of the config.
    fn with_sampling_defaults(
        self,
        sampling: SamplingDefaults,
        path: &Path,
    ) -> Result<Self, LoadError> {
        let problem = |problem: &dyn fmt::Display| LoadError::Sampling {
            path: path.to_owned(),
            problem: problem.to_string(),
        };
        let preset = match &sampling.preset {
            Some(name) => name.parse().map_err(|error: PresetError| problem(&error))?,
            None => Preset::Paper,
        };
        if sampling
            .stand_in
            .as_deref()
            .is_some_and(|text| text.trim().is_empty())
        {
            return Err(problem(
                &"expected a sentence as stand_in, found an empty text",
            ));
        }
        let frames = sampling.temporal_smoothing.filter(|frames| *frames != 0.0);
        let temporal_smoothing = frames.map(|frames| TemporalSmoothing {
            frames,
            ..TemporalSmoothing::default()
        });
        let text_scale = TextScale::default().with(sampling.text_scale, sampling.text_scale_until);
        self.with_preset(preset)
            .with_stand_in(sampling.stand_in)
            .with_temporal_smoothing(temporal_smoothing)
            .and_then(|model| model.with_text_scale(text_scale))
            .map_err(|error| problem(&error))
    }

    /// Returns the config of the network, which states its sizes.
    pub fn config(&self) -> AnyConfig<'_> {
        self.network().config()
    }
}

/// Opens the weights. Returns the config of the network, the file that the config comes from, and the checkpoint.
fn open_weights(
    folder: &Path,
    weights: PathBuf,
) -> Result<(ModelConfig, PathBuf, Checkpoint), LoadError> {
    let path = folder.join("config.json");
    if path.exists() {
        let config = ModelConfig::from_file(&path)?;
        return Ok((config, path, Checkpoint::open(weights)?));
    }
    let checkpoint = Checkpoint::open(&weights)?;
    let config = checkpoint.config()?;
    // The shapes of the weights tell neither the number of heads nor what the network predicts. Without a config they
    // are known only of MotionDiffuse.
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

/// Returns the path of the mean or the standard deviation: in the folder or, as in MotionDiffuse's own folder, in
/// `meta`.
fn statistics_path(folder: &Path, name: &str) -> PathBuf {
    let (here, meta) = (folder.join(name), folder.join("meta").join(name));
    match !here.exists() && meta.exists() {
        true => meta,
        false => here,
    }
}

/// Loads the tokenizer of the folder, or CLIP's if the folder has none.
fn load_tokenizer(folder: &Path, config: &ModelConfig) -> Result<Tokenizer, LoadError> {
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

/// Loads the words of the captions that the model was trained on, if the folder lists them.
fn load_known_words(folder: &Path) -> Result<Option<WordList>, LoadError> {
    let path = folder.join("words.txt");
    if !path.exists() {
        return Ok(None);
    }
    let lines =
        std::fs::read_to_string(&path).map_err(|reason| LoadError::Words { path, reason })?;
    Ok(Some(WordList::from_lines(&lines)))
}

/// Lists the names of the files in a folder, for error messages.
fn folder_contents(folder: &Path) -> String {
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
