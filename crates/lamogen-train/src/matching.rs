//! Training the evaluator of motions.

mod config;
mod error;
mod example;
mod pairs;

pub use config::{EvaluatorTrainingConfig, MatchingConfig, Negatives};
pub use error::MatchingError;

use std::collections::HashMap;
use std::path::Path;

use burn::optim::GradientsParams;
use burn::tensor::Device;
use lamogen_data::{Dataset, Split};
use lamogen_eval::{
    CaptionedMotions, Dropout, Evaluator, EvaluatorConfig, EvaluatorError, EvaluatorNetwork,
    EvaluatorNetworkError, RetrievalBatches, contrastive_loss, contrastive_loss_of_all,
    random_shift,
};
use lamogen_model::Precision;
use lamogen_motion::npy::NpyError;

use crate::error::TrainError;
use crate::optimization::OptimizerConfig;
use crate::task::{StepGradients, TrainingTask};
use crate::tokens::CaptionTokens;
use example::Example;
use pairs::{Draw, Pairs, lengths};

/// The text-motion evaluator of Guo et al. 2022, learning from a data set's training split which texts and motions belong
/// together.
///
/// ```text
/// seed, step ──Pairs──▶ motions, a caption each ──Example──▶ tensors ──EvaluatorNetwork──▶ points ──contrastive loss──▶ gradients
/// ```
///
/// It differs from the public trainer in three things: pairs that mean the same do not meet in a batch, a text is held
/// against all others of its batch ([`Negatives`]), and the movement encoder learns with the rest.
pub struct MatchingTask<'a> {
    dataset: &'a Dataset,
    tokens: &'a CaptionTokens,
    config: &'a EvaluatorTrainingConfig,
    pairs: Pairs,
    /// With the network before the first step.
    evaluator: Evaluator,
    device: Device,
    metadata: HashMap<String, String>,
}

impl<'a> MatchingTask<'a> {
    /// A task on a device.
    ///
    /// # Errors
    ///
    /// If the tokenizer does not fit the network, or the training split has no two motions that the network can read and that mean
    /// different things.
    ///
    /// # Panics
    ///
    /// If the config has a [`problem`](EvaluatorTrainingConfig::problem).
    pub fn new(
        dataset: &'a Dataset,
        tokens: &'a CaptionTokens,
        config: &'a EvaluatorTrainingConfig,
        device: &Device,
    ) -> Result<Self, MatchingError> {
        if let Some(problem) = config.problem() {
            panic!("{problem}");
        }
        let seed = config.optimization.seed;
        let network = EvaluatorNetwork::initial(&config.evaluator, seed, device);
        let statistics = [dataset.mean(), dataset.std()];
        let evaluator = Evaluator::new(network, tokens.file(), statistics, device)?;
        let [expected, found] =
            [evaluator.tokenizer(), tokens.tokenizer()].map(|t| t.context_length());
        if expected != found {
            return Err(MatchingError::Context { expected, found });
        }
        let lengths = lengths(&config.evaluator);
        Ok(MatchingTask {
            pairs: Pairs::new(dataset, config).ok_or_else(|| MatchingError::NoPairs {
                motions: dataset.split(Split::Train).count(),
                shortest: *lengths.start(),
                longest: *lengths.end(),
            })?,
            device: device.clone(),
            metadata: HashMap::new(),
            dataset,
            tokens,
            config,
            evaluator,
        })
    }

    /// Sets what travels with the weights in their file, such as `license` and `attribution`.
    pub fn with_metadata(self, metadata: HashMap<String, String>) -> Self {
        MatchingTask { metadata, ..self }
    }

    /// How many motions are trained on, mirrored ones included.
    pub fn motions(&self) -> usize {
        self.pairs.motions()
    }

    /// A network with the tokenizer and the statistics of this task.
    pub fn evaluator(&self, network: &EvaluatorNetwork) -> Evaluator {
        self.evaluator.with(network.clone())
    }
}

