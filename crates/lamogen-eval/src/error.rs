//! What can go wrong with an evaluator's files.

use std::io;
use std::path::PathBuf;

use lamogen_model::CheckpointError;

/// What can go wrong when an evaluator is loaded or saved.
#[derive(Debug, thiserror::Error)]
pub enum EvaluatorError {
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
    /// Sizes that make no network.
    #[error("{path}: {problem}")]
    #[allow(missing_docs)]
    Sizes { path: PathBuf, problem: String },
    /// The weights cannot be read or written, or are not such a network's.
    #[error(transparent)]
    Weights(#[from] CheckpointError),
}
