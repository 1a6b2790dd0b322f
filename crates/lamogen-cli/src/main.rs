//! The command `lamogen`: generates motion from a sentence, and works with motion files.
//!
//! ```text
//! arguments.rs ──▶ generate.rs ─┐   (goals.rs: the goals of a motion)
//!                  batch.rs ────┼─▶ scene.rs ──▶ output.rs: one file of any format
//! motion_file.rs ▶ convert.rs ──┤
//!                  play.rs ─────┘
//!                  laban.rs ──▶ report.rs: text and JSON
//!                  serve.rs ──▶ the studio and the HTTP interface
//!                  eval.rs ──▶ the paper's tables for a model
//!                  devices.rs, model.rs, pack.rs, shell.rs
//! ```
//!
//! On a signal the command removes the files that are not complete yet, and ends; some keep what is finished first (signals.rs). Every error becomes a
//! [`failure::Failure`] with one of the documented exit codes.

mod arguments;
mod batch;
mod console;
mod convert;
mod dataset;
mod devices;
mod eval;
mod failure;
mod generate;
mod help;
mod laban;
mod model;
mod motion_file;
mod output;
mod pack;
mod play;
mod report;
mod scene;
mod serve;
mod shell;
mod signals;
mod source;
mod train;
mod unfinished;
mod vary;

use std::process::ExitCode;

use arguments::{Arguments, Command};
use console::{Console, print_to_stderr};

fn main() -> ExitCode {
    let arguments = arguments::parse(std::env::args_os().collect());
    let Arguments { command, console } = arguments.unwrap_or_else(|error| error.exit());
    let console = Console::new(&console);
    // These have signal handlers of their own: they finish or keep what they are at.
    if !matches!(
        command,
        Command::Generate(_)
            | Command::Batch(_)
            | Command::Train(_)
            | Command::Studio(_)
            | Command::Serve(_)
    ) {
        signals::clean_up_on_signals();
    }
    let result = match &command {
        Command::Generate(options) => generate::run(options, &console),
        Command::Laban(options) => laban::run(options, &console),
        Command::Convert(options) => convert::run(options, &console),
        Command::Play(options) => play::run(options, &console),
        Command::Batch(options) => batch::run(options, &console),
        Command::Pack(options) => pack::run(options, &console),
        Command::Vary(options) => vary::run(options, &console),
        Command::Train(options) => train::run(options, &console),
        Command::Eval(options) => eval::run(options, &console),
        Command::Studio(options) => serve::run_studio(options, &console),
        Command::Serve(options) => serve::run(options, &console),
        Command::Devices => devices::run(&console),
        Command::Model(options) => model::run(options, &console),
        Command::Help { words } => help::run(words, &console),
        Command::Completions { shell } => shell::completions(*shell, &console),
        Command::Man { out } => shell::man(out.as_deref(), &console),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            if !failure.message.is_empty() {
                print_to_stderr(format!("error: {}", failure.message));
            }
            if let Some(hint) = &failure.hint {
                print_to_stderr(format!("hint: {hint}"));
            }
            ExitCode::from(failure.code as u8)
        }
    }
}
