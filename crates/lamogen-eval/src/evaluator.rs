//! An evaluator network together with its tokenizer and the statistics of its features.

use std::collections::HashMap;
use std::io::{ErrorKind, Write};
use std::path::Path;
use std::sync::Arc;

use burn::tensor::Device;
use lamogen_model::{Precision, Tokenizer, TokenizerError, Tokens};
use lamogen_motion::{Normalization, npy, write_atomically};

use crate::embedding_batches::{
    MOTIONS_PER_BATCH, MotionInputs, TEXTS_PER_BATCH, embed_in_batches,
};
use crate::{
    Embeddings, EvaluatorError, EvaluatorNetwork, EvaluatorNetworkError, TextBatch, TextForm,
};

/// An [`EvaluatorNetwork`] that reads tokens, with its tokenizer and the mean and standard deviation of the motions that
/// it was trained on. It maps plain texts and motions to [`Embeddings`].
///
/// ```text
/// FOLDER/model.safetensors   the weights
///        config.json         the sizes
///        tokenizer.json      the tokenizer; if there is none, CLIP's tokenizer is used
///        mean.npy, std.npy   mean and standard deviation of the pose features
/// ```
///
/// Cloning is cheap.
#[derive(Clone, Debug)]
pub struct Evaluator {
    network: EvaluatorNetwork,
    device: Device,
    tokenizer: Tokenizer,
    normalization: Normalization,
    files: Arc<EvaluatorFiles>,
}

/// The contents of an evaluator's folder besides the network.
#[derive(Debug)]
struct EvaluatorFiles {
    /// The content of `tokenizer.json`; `None` for CLIP's tokenizer.
    tokenizer: Option<Vec<u8>>,
    mean: Vec<f32>,
    std: Vec<f32>,
}

const TOKENIZER: &str = "tokenizer.json";
const MEAN: &str = "mean.npy";
const STD: &str = "std.npy";

impl Evaluator {
    /// Returns an evaluator from its parts: a network on `device`, the content of a `tokenizer.json` (`None` for CLIP's
    /// tokenizer), and the mean and the standard deviation of every feature.
    ///
    /// # Errors
    ///
    /// If the network does not read tokens, the tokenizer does not fit its vocabulary, or the statistics are of another
    /// number of features than the network's or are not valid.
    pub fn new(
        network: EvaluatorNetwork,
        tokenizer_json: Option<&[u8]>,
        [mean, std]: [&[f32]; 2],
        device: &Device,
    ) -> Result<Evaluator, EvaluatorError> {
        let files = EvaluatorFiles {
            tokenizer: tokenizer_json.map(<[u8]>::to_vec),
            mean: mean.to_vec(),
            std: std.to_vec(),
        };
        Self::from_files(network, files, Path::new(TOKENIZER), device)
    }

    /// Reads an evaluator from a folder that [`save`](Self::save) wrote.
    ///
    /// # Errors
    ///
    /// If a file cannot be read, or the files do not fit each other.
    pub fn load(folder: impl AsRef<Path>, device: &Device) -> Result<Evaluator, EvaluatorError> {
        let folder = folder.as_ref();
        let network = EvaluatorNetwork::from_folder(folder, device)?;
        let path = folder.join(TOKENIZER);
        let tokenizer = match std::fs::read(&path) {
            Ok(json) => Some(json),
            Err(error) if error.kind() == ErrorKind::NotFound => None,
            Err(reason) => return Err(TokenizerError::Io { path, reason }.into()),
        };
        let [mean, std] = [MEAN, STD].map(|name| folder.join(name));
        // The statistics are checked here, because here an error can name the file.
        Normalization::from_files(&mean, &std, network.config().dim_pose, device)?;
        let files = EvaluatorFiles {
            tokenizer,
            mean: npy::read(mean)?.values,
            std: npy::read(std)?.values,
        };
        Self::from_files(network, files, &path, device)
    }

    /// Checks that the parts fit each other, and joins them. `tokenizer_path` is the tokenizer's name in error messages.
    fn from_files(
        network: EvaluatorNetwork,
        files: EvaluatorFiles,
        tokenizer_path: &Path,
        device: &Device,
    ) -> Result<Evaluator, EvaluatorError> {
        let config = network.config();
        let TextForm::Tokens {
            vocab_size,
            context_length,
            ..
        } = config.text
        else {
            return Err(EvaluatorError::Words);
        };
        if files.mean.len() != config.dim_pose {
            return Err(EvaluatorError::Features {
                expected: config.dim_pose,
                found: files.mean.len(),
            });
        }
        let tokenizer = match &files.tokenizer {
            Some(json) => Tokenizer::from_json(json, tokenizer_path, vocab_size, context_length)?,
            None => Tokenizer::clip(context_length),
        };
        if files.tokenizer.is_none() && tokenizer.vocab_size() != vocab_size {
            return Err(EvaluatorError::NoTokenizer {
                vocab_size,
                clip: tokenizer.vocab_size(),
            });
        }
        Ok(Evaluator {
            tokenizer,
            normalization: Normalization::from_slices(&files.mean, &files.std, device)?,
            device: device.clone(),
            files: Arc::new(files),
            network,
        })
    }