impl TrainingTask for MatchingTask<'_> {
    type Network = EvaluatorNetwork;

    fn optimization(&self) -> &OptimizerConfig {
        &self.config.optimization
    }

    fn start(&self, device: &Device) -> EvaluatorNetwork {
        EvaluatorNetwork::initial(
            &self.config.evaluator,
            self.config.optimization.seed,
            device,
        )
    }

    fn compute_gradients(&self, network: &EvaluatorNetwork, step: u64) -> StepGradients {
        let Draw { pairs, mut stream } = self.pairs.draw(step);
        let Example {
            texts,
            features,
            lengths,
        } = Example::new(self.dataset, self.tokens, &pairs, &self.device);
        let config = &self.config.matching;
        let dropout = Dropout {
            probability: config.dropout,
            stream: &mut stream,
        };
        let motions = network.embed_motion(features, &lengths, Some(dropout));
        let texts = network.embed_text(&texts);
        let loss = match config.others {
            Negatives::All => contrastive_loss_of_all(texts, motions, config.margin),
            Negatives::One => {
                let shift = random_shift(lengths.len(), &mut stream);
                contrastive_loss(texts, motions, shift, config.margin)
            }
        };
        let gradients = GradientsParams::from_grads(loss.backward(), network);
        let loss = loss.inner();
        StepGradients {
            loss: loss.clone(),
            total_loss: loss,
            gradients,
            motions: lengths.len(),
            frames: lengths.iter().sum(),
        }
    }

    /// 1 less the R-precision (mean of top 1, 2 and 3) of the validation split, over many draws of captions and batches that are
    /// the same at every measurement. Batches hold 32 pairs, or as many as the split has of captions that differ.
    fn validate(&self, network: &EvaluatorNetwork) -> Option<f64> {
        let motions = captioned(self.dataset, Split::Validation, &self.config.evaluator);
        // A network that does not give numbers finds nothing.
        match CaptionedMotions::embed(&self.evaluator(network), motions) {
            Ok(motions) => Some(1.0 - precision(&motions)?),
            Err(EvaluatorError::Metric(_)) => Some(1.0),
            Err(error) => unreachable!("captions and lengths were checked before: {error}"),
        }
    }

    fn save(&self, network: &EvaluatorNetwork, folder: &Path) -> Result<(), TrainError> {
        let evaluator = self.evaluator(network);
        let saved = evaluator.save(folder, Precision::F32, self.metadata.clone());
        saved.map_err(|error| match error {
            EvaluatorError::EvaluatorNetwork(EvaluatorNetworkError::Io { path, reason })
            | EvaluatorError::Statistics(NpyError::Io { path, reason }) => {
                TrainError::Io { path, reason }
            }
            EvaluatorError::EvaluatorNetwork(EvaluatorNetworkError::Weights(error)) => error.into(),
            error => TrainError::io(folder, std::io::Error::other(error)),
        })
    }
}

/// R-precision over draws that depend on nothing but the captions: the mean of top 1, 2 and 3. `None` if there are no two
/// captions that differ.
fn precision(motions: &CaptionedMotions) -> Option<f64> {
    const DRAWS: u64 = 100;
    let of = |size: usize| {
        let precisions = (0..DRAWS).map(|seed| {
            let found = motions.matching(size, seed)?.r_precision;
            Ok(found.iter().sum::<f64>() / 3.0)
        });
        let sum: Result<f64, lamogen_eval::MetricError> = precisions.sum();
        Some(sum.ok()? / DRAWS as f64)
    };
    (2..=RetrievalBatches::SIZE.min(motions.len()))
        .rev()
        .find_map(of)
}

/// The motions of a split that an evaluator can read, with their captions, for [`CaptionedMotions::embed`]. Mirrored ones are
/// left out.
pub fn captioned<'a>(
    dataset: &'a Dataset,
    split: Split,
    config: &EvaluatorConfig,
) -> impl Iterator<Item = (Vec<String>, Vec<f32>)> + 'a {
    let lengths = lengths(config);
    let motions = dataset.split(split).filter(move |entry| !entry.mirror);
    motions
        .filter(move |entry| lengths.contains(&entry.frames))
        .map(|entry| {
            let captions = entry.captions.iter();
            let mut features = Vec::new();
            dataset.features(entry, 0..entry.frames, &mut features);
            (
                captions.map(|caption| caption.text.clone()).collect(),
                features,
            )
        })
}
