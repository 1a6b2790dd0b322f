//! The arguments of `lamogen laban`.

use std::path::PathBuf;

use clap::Args;

use super::shared::MotionReadingArguments;

/// The arguments of `lamogen laban`.
#[derive(Args)]
pub struct LabanArguments {
    /// Motion files: .bvh, .glb, .gltf, .vrm, .vrma or .npy; - is standard input.
    #[arg(required = true)]
    pub files: Vec<PathBuf>,
    /// A motion to compare each of them with.
    #[arg(long, value_name = "OTHER")]
    pub compare: Option<PathBuf>,
    #[command(flatten)]
    pub reading: MotionReadingArguments,
}
