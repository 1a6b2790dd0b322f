//! The arguments of `lamogen vary`.

use std::path::PathBuf;

use clap::Args;
use lamogen::DeviceName;

/// The arguments of `lamogen vary`.
#[derive(Args)]
pub struct VaryArguments {
    /// The data set.
    pub data: PathBuf,
    /// Folder to write: the data set with its variations. Until all are made, they are kept beside it in a folder with .work behind its name,
    /// and the same command goes on after a stop.
    #[arg(long, short, value_name = "FOLDER")]
    pub out: PathBuf,
    /// Variations of every motion for training.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u16).range(1..=100))]
    pub count: u16,
    /// The smallest and the largest factor on a component.
    #[arg(long, default_value = "0.35,2.2", value_name = "LEAST,MOST", value_parser = parse_factor_range)]
    pub factors: [f32; 2],
    /// By what factors are drawn.
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// Where to compute; lamogen devices lists them.
    #[arg(long)]
    pub device: Option<DeviceName>,
    /// Replace a packed folder that is already there.
    #[arg(long)]
    pub force: bool,
}

/// Parses two factors with a comma.
fn parse_factor_range(text: &str) -> Result<[f32; 2], String> {
    let numbers: Result<Vec<f32>, _> = text.split(',').map(|part| part.trim().parse()).collect();
    let factors = numbers.ok().and_then(|numbers| numbers.try_into().ok());
    factors.ok_or_else(|| "expected two factors with a comma, such as 0.35,2.2".into())
}
