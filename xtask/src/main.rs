//! Development tasks of lamogen: `cargo xtask --help`.

use std::path::PathBuf;
use std::process::ExitCode;

use burn::tensor::Device;
use clap::{Parser, Subcommand};

#[derive(Parser)]
#[command(name = "cargo xtask", about = "Development tasks of lamogen")]
struct Arguments {
    #[command(subcommand)]
    task: Task,
}

#[derive(Subcommand)]
enum Task {
    /// Compare with a golden case of the PyTorch reference; exit 1 if a value is too far off.
    Parity {
        /// Folder with config.json, latest.tar, mean.npy, std.npy and case.safetensors.
        folder: PathBuf,
        /// Where to compute.
        #[arg(long, default_value = "flex", value_parser = ["flex"])]
        device: String,
    },
}

fn main() -> ExitCode {
    match Arguments::parse().task {
        Task::Parity { folder, device: _ } => match xtask::parity::run(&folder, &Device::flex()) {
            Ok(rows) => report(&rows),
            Err(error) => {
                eprintln!("error: {error}");
                ExitCode::FAILURE
            }
        },
    }
}

fn report(rows: &[xtask::parity::Row]) -> ExitCode {
    let mut all_pass = true;
    for row in rows {
        match row.result {
            None => println!("{:16} not yet covered", row.name),
            Some(result) => {
                all_pass &= result.passes();
                let verdict = match result.passes() {
                    true => "ok",
                    false => "TOO FAR OFF",
                };
                println!(
                    "{:16} {:9.2e}  of at most {:.0e}  {verdict}",
                    row.name, result.error, result.tolerance
                );
            }
        }
    }
    match all_pass {
        true => ExitCode::SUCCESS,
        false => ExitCode::FAILURE,
    }
}
