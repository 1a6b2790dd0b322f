//! Metrics of text-to-motion over points of the evaluator's space, and of control over Laban features.
//!
//! As the public code of Guo et al. 2022 defines them (`utils/metrics.py`, `final_evaluations.py`), with sums and
//! distances in 64 bits and draws from seeds.

mod batches;
mod control;
mod embeddings;
mod frechet;
mod matching;
mod spread;

pub use batches::RetrievalBatches;
pub use control::{ChangeMatrix, ControlExtremes};
pub use embeddings::Embeddings;
pub use frechet::{Gaussian, fid};
pub use matching::MatchingScore;
pub use spread::{diversity, mean_distance, multimodality};

/// What keeps a metric from being computed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MetricError {
    /// Numbers that are no rows of one width.
    #[error("expected {expected} numbers for each embedding, found {found} numbers in all")]
    #[allow(missing_docs)]
    Width { expected: usize, found: usize },
    /// A number that is not finite.
    #[error("embedding {row} holds numbers that are not finite")]
    #[allow(missing_docs)]
    NotFinite { row: usize },
    /// Laban features that are not finite.
    #[error("the Laban features of motion {motion} are not finite")]
    #[allow(missing_docs)]
    Features { motion: usize },
    /// Sets that do not belong together.
    #[error("expected {what} of {expected}, found {found}")]
    #[allow(missing_docs)]
    Mismatch {
        what: &'static str,
        expected: usize,
        found: usize,
    },
    /// Too few embeddings.
    #[error("{metric} needs at least {needed} {what}, found {found}")]
    #[allow(missing_docs)]
    TooFew {
        metric: &'static str,
        what: &'static str,
        needed: usize,
        found: usize,
    },
}
