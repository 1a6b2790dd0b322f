//! What keeps an evaluator from being trained.

use lamogen_eval::EvaluatorError;

/// What keeps an evaluator from being trained on a data set.
#[derive(Debug, thiserror::Error)]
pub enum MatchingError {
    /// Nothing to tell apart.
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
    /// Captions were made for another network.
    #[error(
        "expected captions of {expected} tokens, as the evaluator's config has them, found {found}"
    )]
    #[allow(missing_docs)]
    Context { expected: usize, found: usize },
    /// Network, tokenizer and statistics do not belong together.
    #[error(transparent)]
    Evaluator(#[from] EvaluatorError),
}
