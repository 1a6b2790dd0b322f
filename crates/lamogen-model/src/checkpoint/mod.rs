//! Weights in files: PyTorch checkpoints and safetensors.

mod convert;
mod keys;
mod precision;
mod read;
mod sizes;
mod torchscript;
mod write;

pub use convert::ConversionProgress;
pub use keys::{NamedParameters, ParameterList};
pub use precision::Precision;
pub use read::Checkpoint;

use std::io;
use std::path::PathBuf;

/// An error in reading or writing the weights of a network.
#[derive(Debug, thiserror::Error)]
pub enum CheckpointError {
    /// The file cannot be opened, read or written.
    #[error("{path}: {reason}")]
    #[allow(missing_docs)]
    Io { path: PathBuf, reason: io::Error },
    /// The file is not a checkpoint, or is truncated.
    #[error("{path}: not a readable checkpoint: {problem}")]
    #[allow(missing_docs)]
    Format { path: PathBuf, problem: String },
    /// A tensor that the network needs is missing.
    #[error("{path}: tensor `{key}` is missing; expected shape {expected:?}{others}", others = format_others(*.others))]
    #[allow(missing_docs)]
    Missing {
        path: PathBuf,
        key: String,
        expected: Vec<usize>,
        /// The number of other tensors that are missing or have a wrong shape.
        others: usize,
    },
    /// The shape of a tensor does not match the sizes of the network.
    #[error("{path}: tensor `{key}` has shape {found:?}; the model config asks for {expected:?}{others}", others = format_others(*.others))]
    #[allow(missing_docs)]
    Shape {
        path: PathBuf,
        key: String,
        expected: Vec<usize>,
        found: Vec<usize>,
        /// The number of other tensors that are missing or have a wrong shape.
        others: usize,
    },
    /// The checkpoint has a tensor that a network of these sizes does not have.
    #[error("{path}: tensor `{key}` is not part of a network of the config's sizes{others}; do config and weights belong together?", others = format_others(*.others))]
    #[allow(missing_docs)]
    Unknown {
        path: PathBuf,
        key: String,
        /// The number of other unknown tensors.
        others: usize,
    },
    /// A tensor contains infinities or NaN.
    #[error("{path}: tensor `{key}` holds numbers that are not finite")]
    #[allow(missing_docs)]
    NotFinite { path: PathBuf, key: String },
    /// A number is too large for 16 bits.
    #[error(
        "{path}: tensor `{key}` holds numbers beyond ±65504, which 16 bits cannot hold; convert to 32 bits"
    )]
    #[allow(missing_docs)]
    Range { path: PathBuf, key: String },
    /// The sizes of the network cannot be determined from the tensors.
    #[error(
        "{path}: the sizes of the network cannot be read off its tensors: {problem}; a config.json beside it would tell them"
    )]
    #[allow(missing_docs)]
    Sizes { path: PathBuf, problem: String },
    /// A tensor does not contain floats.
    #[error(
        "{path}: tensor `{key}` holds {found}; expected floats of 16, 32 or 64 bits, or whole numbers of 8 bits with a tensor `{key}.scale` of one float a row"
    )]
    #[allow(missing_docs)]
    Type {
        path: PathBuf,
        key: String,
        found: String,
    },
}

/// Formats the number of other tensors for an error message.
fn format_others(count: usize) -> String {
    match count {
        0 => String::new(),
        count => format!(" (and {count} more do not fit)"),
    }
}