    /// Returns the evaluator with another network of the same sizes on the same device, such as the same network after
    /// further training.
    pub fn with(&self, network: EvaluatorNetwork) -> Evaluator {
        Evaluator {
            network,
            ..self.clone()
        }
    }

    /// Writes the files that [`load`](Self::load) reads into an existing folder. `metadata` is stored with the weights.
    /// Each file appears complete or not at all.
    ///
    /// # Errors
    ///
    /// If a file cannot be written, or `precision` is 16 bits and a weight is beyond their range.
    pub fn save(
        &self,
        folder: impl AsRef<Path>,
        precision: Precision,
        metadata: HashMap<String, String>,
    ) -> Result<(), EvaluatorError> {
        let folder = folder.as_ref();
        self.network.save(folder, precision, metadata)?;
        for (name, numbers) in [(MEAN, &self.files.mean), (STD, &self.files.std)] {
            npy::write(folder.join(name), numbers, &[numbers.len()])?;
        }
        if let Some(json) = &self.files.tokenizer {
            let path = folder.join(TOKENIZER);
            write_atomically(&path, |file| file.write_all(json))
                .map_err(|reason| EvaluatorNetworkError::Io { path, reason })?;
        }
        Ok(())
    }

    /// Returns the network.
    pub fn network(&self) -> &EvaluatorNetwork {
        &self.network
    }

    /// Returns the tokenizer.
    pub fn tokenizer(&self) -> &Tokenizer {
        &self.tokenizer
    }

    /// Embeds texts, in their order.
    ///
    /// # Errors
    ///
    /// If a text has no token that the network knows, or the network gives numbers that are not finite.
    pub fn texts(&self, texts: &[impl AsRef<str>]) -> Result<Embeddings, EvaluatorError> {
        let encode = |text: &_| self.tokenizer.encode(AsRef::as_ref(text));
        let tokens: Result<Vec<Tokens>, _> = texts.iter().map(encode).collect();
        let tokens = tokens?;
        let embed = |indices: &[usize]| {
            let batch: Vec<Tokens> = indices.iter().map(|&i| tokens[i].clone()).collect();
            let batch = TextBatch::tokens(&batch, &self.device);
            self.network.embed_text(&batch)
        };
        let width = self.network.config().dim_coemb_hidden;
        let length = |index: usize| tokens[index].own;
        let count = tokens.len();
        Ok(embed_in_batches(
            TEXTS_PER_BATCH,
            width,
            &length,
            count,
            embed,
        )?)
    }

    /// Embeds motions, in their order.
    ///
    /// A motion is given by its pose features, frame after frame, with foot contacts and not normalised. Up to 3 frames
    /// at its end are ignored, so that the number of frames is a multiple of 4.
    ///
    /// # Errors
    ///
    /// If a motion does not have as many frames as the network reads (4 to [`EvaluatorConfig::max_motion_length`], and
    /// up to 3 more), or the network gives numbers that are not finite.
    ///
    /// [`EvaluatorConfig::max_motion_length`]: crate::EvaluatorConfig::max_motion_length
    pub fn motions(&self, motions: &[impl AsRef<[f32]>]) -> Result<Embeddings, EvaluatorError> {
        embed_motions(&self.network, &self.normalization, motions, &self.device)
    }
}

/// Embeds motions that are given by their pose features, not normalised, in their order.
pub(crate) fn embed_motions(
    network: &EvaluatorNetwork,
    normalization: &Normalization,
    motions: &[impl AsRef<[f32]>],
    device: &Device,
) -> Result<Embeddings, EvaluatorError> {
    let config = network.config();
    let inputs = MotionInputs::new(motions, config)?;
    let embed = |indices: &[usize]| {
        let (x, lengths) = inputs.batch(indices, device);
        let x = normalization.normalize(x);
        let x = x.narrow(2, 0, config.movement_features());
        network.embed_motion(x, &lengths, None)
    };
    let width = config.dim_coemb_hidden;
    let length = |index| inputs.frames(index);
    Ok(embed_in_batches(
        MOTIONS_PER_BATCH,
        width,
        &length,
        motions.len(),
        embed,
    )?)
}
