//! Loading of MDM and DiP from the folders of their authors.

use std::path::{Path, PathBuf};

use burn::tensor::Device;
use lamogen_guide::Preset;
use lamogen_model::{AnyNetwork, Denoiser, Mdm, MdmConfig, SamplingDefaults};
use lamogen_motion::{FeatureGroup, Normalization, POSE_FEATURES};

use super::text_encoder::TextEncoderFiles;
use super::{folder_contents, load_known_words, statistics_path};
use crate::error::LoadError;
use crate::generation::LaMoGen;
use crate::licence::Licence;

/// The name of the file with the options of the training, by which a folder is known as that of an MDM.
const ARGUMENTS: &str = "args.json";

/// The name of the weights of a network that lamogen trained.
const TRAINED_WEIGHTS: &str = "model.safetensors";

/// The preset of an MDM whose `args.json` recommends none.
const PRESET: Preset = Preset::Fast;

/// The scale of classifier-free guidance that MDM's authors generate with.
const MDM_TEXT_SCALE: f64 = 2.5;

/// The scale that DiP's authors generate with.
const DIP_TEXT_SCALE: f64 = 7.5;

/// The files of an MDM.
pub(super) struct MdmFiles {
    folder: PathBuf,
    weights: PathBuf,
}

impl MdmFiles {
    /// Finds the files in a folder, or beside the weights that `path` names. Returns `None` if `path` is not an MDM.
    pub(super) fn find(path: &Path) -> Result<Option<Self>, LoadError> {
        if is_weights(path) && path.is_file() {
            let folder = path.parent().unwrap_or(Path::new("."));
            return Self::of(folder, path.to_owned()).map(Some);
        }
        let trained = || Some(path.join(TRAINED_WEIGHTS)).filter(|weights| weights.exists());
        let has_arguments = path.join(ARGUMENTS).exists();
        let weights = newest_weights(path).or_else(|| trained().filter(|_| has_arguments));
        match (has_arguments, weights) {
            (true, None) => Err(LoadError::NoMdmWeights {
                folder: path.to_owned(),
                found: folder_contents(path),
            }),
            (false, None) => Ok(None),
            (_, Some(weights)) => Self::of(path, weights).map(Some),
        }
    }

    fn of(folder: &Path, weights: PathBuf) -> Result<Self, LoadError> {
        match folder.join(ARGUMENTS).exists() {
            true => Ok(MdmFiles {
                folder: folder.to_owned(),
                weights,
            }),
            false => Err(LoadError::NoMdmArguments {
                weights,
                found: folder_contents(folder),
            }),
        }
    }

    pub(super) fn load(&self, device: &Device) -> Result<LaMoGen, LoadError> {
        let folder = &self.folder;
        let arguments = folder.join(ARGUMENTS);
        let config = MdmConfig::from_file(&arguments)?;
        let pose_features = |path: &Path, found: usize| match found {
            POSE_FEATURES => Ok(()),
            found => Err(LoadError::PoseFeatures {
                path: path.to_owned(),
                found,
            }),
        };
        pose_features(&arguments, config.features)?;
        let weights = config.open_weights(&self.weights)?;
        let config = config.with_sizes_of(&weights)?;
        pose_features(&self.weights, config.features)?;
        let normalization = self.normalization(device)?;
        let files = TextEncoderFiles::find(folder, config.text_encoder_type)?;
        let (text, tokenizer) = files.load(config.text_width, device)?;
        let network = Mdm::load(&weights, &config, text, device)?;
        let text_scale = match (config.text_dropout > 0.0, network.window()) {
            (false, _) => 1.0,
            (true, None) => MDM_TEXT_SCALE,
            (true, Some(_)) => DIP_TEXT_SCALE,
        };
        let sampling = config.sampling.unwrap_or_default();
        let sampling = SamplingDefaults {
            preset: { sampling.preset }.or_else(|| Some(PRESET.name().to_owned())),
            text_scale: sampling.text_scale.or(Some(text_scale)),
            ..sampling
        };
        LaMoGen::new(AnyNetwork::from(network), tokenizer, normalization)
            .with_licence(Licence::of(&weights))
            .with_known_words(load_known_words(folder)?)
            .with_sampling_defaults(sampling, &arguments)
    }

