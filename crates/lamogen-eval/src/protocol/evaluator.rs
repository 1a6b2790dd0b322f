//! The public evaluator with its words and statistics.

use std::path::{Path, PathBuf};

use burn::tensor::Device;
use lamogen_data::{BenchmarkSplit, Caption};
use lamogen_model::Checkpoint;
use lamogen_motion::{FeatureGroup, Normalization, POSE_FEATURES};
use pytorch_reader::PytorchReader;

use super::files::PublicFiles;
use crate::embedding_batches::{TEXTS_PER_BATCH, embed_in_batches};
use crate::evaluator::embed_motions;
use crate::evaluator_network::PARTS;
use crate::{
    Embeddings, EvaluatorConfig, EvaluatorError, EvaluatorNetwork, EvaluatorNetworkError,
    PartOfSpeech, Sentence, TextForm, Vocabulary,
};

/// The evaluator of Guo et al. 2022 as it was published: it reads words with parts of speech, with GloVe's vectors.
///
/// Without its words it embeds motions only.
#[derive(Clone, Debug)]
pub struct PublicEvaluator {
    network: EvaluatorNetwork,
    normalization: Normalization,
    vocabulary: Option<Vocabulary>,
    /// The file of the deviations, for error messages.
    std: PathBuf,
    device: Device,
}

/// Why statistics are not those of the public evaluator.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error(
    "{path}: expected the statistics of the public evaluator, whose deviations of root and foot contacts are a fifth of the data's; these are {factor:.2} of it{likely}. They lie in Comp_v6_KLD01/meta of the evaluator's release"
)]
pub struct StatisticsProblem {
    /// The file of the deviations.
    pub path: PathBuf,
    /// The deviations of root and foot contacts, divided by those of the data; the other features are taken as 1.
    pub factor: f64,
    /// Whose they may be, in words that follow the number.
    pub likely: &'static str,
}

/// The public trainer divides the deviations of root and foot contacts by this (`feat_bias`), so that networks weigh them more.
const FEATURE_BIAS: f64 = 5.0;
/// The trainer of MotionDiffuse's public networks divides by this.
const MOTION_DIFFUSE_BIAS: f64 = 25.0;

/// The greatest number of frames that the public evaluator reads; no tensor's shape tells it.
const MAX_FRAMES: usize = 196;

impl PublicEvaluator {
    /// Reads an evaluator. The sizes of the networks are those of the tensors.
    ///
    /// # Errors
    ///
    /// If networks or statistics are [missing](PublicFiles::missing), a file cannot be read, or the files do not fit each other. Missing words
    /// are no error: [`has_words`](Self::has_words) tells.
    pub fn load(files: &PublicFiles, device: &Device) -> Result<PublicEvaluator, EvaluatorError> {
        let (Some(network_path), Some([mean, std])) = (files.network(), files.statistics()) else {
            return Err(EvaluatorError::Missing {
                folder: files.folder().to_owned(),
                files: files.missing().to_vec(),
            });
        };
        let config = sizes(network_path)?;
        let normalization = Normalization::from_files(mean, std, config.dim_pose, device)?;
        let vocabulary = files.glove().map(Vocabulary::from_folder).transpose()?;
        if let Some((vocabulary, glove)) = vocabulary.as_ref().zip(files.glove())
            && vocabulary.width() != config.text.dim_word()
        {
            return Err(EvaluatorError::WordWidth {
                path: glove.to_owned(),
                expected: config.text.dim_word(),
                found: vocabulary.width(),
            });
        }
        Ok(PublicEvaluator {
            network: EvaluatorNetwork::load(network_path, &config, device)?,
            normalization,
            vocabulary,
            std: std.to_owned(),
            device: device.clone(),
        })
    }

    /// Returns the network.
    pub fn network(&self) -> &EvaluatorNetwork {
        &self.network
    }

