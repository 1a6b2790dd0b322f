//! Converts a checkpoint to safetensors: half the size in 16 bits, and no pickle.
//!
//! ```sh
//! cargo run --release --example convert -- motiondiffuse/latest.tar motiondiffuse/model.safetensors --half
//! ```

use std::collections::HashMap;
use std::error::Error;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;
use indicatif::{ProgressBar, ProgressStyle};
use lamogen::model::{Checkpoint, Precision};

/// Convert a PyTorch checkpoint of MotionDiffuse, or any of lamogen's, to safetensors.
#[derive(Parser)]
struct Options {
    /// A `latest.tar`, or a file in safetensors.
    from: PathBuf,
    /// The file to write.
    to: PathBuf,
    /// Store 16 bits a number instead of 32.
    #[arg(long)]
    half: bool,
    /// Licence of the weights, as an SPDX identifier; it travels in the file.
    #[arg(long)]
    license: Option<String>,
    /// Whom to name when the weights or what they make is passed on.
    #[arg(long)]
    attribution: Option<String>,
}

fn main() -> ExitCode {
    match convert(Options::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn convert(options: Options) -> Result<(), Box<dyn Error>> {
    let precision = match options.half {
        true => Precision::F16,
        false => Precision::F32,
    };
    let texts = [
        ("license", options.license),
        ("attribution", options.attribution),
    ];
    let metadata: HashMap<String, String> = texts
        .into_iter()
        .filter_map(|(name, text)| Some((name.to_owned(), text?)))
        .collect();
    let bar = ProgressBar::new(0).with_style(ProgressStyle::with_template(
        "{bar:30} {pos}/{len} tensors  {msg}",
    )?);
    // Any other name would be taken for a PyTorch file when it is read.
    if options
        .to
        .extension()
        .is_none_or(|ending| ending != "safetensors")
    {
        let to = options.to.display();
        return Err(format!("expected a name that ends in .safetensors, found {to}").into());
    }
    let checkpoint = Checkpoint::open(&options.from)?;
    checkpoint.convert(&options.to, precision, metadata, &mut |converted| {
        bar.set_length(converted.all as u64);
        bar.set_position(converted.done as u64);
        bar.set_message(converted.key.to_owned());
    })?;
    bar.finish_and_clear();
    let bytes = std::fs::metadata(&options.to)?.len();
    println!("{}: {:.1} MB", options.to.display(), bytes as f64 / 1e6);
    Ok(())
}
