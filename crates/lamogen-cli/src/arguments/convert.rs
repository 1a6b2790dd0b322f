//! The arguments of `lamogen convert`.

use std::path::PathBuf;

use clap::Args;

use super::shared::{MotionReadingArguments, WritingArguments};
use crate::output::OutputFile;

/// The arguments of `lamogen convert`.
#[derive(Args)]
pub struct ConvertArguments {
    /// The file to read: .bvh, .glb, .gltf, .vrm, .vrma or .npy; - is standard input.
    #[arg(value_name = "FROM")]
    pub source: PathBuf,
    /// The file to write: .bvh, .glb (.gltf and .vrm with --onto), .vrma, .npy, .features.npy, .csv (Laban series), .svg, .png, .gif, .html or .json.
    pub to: OutputFile,
    /// Give the motion rigid bones and feet that stand where they stand: they neither slide nor sink into the ground, which is taken to be as
    /// low as the feet come.
    #[arg(long)]
    pub clean_feet: bool,
    #[command(flatten)]
    pub reading: MotionReadingArguments,
    #[command(flatten)]
    pub writing: WritingArguments,
}
