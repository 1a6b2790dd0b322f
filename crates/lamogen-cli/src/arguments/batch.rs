//! The arguments of `lamogen batch`.

use std::path::PathBuf;

use clap::Args;

use super::shared::{ModelArguments, PassArguments, WritingArguments, parse_shard};
use crate::output::OutputFormat;

/// The text below the options in the help.
pub const AFTER_HELP: &str = "\
Every line of the file is a request as JSON, with fields that mean what they mean to lamogen generate:
  {\"prompt\": \"a person jumps\", \"weight\": \"strong\", \"time\": 1.2, \"seconds\": 4, \"seed\": 7, \"id\": \"jump\"}
  {\"prompt\": \"a person walks\", \"then\": [{\"prompt\": \"a person jumps\", \"seconds\": 2, \"weight\": \"strong\"}], \"after\": \"walk.bvh\"}
Only the prompt must be there. A motion's files are named by its id (letters A to Z and a to z, digits, - _ and .), or by its \
line's number.

A motion counts as finished once its .json is there and says the same request, options and files; it is not made \
again. Parts of the work go to several machines or jobs by --shard: 1/4, 2/4, 3/4, 4/4; --merge then says whether all is there.";

/// The arguments of `lamogen batch`.
#[derive(Args)]
#[command(allow_negative_numbers = true)]
pub struct BatchArguments {
    /// The requests, one JSON object a line; - is standard input.
    pub requests: PathBuf,
    /// Folder for the files.
    #[arg(long, short, value_name = "FOLDER")]
    pub out: PathBuf,
    /// Formats to write beside each motion's .json.
    #[arg(long, value_enum, value_delimiter = ',', default_value = "glb")]
    pub format: Vec<OutputFormat>,
    /// Which part of the lines to work on: 2/8 is the second of eight.
    #[arg(long, value_name = "I/N", value_parser = parse_shard)]
    pub shard: Option<(usize, usize)>,
    /// Generate nothing: check that every line's files are there and finished, with the same options, and name those that are not.
    #[arg(long, conflicts_with_all = ["shard", "batch_size"])]
    pub merge: bool,
    /// How many motions run together: usually 1 on a CPU, where each is then exactly the motion that generate gives, and 8 on a GPU. On a CPU 8 are about 1.3 times as fast.
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub batch_size: Option<u32>,
    #[command(flatten)]
    pub pass: PassArguments,
    #[command(flatten)]
    pub source: ModelArguments,
    #[command(flatten)]
    pub writing: WritingArguments,
}
