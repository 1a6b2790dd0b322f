//! The error type of an evaluator's training.

use lamogen_eval::EvaluatorError;

/// The error of an evaluator that cannot be trained on a data set.
#[derive(Debug, thiserror::Error)]
pub enum MatchingError {
    /// The training split has no two motions with different meanings.
    #[error(
        "expected at least 2 training motions of {shortest} to {longest} frames that mean different things (no caption in common, \
         nor content and style), found none among {motions}"
    )]
    #[allow(missing_docs)]
    NoPairs {
        motions: usize,
        shortest: usize,
        longest: usize,
    },
    /// The captions were encoded for another network.
    #[error(
        "expected captions of {expected} tokens, as the evaluator's config has them, found {found}"
    )]
    #[allow(missing_docs)]
    Context { expected: usize, found: usize },
    /// The network, the tokenizer and the statistics do not fit together.
    #[error(transparent)]
    Evaluator(#[from] EvaluatorError),
}
