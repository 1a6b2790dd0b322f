//! The error type of training.

use std::path::{Path, PathBuf};

use burn::store::RecordError;
use lamogen_data::Split;
use lamogen_guide::GuideError;
use lamogen_model::CheckpointError;
use lamogen_motion::npy::NpyError;

/// An error of training.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// The split has no motion of a length that the network accepts.
    #[error(
        "the data set has no motion of {shortest} to {longest} frames in its {split} split; the network is made for these lengths"
    )]
    #[allow(missing_docs)]
    NoMotions {
        split: Split,
        shortest: usize,
        longest: usize,
    },
    /// The captions were encoded for another network.
    #[error(
        "expected captions of {expected} tokens below {vocabulary}, as the network reads them, found {found} tokens of a vocabulary of {found_vocabulary}"
    )]
    #[allow(missing_docs)]
    Captions {
        expected: usize,
        vocabulary: usize,
        found: usize,
        found_vocabulary: usize,
    },
    /// The model to begin with has other sizes than the config.
    #[error("expected a model with {expected} to begin with, as the config says, found {found}")]
    #[allow(missing_docs)]
    Sizes { expected: String, found: String },
    /// A term of the loss makes no sense on the motions of the data set.
    #[error(transparent)]
    LossTerm(#[from] GuideError),
    /// The loss on the validation split is not finite.
    #[error(
        "the loss on the validation split after step {step} is {loss}: expected a finite number"
    )]
    #[allow(missing_docs)]
    Validation { step: u64, loss: f64 },
    /// Another process trains in the folder.
    #[error("{path}: another process trains here")]
    #[allow(missing_docs)]
    Busy { path: PathBuf },
    /// The loss or the gradient of a step is not finite.
    #[error(
        "step {step}: expected finite numbers, found the loss {loss} and a gradient of length {gradient_norm}; \
         a smaller learning rate or gradient_norm may help"
    )]
    #[allow(missing_docs)]
    NotFinite {
        step: u64,
        loss: f64,
        gradient_norm: f64,
    },
    /// A file of the run cannot be read or written.
    #[error("{path}: {reason}")]
    #[allow(missing_docs)]
    Io {
        path: PathBuf,
        reason: std::io::Error,
    },
    /// A checkpoint of the run is damaged, or belongs to another network.
    #[error("{path}: not a checkpoint of this run: {problem}")]
    #[allow(missing_docs)]
    Checkpoint { path: PathBuf, problem: String },
    /// The folder holds another run.
    #[error(
        "{path}: the run in this folder has {found}, expected {expected}; choose another folder, or go on with what it was started with"
    )]
    #[allow(missing_docs)]
    OtherRun {
        path: PathBuf,
        expected: String,
        found: String,
    },
    /// The statistics cannot be written.
    #[error(transparent)]
    Npy(#[from] NpyError),
    /// The model cannot be written.
    #[error(transparent)]
    Model(#[from] CheckpointError),
}

impl TrainError {
    /// Creates the error of a file that cannot be read or written.
    pub(crate) fn io(path: &Path, reason: std::io::Error) -> Self {
        TrainError::Io {
            path: path.to_owned(),
            reason,
        }
    }

    /// Creates the error of a checkpoint's weights that burn cannot read or write.
    pub(crate) fn record(path: &Path, reason: RecordError) -> Self {
        TrainError::Checkpoint {
            path: path.to_owned(),
            problem: reason.to_string(),
        }
    }
}