    /// Returns whether the evaluator has its words, and embeds texts.
    pub fn has_words(&self) -> bool {
        self.vocabulary.is_some()
    }

    /// Checks that the statistics are those of the evaluator, and not those of the data or of a denoiser, which differ in the deviations of
    /// root and foot contacts: the public trainer has divided them by 5. With others, all motions are far from what the networks know, and all
    /// figures are wrong without a sign.
    ///
    /// # Errors
    ///
    /// If the deviations, compared with those of the motions, are not near a fifth.
    pub fn check_statistics(&self, split: &BenchmarkSplit) -> Result<(), StatisticsProblem> {
        let [_, std] = self.normalization.values();
        let data = split.deviations();
        let ratio = |group: FeatureGroup| {
            let values = &std[group.range()];
            let mean = values.iter().copied().map(f64::from).sum::<f64>() / values.len() as f64;
            let place = FeatureGroup::ALL.iter().position(|other| *other == group);
            mean / data[place.expect("a group")]
        };
        // As mean logarithms, so that no group counts more than another. Groups that never change say nothing.
        let mean_ratio = |groups: &[FeatureGroup]| {
            let logs = groups.iter().map(|&group| ratio(group).ln());
            let logs: Vec<f64> = logs.filter(|log| log.is_finite()).collect();
            (!logs.is_empty()).then(|| (logs.iter().sum::<f64>() / logs.len() as f64).exp())
        };
        let biased = mean_ratio(&[
            FeatureGroup::RootYaw,
            FeatureGroup::RootVelocity,
            FeatureGroup::RootHeight,
            FeatureGroup::FootContact,
        ]);
        let plain = mean_ratio(&[
            FeatureGroup::LocalPositions,
            FeatureGroup::Rotations,
            FeatureGroup::Velocities,
        ]);
        let Some((biased, plain)) = biased.zip(plain) else {
            return Ok(());
        };
        let factor = biased / plain;
        let nearest = [1.0, FEATURE_BIAS, MOTION_DIFFUSE_BIAS].map(|bias: f64| {
            let distance = (factor.ln() + bias.ln()).abs();
            (distance, bias)
        });
        let nearest = nearest.into_iter().min_by(|a, b| a.0.total_cmp(&b.0));
        let (distance, bias) = nearest.expect("three");
        // A third of the way to the next: HumanML3D's splits differ by far less.
        let is_near = distance < FEATURE_BIAS.ln() / 3.0;
        let likely = match bias {
            FEATURE_BIAS if is_near => return Ok(()),
            1.0 if is_near => ", as in HumanML3D's own Mean.npy and Std.npy",
            MOTION_DIFFUSE_BIAS if is_near => ", as in the folder meta of MotionDiffuse's networks",
            _ => "",
        };
        Err(StatisticsProblem {
            path: self.std.clone(),
            factor,
            likely,
        })
    }

    /// Embeds captions by their tokens, in their order.
    ///
    /// # Errors
    ///
    /// If the evaluator has no words, a caption has no tokens or tokens that cannot be read, or the network gives numbers that are not finite.
    pub fn captions(&self, captions: &[&Caption]) -> Result<Embeddings, EvaluatorError> {
        let vocabulary = self.vocabulary.as_ref().ok_or(EvaluatorError::NoWords)?;
        let sentences = captions.iter().map(|caption| {
            let tokens = caption.tokens.as_deref();
            let tokens = tokens.ok_or_else(|| EvaluatorError::NoTokens {
                caption: caption.text.clone(),
            })?;
            Ok(vocabulary.sentence(tokens)?)
        });
        let sentences: Vec<Sentence> = sentences.collect::<Result<_, EvaluatorError>>()?;
        let embed = |indices: &[usize]| {
            let batch: Vec<Sentence> = indices.iter().map(|&i| sentences[i].clone()).collect();
            self.network
                .embed_text(&vocabulary.batch(&batch, &self.device))
        };
        let width = self.network.config().dim_coemb_hidden;
        let length = |index: usize| sentences[index].len();
        let count = sentences.len();
        Ok(embed_in_batches(
            TEXTS_PER_BATCH,
            width,
            &length,
            count,
            embed,
        )?)
    }

