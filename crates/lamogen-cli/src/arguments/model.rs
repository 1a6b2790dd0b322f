//! The arguments of `lamogen model` and its subcommands.

use std::path::PathBuf;

use clap::Subcommand;
use lamogen::model::Precision;

/// The subcommands of `lamogen model`.
#[derive(Subcommand)]
pub enum ModelCommand {
    /// Say what a model is: sizes, licence, lengths, defaults.
    Info {
        /// Folder of the model; the embedded one without.
        folder: Option<PathBuf>,
    },
    /// Convert a checkpoint to safetensors: half the size in 16 bits, a quarter in 8, and no pickle.
    Convert {
        /// A latest.tar of MotionDiffuse, or a file in safetensors.
        from: PathBuf,
        /// The file to write, ending in .safetensors.
        to: PathBuf,
        /// Bits a stored number: 32, 16, or 8 with a scale for each row of a matrix, off by at most a 254th of the largest of the row.
        #[arg(long, default_value = "32")]
        bits: Precision,
        /// The same as --bits 16.
        #[arg(long, conflicts_with = "bits")]
        half: bool,
        /// Licence of the weights, as an SPDX identifier; it travels in the file.
        #[arg(long)]
        license: Option<String>,
        /// Whom to name when the weights or what they make is passed on.
        #[arg(long)]
        attribution: Option<String>,
        /// Let --license and --attribution replace others that the file states: for whoever owns the weights.
        #[arg(long)]
        force: bool,
    },
}
