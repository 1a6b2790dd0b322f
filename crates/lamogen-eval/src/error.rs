//! Errors of evaluators and their files.

use std::io;
use std::path::PathBuf;

use lamogen_model::{CheckpointError, TokenizerError};
use lamogen_motion::NormalizationError;
use lamogen_motion::npy::NpyError;

use crate::MetricError;

/// An error when an evaluator's network is loaded or saved.
#[derive(Debug, thiserror::Error)]
pub enum EvaluatorNetworkError {
    /// A file cannot be read or written.
    #[error("{path}: {reason}")]
    #[allow(missing_docs)]
    Io { path: PathBuf, reason: io::Error },
    /// A file is not an evaluator's config in JSON.
    #[error("{path}: not an evaluator's config: {reason}")]
    #[allow(missing_docs)]
    Config {
        path: PathBuf,
        reason: serde_json::Error,
    },
    /// The sizes in a config are not valid.
    #[error("{path}: {problem}")]
    #[allow(missing_docs)]
    Sizes { path: PathBuf, problem: String },
    /// The weights cannot be read or written, or are not those of such a network.
    #[error(transparent)]
    Weights(#[from] CheckpointError),
}

/// An error of an evaluator.
#[derive(Debug, thiserror::Error)]
pub enum EvaluatorError {
    /// The network cannot be loaded or saved.
    #[error(transparent)]
    EvaluatorNetwork(#[from] EvaluatorNetworkError),
    /// The tokenizer cannot be read, does not fit the network, or cannot encode a text.
    #[error(transparent)]
    Tokenizer(#[from] TokenizerError),
    /// The statistics cannot be read or are not valid.
    #[error(transparent)]
    Normalization(#[from] NormalizationError),
    /// A file of the statistics cannot be read or written.
    #[error(transparent)]
    Statistics(#[from] NpyError),
    /// The network reads words instead of tokens.
    #[error(
        "expected an evaluator that reads tokens, found one that reads words with parts of speech; it takes its texts from a Vocabulary"
    )]
    Words,
    /// There is no tokenizer, and the network's vocabulary is not CLIP's.
    #[error(
        "expected a tokenizer.json for the evaluator's vocabulary of {vocab_size} ids, found none; CLIP's own tokenizer has {clip}"
    )]
    #[allow(missing_docs)]
    NoTokenizer { vocab_size: usize, clip: usize },
    /// The statistics are of another number of features.
    #[error("expected statistics of {expected} features, as the evaluator reads, found {found}")]
    #[allow(missing_docs)]
    Features { expected: usize, found: usize },
    /// A motion has a length that the network cannot read.
    #[error(
        "motion {motion}: expected {shortest} to {longest} frames of {features} numbers, found {found} numbers"
    )]
    #[allow(missing_docs)]
    Motion {
        motion: usize,
        shortest: usize,
        longest: usize,
        features: usize,
        found: usize,
    },
    /// The network gives numbers that are not finite, or a metric cannot be computed.
    #[error(transparent)]
    Metric(#[from] MetricError),
}
