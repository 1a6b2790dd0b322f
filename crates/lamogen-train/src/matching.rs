//! Training of the evaluator of motions.

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
    EvaluatorNetworkError, RetrievalBatches, contrastive_loss, contrastive_loss_all_shifts,
    random_shift,
};
use lamogen_model::Precision;
use lamogen_motion::npy::NpyError;

use crate::error::TrainError;
use crate::optimization::OptimizerConfig;
use crate::task::{StepGradients, TrainingTask};
use crate::tokens::CaptionTokens;
use example::MatchingExamples;
use pairs::{PairBatch, PairSampler, readable_lengths};

/// The training of the text-motion evaluator of Guo et al. 2022, which learns from the training split of a data set which texts and
/// motions belong together.
///
/// ```text
/// seed, step ──PairSampler──▶ motions, a caption each ──MatchingExamples──▶ tensors ──EvaluatorNetwork──▶ embeddings
/// embeddings ──contrastive loss──▶ gradients
/// ```
///
/// It differs from the public trainer in three ways: a batch has no two pairs with the same meaning, a text is contrasted with all
/// other motions of its batch ([`Negatives`]), and the movement encoder is trained together with the other parts.
pub struct MatchingTask<'a> {
    dataset: &'a Dataset,
    tokens: &'a CaptionTokens,
    config: &'a EvaluatorTrainingConfig,
    pairs: PairSampler,
    /// The evaluator with the network before the first step.
    evaluator: Evaluator,
    device: Device,
    metadata: HashMap<String, String>,
}

impl<'a> MatchingTask<'a> {
    /// Creates a task that computes on a device.
    ///
    /// # Errors
    ///
    /// If the tokenizer does not fit the network, or the training split has no two motions with different meanings that the network
    /// can read.
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
        let lengths = readable_lengths(&config.evaluator);
        Ok(MatchingTask {
            pairs: PairSampler::new(dataset, config).ok_or_else(|| MatchingError::NoPairs {
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

    /// Sets the metadata in the file of the weights, such as `license` and `attribution`.
    pub fn with_metadata(self, metadata: HashMap<String, String>) -> Self {
        MatchingTask { metadata, ..self }
    }

    /// Returns the number of training motions, mirrored ones included.
    pub fn motions(&self) -> usize {
        self.pairs.motions()
    }

    /// Returns an evaluator of a network, with the tokenizer and the statistics of this task.
    pub fn evaluator(&self, network: &EvaluatorNetwork) -> Evaluator {
        self.evaluator.with(network.clone())
    }
}

impl TrainingTask for MatchingTask<'_> {
    type Network = EvaluatorNetwork;

    fn optimization(&self) -> &OptimizerConfig {
        &self.config.optimization
    }

    fn initial_network(&self, device: &Device) -> EvaluatorNetwork {
        EvaluatorNetwork::initial(
            &self.config.evaluator,
            self.config.optimization.seed,
            device,
        )
    }

    fn compute_gradients(&self, network: &EvaluatorNetwork, step: u64) -> StepGradients {
        let PairBatch {
            pairs,
            mut generator,
        } = self.pairs.draw(step);
        let MatchingExamples {
            texts,
            features,
            lengths,
        } = MatchingExamples::new(self.dataset, self.tokens, &pairs, &self.device);
        let config = &self.config.matching;
        let dropout = Dropout {
            probability: config.dropout,
            stream: &mut generator,
        };
        let motions = network.embed_motion(features, &lengths, Some(dropout));
        let texts = network.embed_text(&texts);
        let loss = match config.others {
            Negatives::All => contrastive_loss_all_shifts(texts, motions, config.margin),
            Negatives::One => {
                let shift = random_shift(lengths.len(), &mut generator);
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

    /// Computes 1 minus the R-precision (mean of top 1, 2 and 3) of the validation split, over many draws of captions and batches,
    /// which are the same at every validation. Batches have 32 pairs, or fewer if the split has not as many different captions.
    fn validate(&self, network: &EvaluatorNetwork) -> Option<f64> {
        let motions = captioned(self.dataset, Split::Validation, &self.config.evaluator);
        // A network whose outputs are not finite has the R-precision 0.
        match CaptionedMotions::embed(&self.evaluator(network), motions) {
            Ok(motions) => Some(1.0 - mean_r_precision(&motions)?),
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

/// Computes the R-precision as the mean of top 1, 2 and 3, over draws that depend on the captions alone. Returns `None` if no two
/// captions differ.
fn mean_r_precision(motions: &CaptionedMotions) -> Option<f64> {
    const DRAWS: u64 = 100;
    let precision_of_size = |size: usize| {
        let precisions = (0..DRAWS).map(|seed| {
            let precision = motions.matching(size, seed)?.r_precision;
            Ok(precision.iter().sum::<f64>() / 3.0)
        });
        let sum: Result<f64, lamogen_eval::MetricError> = precisions.sum();
        Some(sum.ok()? / DRAWS as f64)
    };
    (2..=RetrievalBatches::SIZE.min(motions.len()))
        .rev()
        .find_map(precision_of_size)
}

/// Returns the motions of a split that an evaluator can read, with their captions, for [`CaptionedMotions::embed`].
///
/// Mirrored motions are left out.
pub fn captioned<'a>(
    dataset: &'a Dataset,
    split: Split,
    config: &EvaluatorConfig,
) -> impl Iterator<Item = (Vec<String>, Vec<f32>)> + 'a {
    let lengths = readable_lengths(config);
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
