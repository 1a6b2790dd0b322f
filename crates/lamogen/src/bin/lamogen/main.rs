//! The command `lamogen`: motion from a sentence, and what there is to do with motion files.
//!
//! ```text
//! arguments.rs ──▶ generate.rs ─┐   (goals.rs: what is asked of a motion)
//!                  batch.rs ────┼─▶ scene.rs ──▶ output.rs: one file of any format
//!    opened.rs ──▶ convert.rs ──┤
//!    a motion file play.rs ─────┘
//!                  laban.rs ──▶ report.rs: text and JSON
//!                  eval.rs ──▶ the paper's tables for a model
//!                  devices.rs, model.rs, pack.rs, shell.rs
//! ```
//!
//! Signals end the command after what it was writing is removed (signals.rs). Everything that can go wrong ends in a [`failure::Failure`] with one of the documented exit codes.

mod arguments;
mod batch;
mod console;
mod convert;
mod dataset;
mod devices;
mod each;
mod eval;
mod failure;
mod generate;
mod goals;
mod help;
mod laban;
mod model;
mod opened;
mod output;
mod pack;
mod play;
mod report;
mod scene;
mod shell;
mod signals;
mod source;
mod train;
mod vary;

use std::process::ExitCode;

use clap::Parser;

use arguments::{Arguments, Task};
use console::{Console, tell};

fn main() -> ExitCode {
    let Arguments { task, console } = Arguments::parse();
    let console = Console::new(&console);
    // A training stops by itself after the step under way.
    if !matches!(task, Task::Train(_)) {
        signals::clean_up_on_signals();
    }
    let result = match &task {
        Task::Generate(options) => generate::run(options, &console),
        Task::Laban(options) => laban::run(options, &console),
        Task::Convert(options) => convert::run(options, &console),
        Task::Play(options) => play::run(options, &console),
        Task::Batch(options) => batch::run(options, &console),
        Task::Pack(options) => pack::run(options, &console),
        Task::Vary(options) => vary::run(options, &console),
        Task::Train(options) => train::run(options, &console),
        Task::Eval(options) => eval::run(options, &console),
        Task::Devices => devices::run(&console),
        Task::Model(options) => model::run(options, &console),
        Task::Help { words } => help::run(words, &console),
        Task::Completions { shell } => shell::completions(*shell, &console),
        Task::Man { out } => shell::man(out.as_deref(), &console),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            if !failure.message.is_empty() {
                tell(format!("error: {}", failure.message));
            }
            if let Some(hint) = &failure.hint {
                tell(format!("hint: {hint}"));
            }
            ExitCode::from(failure.code as u8)
        }
    }
}
