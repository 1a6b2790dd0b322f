//! The arguments of the command line.
//!
//! Each subcommand has a file in `arguments/`; `shared.rs` has the arguments that several of them share.

mod batch;
mod convert;
mod eval;
mod generate;
mod laban;
mod model;
mod numbers;
mod pack;
mod play;
mod sentences;
mod serve;
mod shared;
mod train;
mod vary;

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand};
use clap_complete::Shell;

pub use batch::BatchArguments;
pub use convert::ConvertArguments;
pub use eval::EvalArguments;
pub use generate::GenerateArguments;
pub use laban::LabanArguments;
pub use model::ModelCommand;
pub use pack::PackArguments;
pub use play::PlayArguments;
pub use sentences::parse;
pub use serve::{ServeArguments, StudioArguments};
pub use shared::{
    BodyName, BvhNaming, HandsName, ModelArguments, MotionReadingArguments, PassArguments,
    PresetName, StreamFormat, TemporalSmoothingChoice, WritingArguments,
};
pub use train::TrainArguments;
pub use vary::VaryArguments;

/// Human motion from a sentence and a few words of Laban movement analysis.
///
/// A text-to-motion model gives the motion that the sentence describes; then it is guided so that the motion
/// becomes strong or light, sudden or sustained, bound or free, near or far.
#[derive(Parser)]
#[command(
    name = "lamogen",
    version,
    subcommand_required = true,
    disable_help_subcommand = true,
    arg_required_else_help = true,
    after_help = "Exit codes: 0 done, 1 a motion could not be generated, 2 wrong arguments or requests, \
                  3 a file or model could not be read, 4 a file could not be written, 5 a batch is done \
                  but for some motions, 6 stopped with what is finished kept, 130 ended by a signal."
)]
pub struct Arguments {
    #[command(subcommand)]
    pub command: Command,
    #[command(flatten)]
    pub console: ConsoleArguments,
}

/// The subcommands.
#[derive(Subcommand)]
pub enum Command {
    /// Generate a motion from a sentence.
    #[command(after_help = generate::AFTER_HELP)]
    Generate(Box<GenerateArguments>),
    /// Measure a motion file: Weight, Time, Flow, Shape, their peaks, sliding feet, drifting bones, joints that twitch.
    Laban(LabanArguments),
    /// Convert a motion file to another format, or to a picture of it.
    Convert(ConvertArguments),
    /// Show motion files in the browser, in 3D.
    Play(PlayArguments),
    /// Play with motions in the browser: a sentence and sliders that the motion follows.
    #[command(after_help = serve::STUDIO_AFTER_HELP)]
    Studio(Box<StudioArguments>),
    /// Answer requests for motions over HTTP, for engines and other programs.
    #[command(after_help = serve::AFTER_HELP)]
    Serve(Box<ServeArguments>),
    /// Generate many motions from a file of requests; goes on where it was stopped.
    #[command(after_help = batch::AFTER_HELP)]
    Batch(BatchArguments),
    /// Pack motion capture with captions for training: HumanML3D's folder, or motion files.
    #[command(after_help = pack::AFTER_HELP)]
    Pack(PackArguments),
    /// Make variations of a data set's motions, with other Laban features, for training a network that is told them.
    Vary(VaryArguments),
    /// Check the paper's claims on a model: its tables and ablations, as a report; goes on where it was stopped.
    #[command(after_help = eval::AFTER_HELP)]
    Eval(EvalArguments),
    /// Train a model on motion capture with captions; goes on where it was stopped.
    #[command(after_help = train::AFTER_HELP)]
    Train(TrainArguments),
    /// List where this program can compute on this machine.
    Devices,
    /// Look at a model's files, or convert them.
    #[command(subcommand)]
    Model(ModelCommand),
    /// Print the help of a command, or a topic: model-folder, data, recipe, sentences.
    Help {
        /// The command and its parts, or the topic.
        words: Vec<String>,
    },
    /// Print a shell's completions of this command.
    Completions {
        /// The shell.
        shell: Shell,
    },
    /// Print this command's manual page, or write those of all its parts.
    Man {
        /// Folder for one page each part.
        #[arg(long)]
        out: Option<PathBuf>,
    },
}

/// What is printed while a command works.
#[derive(Args)]
pub struct ConsoleArguments {
    /// Print the result as JSON, for machines.
    #[arg(long, global = true)]
    pub json: bool,
    /// Print no progress and no notices.
    #[arg(long, short, global = true)]
    pub quiet: bool,
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_arguments_are_consistent() {
        Arguments::command().debug_assert();
    }
}
