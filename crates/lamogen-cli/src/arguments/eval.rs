//! The arguments of `lamogen eval`.

use std::path::PathBuf;

use clap::Args;
use lamogen_data::Split;

use super::shared::{ModelArguments, PresetName, parse_shard};
use crate::eval::{MeasurementTarget, Method, Study};

/// The text below the options in the help.
pub const AFTER_HELP: &str = "\
The folder gets records.jsonl (a line a motion), eval.json (of what), report.html, report.md with its pictures, and figures.json. Stop it \
whenever you like: the same command goes on. Parts of the work go to several machines or jobs by --shard: 1/4, 2/4, 3/4, 4/4; with all \
their records and one eval.json in one folder, --merge writes the report.

Example:
  lamogen train --evaluator --data data --out judge --steps 1000
  lamogen eval --data data --evaluator judge/best --out evidence --dry-run
  lamogen eval --data data --evaluator judge/best --out evidence

With the public evaluator in the folder t2m, the data of HumanML3D, and a network that was trained on it:
  lamogen eval --model t2m_motiondiffuse --data HumanML3D --evaluator t2m --out table2 --studies --dry-run";

/// The arguments of `lamogen eval`.
#[derive(Args)]
pub struct EvalArguments {
    #[command(flatten)]
    pub source: ModelArguments,
    /// Folder of the data: packed by lamogen pack, or HumanML3D's.
    #[arg(long, value_name = "FOLDER")]
    pub data: PathBuf,
    /// Folder of the evaluator: as lamogen train --evaluator leaves it in best, or the public one of HumanML3D (text_mot_match, Comp_v6_KLD01
    /// and glove), with which the evaluation is the one that papers report.
    #[arg(long, value_name = "FOLDER")]
    pub evaluator: PathBuf,
    /// Folder for the records and the report.
    #[arg(long, short, value_name = "FOLDER")]
    pub out: PathBuf,
    /// Which motions' sentences: train, val or test.
    #[arg(long, default_value = "test")]
    pub split: Split,
    /// How many sentences, at least 2; usually all. R-precision needs 32.
    #[arg(long, value_name = "N", value_parser = parse_sentence_count)]
    pub prompts: Option<u64>,
    /// Motions of each sentence, from as many seeds; intervals are over these. Usually 1; with the public evaluator 20.
    #[arg(long, value_name = "R", value_parser = clap::value_parser!(u64).range(1..=1000))]
    pub repeats: Option<u64>,
    /// Steps and guidance together; usually the model's own.
    #[arg(long, value_enum)]
    pub preset: Option<PresetName>,
    /// DDIM steps of each pass; usually the preset's.
    #[arg(long, value_parser = parse_steps)]
    pub steps: Option<usize>,
    /// DDIM steps where the start noise is moved: each of its updates is a pass.
    #[arg(long, default_value_t = 10, value_parser = parse_steps)]
    pub noise_steps: usize,
    /// What is compared with the text alone.
    #[arg(long, value_enum, value_delimiter = ',', num_args = 0.., default_values = ["laban", "embedding", "prompt", "raw", "classifier", "noise"])]
    pub methods: Vec<Method>,
    /// What is varied; --studies without a name leaves all out.
    #[arg(long, value_enum, value_delimiter = ',', num_args = 0.., default_values = ["interpolation", "pareto-front", "presets", "learning-rate", "rise", "steps", "update", "updates", "finish", "divisor", "smoothing"])]
    pub studies: Vec<Study>,
    /// On what motions are measured. Usually the rig; with the public evaluator the joints.
    #[arg(long, value_enum)]
    pub measure: Option<MeasurementTarget>,
    /// How many sentences each study is made with, at least 2.
    #[arg(long, default_value_t = 64, value_name = "N", value_parser = parse_sentence_count)]
    pub study_prompts: u64,
    /// Public evaluator: texts with several motions, for MultiModality; 0 leaves it out.
    #[arg(long, default_value_t = 100, value_name = "N")]
    pub mm_texts: u64,
    /// Public evaluator: motions of each of these texts, at least 2.
    #[arg(long, default_value_t = 30, value_name = "N", value_parser = clap::value_parser!(u64).range(2..=1000))]
    pub mm_motions: u64,
    /// Public evaluator: go on without the files that are missing, and leave out what needs them.
    #[arg(long)]
    pub partial: bool,
    /// Do a part of the work only: the I-th of N.
    #[arg(long, value_name = "I/N", value_parser = parse_shard, conflicts_with = "merge")]
    pub shard: Option<(usize, usize)>,
    /// Make none of the motions that are missing, but those of the pictures: write the report of the records in the folder. Give it the
    /// options of the run; what they ask for and is not there is left out.
    #[arg(long)]
    pub merge: bool,
    /// Check the files, and say what there is still to do, in all shards together, and how long it takes, by trying some motions of each
    /// kind.
    #[arg(long, conflicts_with_all = ["merge", "shard"])]
    pub dry_run: bool,
}

/// Parses a number of sentences: 2 or more.
fn parse_sentence_count(text: &str) -> Result<u64, String> {
    let count = text.parse().ok().filter(|count| *count >= 2);
    count.ok_or_else(|| "expected at least 2 sentences".into())
}

/// Parses a number of DDIM steps: 1 to 1000.
fn parse_steps(text: &str) -> Result<usize, String> {
    let steps = text.parse().ok();
    let steps = steps.filter(|steps| (1..=1000).contains(steps));
    steps.ok_or_else(|| "expected 1 to 1000 steps".into())
}