    /// Reads HumanML3D's mean and deviation, by which MDM's features are normalised.
    fn normalization(&self, device: &Device) -> Result<Normalization, LoadError> {
        let path = |name: &str| {
            let own = self.folder.join(name);
            let lower = statistics_path(&self.folder, &name.to_lowercase());
            match !own.exists() && lower.exists() {
                true => lower,
                false => own,
            }
        };
        let (mean, std) = (path("Mean.npy"), path("Std.npy"));
        let normalization = Normalization::from_files(&mean, &std, POSE_FEATURES, device)?;
        refuse_evaluator_statistics(&normalization, std)?;
        Ok(normalization)
    }
}

/// Returns whether a file has the name of an MDM's weights, such as `model000750000.pt`.
fn is_weights(path: &Path) -> bool {
    weights_number(path).is_some()
}

/// Returns the number in the name of an MDM's weights, that of their training step.
fn weights_number(path: &Path) -> Option<u64> {
    let name = path.file_name()?.to_str()?;
    let digits = name.strip_prefix("model")?.strip_suffix(".pt")?;
    match digits.bytes().all(|digit| digit.is_ascii_digit()) {
        true => digits.parse().ok(),
        false => None,
    }
}

/// Returns the weights in a folder that have the highest number.
fn newest_weights(folder: &Path) -> Option<PathBuf> {
    let entries = std::fs::read_dir(folder).ok()?;
    let paths = entries.flatten().map(|entry| entry.path());
    paths
        .filter_map(|path| Some((weights_number(&path)?, path)))
        .max()
        .map(|(_, path)| path)
}

/// Refuses the statistics of the networks that evaluate motions. They weigh the root and the foot contacts 25 times as much,
/// and an MDM would move at the wrong speed with them.
fn refuse_evaluator_statistics(
    normalization: &Normalization,
    path: PathBuf,
) -> Result<(), LoadError> {
    /// The ratio to the deviation that a mean implies, below which deviations were scaled.
    const MIN_RATIO: f32 = 0.2;
    let [means, deviations] = normalization.values();
    let contacts = FeatureGroup::FootContact.range();
    // A contact is 0 or 1, so that its mean implies its deviation.
    let implied = |mean: f32| (mean * (1.0 - mean)).max(0.0).sqrt();
    let is_scaled = |feature: usize| {
        let implied = implied(means[feature]);
        implied > 0.0 && deviations[feature] < MIN_RATIO * implied
    };
    match contacts.clone().all(is_scaled) {
        false => Ok(()),
        true => Err(LoadError::EvaluatorStatistics {
            path,
            mean: means[contacts.start],
            expected: implied(means[contacts.start]),
            found: deviations[contacts.start],
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_weights_with_the_highest_number_are_read() {
        let folder = tempfile::tempdir().unwrap();
        for name in [
            "model000600000.pt",
            "model000750000.pt",
            "model.safetensors",
            "opt000999999.pt",
            "model_best.pt",
        ] {
            std::fs::write(folder.path().join(name), []).unwrap();
        }
        let newest = newest_weights(folder.path()).unwrap();
        assert!(newest.ends_with("model000750000.pt"), "{newest:?}");
    }

    #[test]
    fn deviations_that_contacts_cannot_have_are_those_of_the_evaluators() {
        let check = |deviation: f32| {
            let (mut mean, mut std) = ([0.0; POSE_FEATURES], [1.0; POSE_FEATURES]);
            mean[POSE_FEATURES - 4..].fill(0.85);
            std[POSE_FEATURES - 4..].fill(deviation);
            let normalization = Normalization::from_slices(&mean, &std, &Device::flex()).unwrap();
            refuse_evaluator_statistics(&normalization, "folder/Std.npy".into())
        };
        // Those of HumanML3D and of the evaluators.
        check(0.356).unwrap();
        let message = check(0.0141).unwrap_err().to_string();
        for part in [
            "folder/Std.npy",
            "Mean.npy",
            "t2m_std.npy",
            "0.36",
            "0.0141",
        ] {
            assert!(message.contains(part), "{part} is not in: {message}");
        }
    }
}
