//! The arguments of `lamogen train`.

use std::path::PathBuf;

use clap::Args;
use lamogen::DeviceName;

/// The text below the options in the help.
pub const AFTER_HELP: &str = "\
The folder of the run gets losses.jsonl and losses.svg, sample strips, checkpoints, model/ (the last measured weights) and best/ \
(those with the lowest validation loss); both are folders for --model. Ctrl-C stops with a checkpoint.

Example:
  lamogen pack HumanML3D --out data
  lamogen train --data data --config compact --out run --minutes 60
  lamogen generate \"a person jumps\" --model run/model --out jump.html";

/// The arguments of `lamogen train`.
#[derive(Args)]
pub struct TrainArguments {
    /// Folder of the data: packed by lamogen pack, or HumanML3D's.
    #[arg(long, value_name = "FOLDER")]
    pub data: PathBuf,
    /// What to train, and how: compact, a recipe for a network as large as the embedded one, or a JSON file.
    #[arg(long, default_value = "compact", value_name = "FILE")]
    pub config: PathBuf,
    /// Folder of the run. If a run was stopped there, the same command goes on with it.
    #[arg(long, short, value_name = "RUN")]
    pub out: PathBuf,
    /// Train the network that judges how well motions match texts, instead of one that generates; compact is then its recipe.
    #[arg(long)]
    pub evaluator: bool,
    /// How many steps.
    #[arg(long, conflicts_with = "minutes", required_unless_present = "minutes", value_parser = clap::value_parser!(u64).range(1..))]
    pub steps: Option<u64>,
    /// As many steps as fit into this time, going by the first ones.
    #[arg(long, value_parser = parse_minutes)]
    pub minutes: Option<f64>,
    /// Stop after so many minutes, with a checkpoint; the same command goes on later.
    #[arg(long, alias = "sitting", value_name = "MINUTES", value_parser = parse_minutes)]
    pub time_limit: Option<f64>,
    /// Begin with the weights of a model, a folder or embedded, instead of fresh ones; its sizes, tokenizer and statistics are kept,
    /// and its licence where none is given.
    #[arg(long, value_name = "MODEL", conflicts_with_all = ["evaluator", "tokenizer"])]
    pub from: Option<PathBuf>,
    /// A tokenizer.json; without one it is CLIP's for a network with CLIP's vocabulary, else learned from the captions.
    #[arg(long, value_name = "FILE")]
    pub tokenizer: Option<PathBuf>,
    /// Embeddings of sentences by a sentence encoder, one a row, with the sentences in the .txt beside it: what a recipe with sentences_per_batch
    /// teaches the text encoder.
    #[arg(long, value_name = "FILE.npy", conflicts_with = "evaluator")]
    pub sentences: Option<PathBuf>,
    /// Steps between two measurements on the validation split, with pictures.
    #[arg(long, default_value_t = 500, value_name = "STEPS", value_parser = clap::value_parser!(u64).range(1..))]
    pub validate_every: u64,
    /// Minutes between two checkpoints.
    #[arg(long, default_value_t = 5.0, value_name = "MINUTES", value_parser = parse_minutes)]
    pub checkpoint_minutes: f64,
    /// Sentence for the sample pictures, several times for several; usually captions of the data.
    #[arg(long, value_name = "SENTENCE", conflicts_with = "evaluator")]
    pub sample: Vec<String>,
    /// Licence of the weights, as an SPDX identifier; it travels in the file.
    #[arg(long)]
    pub license: Option<String>,
    /// Whom to name when the weights or what they make is passed on.
    #[arg(long)]
    pub attribution: Option<String>,
    /// Where to compute; lamogen devices lists them.
    #[arg(long)]
    pub device: Option<DeviceName>,
}

/// Parses a time in minutes.
fn parse_minutes(text: &str) -> Result<f64, String> {
    let minutes = text.parse().ok();
    let minutes = minutes.filter(|minutes| (0.0..=1e6).contains(minutes));
    minutes.ok_or_else(|| "expected 0 to 1000000 minutes".into())
}
