//! Metrics of text-to-motion on an evaluator's embeddings, and of control over Laban features.
//!
//! They are those of the public code of Guo et al. 2022 (`utils/metrics.py`, `final_evaluations.py`). Here sums and
//! distances are in 64 bits, and random choices depend on a seed.

mod batches;
mod control;
mod embeddings;
mod frechet;
mod matching;
mod spread;

pub use batches::RetrievalBatches;
pub use control::{ChangeMatrix, ControlRange};
pub use embeddings::Embeddings;
pub use frechet::{Gaussian, fid};
pub use matching::MatchingScore;
pub use spread::{diversity, draw_pairs, mean_distance, mean_pair_distance, multimodality};

/// An error when a metric is computed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MetricError {
    /// The numbers do not fill rows of one width.
    #[error("expected {expected} numbers for each embedding, found {found} numbers in all")]
    #[allow(missing_docs)]
    Width { expected: usize, found: usize },
    /// A number is not finite.
    #[error("embedding {row} holds numbers that are not finite")]
    #[allow(missing_docs)]
    NotFinite { row: usize },
    /// The Laban features of a motion are not finite.
    #[error("the Laban features of motion {motion} are not finite")]
    #[allow(missing_docs)]
    Features { motion: usize },
    /// Two sets of embeddings do not fit each other.
    #[error("expected {what} of {expected}, found {found}")]
    #[allow(missing_docs)]
    Mismatch {
        what: &'static str,
        expected: usize,
        found: usize,
    },
    /// There are too few embeddings.
    #[error("{metric} needs at least {needed} {what}, found {found}")]
    #[allow(missing_docs)]
    TooFew {
        metric: &'static str,
        what: &'static str,
        needed: usize,
        found: usize,
    },
}
