//! An evaluator with all that its inputs need.

use std::collections::HashMap;
use std::io::{ErrorKind, Write};
use std::path::Path;
use std::sync::Arc;

use burn::tensor::{Device, Tensor, TensorData};
use lamogen_model::{Precision, Tokenizer, TokenizerError, Tokens};
use lamogen_motion::{Normalization, npy, write_atomically};

use crate::{
    Embeddings, EvaluatorConfig, EvaluatorError, EvaluatorNetwork, EvaluatorNetworkError,
    TextBatch, TextForm,
};

/// An [`EvaluatorNetwork`] that reads tokens, its tokenizer, and the mean and standard deviation of the motions that it was
/// trained on: texts and motions as they are become [`Embeddings`].
///
/// ```text
/// FOLDER/model.safetensors   the weights
///        config.json         the sizes
///        tokenizer.json      how texts are read; without it as by CLIP's tokenizer
///        mean.npy, std.npy   how features are normalised
/// ```
///
/// Cloning is cheap.
#[derive(Clone, Debug)]
pub struct Evaluator {
    network: EvaluatorNetwork,
    device: Device,
    tokenizer: Tokenizer,
    normalization: Normalization,
    files: Arc<Files>,
}

/// What the folder holds beside the network.
#[derive(Debug)]
struct Files {
    tokenizer: Option<Vec<u8>>,
    mean: Vec<f32>,
    std: Vec<f32>,
}

const TOKENIZER: &str = "tokenizer.json";
const MEAN: &str = "mean.npy";
const STD: &str = "std.npy";

/// Texts, and motions, that go through the network together.
const TEXTS: usize = 128;
const MOTIONS: usize = 32;

impl Evaluator {
    /// An evaluator from its parts: a network on `device`, the content of a `tokenizer.json` (without one CLIP's tokenizer), and one
    /// mean and one standard deviation a feature.
    ///
    /// # Errors
    ///
    /// If the network reads no tokens, the tokenizer is not made for its vocabulary, or the statistics are not of as many
    /// features as it reads or make no sense.
    pub fn new(
        network: EvaluatorNetwork,
        tokenizer_json: Option<&[u8]>,
        [mean, std]: [&[f32]; 2],
        device: &Device,
    ) -> Result<Evaluator, EvaluatorError> {
        let files = Files {
            tokenizer: tokenizer_json.map(<[u8]>::to_vec),
            mean: mean.to_vec(),
            std: std.to_vec(),
        };
        Self::of(network, files, Path::new(TOKENIZER), device)
    }

    /// Reads a folder as [`save`](Self::save) writes it.
    ///
    /// # Errors
    ///
    /// If a file cannot be read, or they do not belong together.
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
        // Checked here, where an error can name the file.
        Normalization::from_files(&mean, &std, network.config().dim_pose, device)?;
        let files = Files {
            tokenizer,
            mean: npy::read(mean)?.values,
            std: npy::read(std)?.values,
        };
        Self::of(network, files, &path, device)
    }

    fn of(
        network: EvaluatorNetwork,
        files: Files,
        tokenizer: &Path,
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
            Some(json) => Tokenizer::from_json(json, tokenizer, vocab_size, context_length)?,
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

    /// The same with another network of the same sizes on the same device, such as one that has learned more.
    pub fn with(&self, network: EvaluatorNetwork) -> Evaluator {
        Evaluator {
            network,
            ..self.clone()
        }
    }

    /// Writes the files that [`load`](Self::load) reads into a folder that is there. `metadata` travels with the
    /// weights. Each file appears whole or not at all.
    ///
    /// # Errors
    ///
    /// If a file cannot be written, or a weight is beyond the range of 16 bits where these are asked for.
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

    /// The network.
    pub fn network(&self) -> &EvaluatorNetwork {
        &self.network
    }

    /// Its tokenizer.
    pub fn tokenizer(&self) -> &Tokenizer {
        &self.tokenizer
    }

    /// Texts as points, one each in their order.
    ///
    /// # Errors
    ///
    /// If a text has no token that the network knows, or the network gives numbers that are not finite.
    pub fn texts(&self, texts: &[impl AsRef<str>]) -> Result<Embeddings, EvaluatorError> {
        let encode = |text: &_| self.tokenizer.encode(AsRef::as_ref(text));
        let tokens: Result<Vec<Tokens>, _> = texts.iter().map(encode).collect();
        let tokens = tokens?;
        self.in_batches(
            TEXTS,
            &mut |place| tokens[place].own,
            tokens.len(),
            |places| {
                let batch: Vec<Tokens> = places.iter().map(|&i| tokens[i].clone()).collect();
                let batch = TextBatch::tokens(&batch, &self.device);
                self.network.embed_text(&batch)
            },
        )
    }

    /// Motions as points, one each in their order.
    ///
    /// A motion is its pose features frame by frame, foot contacts included, as they are: not normalised. Frames after its
    /// last whole four play no part.
    ///
    /// # Errors
    ///
    /// If a motion has not as many frames as the network reads (4 to [`EvaluatorConfig::max_motion_length`], and up to 3
    /// more), or the network gives numbers that are not finite.
    pub fn motions(&self, motions: &[impl AsRef<[f32]>]) -> Result<Embeddings, EvaluatorError> {
        let config = self.network.config();
        let unit = EvaluatorConfig::FRAMES_PER_MOVEMENT;
        let features = config.dim_pose;
        let frames = |motion: &[f32]| motion.len() / features / unit * unit;
        for (place, motion) in motions.iter().enumerate() {
            let motion = motion.as_ref();
            let known = (unit..=config.max_motion_length).contains(&frames(motion));
            if !known || !motion.len().is_multiple_of(features) {
                return Err(EvaluatorError::Motion {
                    motion: place,
                    shortest: unit,
                    longest: config.max_motion_length,
                    features,
                    found: motion.len(),
                });
            }
        }
        let frames = |place: usize| frames(motions[place].as_ref());
        self.in_batches(MOTIONS, &mut { frames }, motions.len(), |places| {
            let lengths: Vec<usize> = places.iter().map(|&place| frames(place)).collect();
            let longest = *lengths.iter().max().expect("a batch has members");
            let mut numbers = vec![0.0; places.len() * longest * features];
            let rows = numbers.chunks_exact_mut(longest * features);
            for ((row, &place), length) in rows.zip(places).zip(&lengths) {
                let whole = length * features;
                row[..whole].copy_from_slice(&motions[place].as_ref()[..whole]);
            }
            let shape = [places.len(), longest, features];
            let x = Tensor::<3>::from_data(TensorData::new(numbers, shape), &self.device);
            let x = self.normalization.normalize(x);
            let x = x.narrow(2, 0, config.movement_features());
            self.network.embed_motion(x, &lengths, None)
        })
    }

    /// Embeds batches of things of about the same length, and puts the points into the order of the things.
    fn in_batches(
        &self,
        size: usize,
        length: &mut dyn FnMut(usize) -> usize,
        count: usize,
        embed: impl Fn(&[usize]) -> Tensor<2>,
    ) -> Result<Embeddings, EvaluatorError> {
        let width = self.network.config().dim_coemb_hidden;
        let mut order: Vec<usize> = (0..count).collect();
        order.sort_by_key(|&place| length(place));
        let mut found = Embeddings::new(Vec::new(), width)?;
        for places in order.chunks(size) {
            found.extend(&Embeddings::from_tensor(embed(places))?)?;
        }
        let mut rows = vec![0; count];
        for (row, place) in order.into_iter().enumerate() {
            rows[place] = row;
        }
        Ok(found.select(rows))
    }
}
