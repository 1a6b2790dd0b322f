//! Errors of evaluators and their files.

use std::io;
use std::path::PathBuf;

use lamogen_model::{CheckpointError, TokenizerError};
use lamogen_motion::NormalizationError;
use lamogen_motion::npy::NpyError;

use crate::protocol::{PublicFile, StatisticsProblem};
use crate::{MetricError, VocabularyError};

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
    /// Files of the public evaluator are missing.
    #[error("{folder}: expected the public evaluator, found no {}", list_missing(.files))]
    #[allow(missing_docs)]
    Missing {
        folder: PathBuf,
        files: Vec<PublicFile>,
    },
    /// The words of the public evaluator, or the tokens of a caption, cannot be read.
    #[error(transparent)]
    Vocabulary(#[from] VocabularyError),
    /// The vectors of the words have another width than the network reads.
    #[error(
        "{path}: expected vectors of {expected} numbers, as the evaluator reads, found {found}"
    )]
    #[allow(missing_docs)]
    WordWidth {
        path: PathBuf,
        expected: usize,
        found: usize,
    },
    /// The public evaluator embeds no texts without its words.
    #[error("expected the words of the public evaluator (glove/our_vab_*), found none")]
    NoWords,
    /// A caption has no tokens.
    #[error(
        "expected tokens with parts of speech after the caption {caption:?}, such as `a/DET man/NOUN walk/VERB`, found none; HumanML3D's texts have them between the first and the second #"
    )]
    #[allow(missing_docs)]
    NoTokens { caption: String },
    /// A real motion cannot be brought into the form that is measured.
    #[error("{name}: {problem}")]
    #[allow(missing_docs)]
    Real { name: String, problem: String },
    /// The statistics are not those of the public evaluator.
    #[error(transparent)]
    OtherStatistics(#[from] StatisticsProblem),
    /// The network gives numbers that are not finite, or a metric cannot be computed.
    #[error(transparent)]
    Metric(#[from] MetricError),
}

/// Lists missing files with their places and sources.
fn list_missing(files: &[PublicFile]) -> String {
    let names: Vec<&str> = files.iter().map(|file| file.place()).collect();
    let mut sources: Vec<&str> = files.iter().map(|file| file.source()).collect();
    sources.dedup();
    format!("{} (of {})", names.join(", "), sources.join(", and "))
}