    /// Checks that a caption has tokens that the evaluator reads; always true of one without words.
    ///
    /// # Errors
    ///
    /// If there are no tokens, or one is not a word, a slash and a part of speech.
    pub fn check_caption(&self, caption: &Caption) -> Result<(), EvaluatorError> {
        let Some(vocabulary) = &self.vocabulary else {
            return Ok(());
        };
        match &caption.tokens {
            Some(tokens) => Ok(vocabulary.sentence(tokens).map(drop)?),
            None => Err(EvaluatorError::NoTokens {
                caption: caption.text.clone(),
            }),
        }
    }

    /// Embeds motions, in their order, as [`Evaluator::motions`](crate::Evaluator::motions) does.
    ///
    /// # Errors
    ///
    /// If a motion does not have as many frames as the network reads (4 to 199), or the network gives numbers that are not finite.
    pub fn motions(&self, motions: &[impl AsRef<[f32]>]) -> Result<Embeddings, EvaluatorError> {
        embed_motions(&self.network, &self.normalization, motions, &self.device)
    }
}

/// Derives the sizes of the networks from the shapes of their tensors.
fn sizes(path: &Path) -> Result<EvaluatorConfig, EvaluatorError> {
    // This finds what is wrong with the file itself.
    Checkpoint::open_parts(path, &PARTS).map_err(EvaluatorNetworkError::from)?;
    let sizes = |problem: String| EvaluatorNetworkError::Sizes {
        path: path.to_owned(),
        problem,
    };
    let tensors = PytorchReader::new(path).map_err(|error| sizes(error.to_string()))?;
    let tensors = tensors.into_tensors();
    let axis = |key: &str, rank: usize, axis: usize| match tensors.get(key) {
        Some(tensor) if tensor.shape().len() == rank => Ok(tensor.shape()[axis]),
        Some(tensor) => Err(sizes(format!(
            "expected {rank} axes of `{key}`, found the shape {:?}",
            tensor.shape()
        ))),
        None => Err(sizes(format!("there is no tensor `{key}`"))),
    };
    let config = EvaluatorConfig {
        dim_pose: axis("movement_encoder.main.0.weight", 3, 1)? + EvaluatorConfig::CONTACTS,
        max_motion_length: MAX_FRAMES,
        dim_movement_enc_hidden: axis("movement_encoder.main.0.weight", 3, 0)?,
        dim_movement_latent: axis("movement_encoder.out_net.weight", 2, 0)?,
        dim_motion_hidden: axis("motion_encoder.input_emb.weight", 2, 0)?,
        dim_text_hidden: axis("text_encoder.input_emb.weight", 2, 0)?,
        dim_coemb_hidden: axis("motion_encoder.output_net.3.weight", 2, 0)?,
        text: TextForm::Words {
            dim_word: axis("text_encoder.pos_emb.weight", 2, 0)?,
            dim_pos_ohot: axis("text_encoder.pos_emb.weight", 2, 1)?,
        },
    };
    if config.dim_pose != POSE_FEATURES {
        let found = config.dim_pose;
        let problem = format!(
            "expected an evaluator of HumanML3D's {POSE_FEATURES} pose features, found one of {found} (KIT-ML has 251)"
        );
        return Err(sizes(problem).into());
    }
    let parts = axis("text_encoder.pos_emb.weight", 2, 1)?;
    let expected = PartOfSpeech::ALL.len();
    if parts != expected {
        let problem = format!("expected {expected} parts of speech, found {parts}");
        return Err(sizes(problem).into());
    }
    match config.problem() {
        None => Ok(config),
        Some(problem) => Err(sizes(problem).into()),
    }
}
