//! The arguments of `lamogen play`.

use std::path::PathBuf;

use clap::Args;

use super::shared::MotionReadingArguments;

/// The arguments of `lamogen play`.
#[derive(Args)]
pub struct PlayArguments {
    /// Motion files, up to four: .bvh, .glb, .gltf, .vrm, .vrma or .npy.
    #[arg(required = true, num_args = 1..=4)]
    pub files: Vec<PathBuf>,
    /// Where to write the page; usually among the temporary files.
    #[arg(long, short, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Write the page, but do not open it.
    #[arg(long)]
    pub no_open: bool,
    #[command(flatten)]
    pub reading: MotionReadingArguments,
}
