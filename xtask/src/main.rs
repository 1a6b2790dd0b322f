//! Development tasks of lamogen: `cargo xtask --help`.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use burn::tensor::Device;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Parser, Subcommand};
use indicatif::ProgressBar;
use lamogen::DeviceName;
use lamogen_model::Precision;
use xtask::bench::Options;
use xtask::parity::Row;
use xtask::test::Backends;

#[derive(Parser)]
#[command(name = "cargo xtask", about = "Development tasks of lamogen")]
struct Arguments {
    #[command(subcommand)]
    task: Task,
}

#[derive(Subcommand)]
enum Task {
    /// Run everything that must pass: format, lints, tests, docs, the example, and the other backends, of which those of graphics processors are
    /// left out where there is no Vulkan driver.
    Test {
        /// Leave the graphics processor out in any case.
        #[arg(long, conflicts_with = "all")]
        cpu_only: bool,
        /// Leave nothing out: fail where there is no Vulkan driver.
        #[arg(long)]
        all: bool,
    },
    /// Let other programs judge the files that lamogen writes: Khronos' glTF validator, Blender, three-vrm, a browser;
    /// and the server: schemathesis, curl, Python, node.
    Judges {
        /// Ask only the judges whose names contain this text, such as three-vrm.
        #[arg(long, value_name = "TEXT")]
        only: Option<String>,
    },
    /// Compare with a golden case of the PyTorch reference; exit 1 if a value is too far off.
    Parity {
        /// Folder with config.json, latest.tar, mean.npy, std.npy and case.safetensors.
        folder: PathBuf,
        /// Where to compute: flex, or a backend that xtask was built with (cargo run --release --bin xtask
        /// --features wgpu -- parity …), such as wgpu, wgpu:cpu or cuda:0.
        #[arg(long, default_value = "flex")]
        device: DeviceName,
        /// Accept values beyond their tolerance where rounding alone moves them as far.
        #[arg(long)]
        allow_rounding: bool,
    },
    /// Time the network and both passes; prints one line of JSON, seconds and MiB.
    Bench {
        #[command(flatten)]
        options: xtask::bench::Options,
        /// Where to compute, as for parity.
        #[arg(long, default_value = "flex")]
        device: DeviceName,
    },
    /// Let many clients ask lamogen serve at once; prints a table beside lamogen batch on the same requests.
    Load {
        #[command(flatten)]
        options: xtask::load::Options,
    },
    /// Measure how cost grows with frames, batch and steps; prints the points and plots them.
    Sweep {
        /// Which network.
        #[arg(long, value_enum, default_value = "compact")]
        size: xtask::bench::Size,
        /// The plot to write, as SVG.
        #[arg(long)]
        out: PathBuf,
        /// Where to compute, as for parity.
        #[arg(long, default_value = "flex")]
        device: DeviceName,
    },
    /// Measure a model on motions it has not seen, for its model card; prints JSON.
    Measure {
        #[command(flatten)]
        options: xtask::measure::Options,
        /// Where to compute, such as flex or wgpu:cpu.
        #[arg(long, default_value = "flex")]
        device: DeviceName,
    },
    /// Measure what guidance can take hold of in a network, side by side; prints a table in Markdown.
    Handles {
        #[command(flatten)]
        options: xtask::handles::Options,
        /// Where to compute, such as flex or wgpu:cpu.
        #[arg(long, default_value = "flex")]
        device: DeviceName,
    },
    /// Draw what a model makes of the sentences of its model card.
    Strips {
        #[command(flatten)]
        options: xtask::strips::Options,
        /// Where to compute, such as flex or wgpu:cpu.
        #[arg(long, default_value = "flex")]
        device: DeviceName,
    },
    /// Draw one motion on characters of other proportions, the picture of docs/characters.md.
    Bodies {
        #[command(flatten)]
        options: xtask::bodies::Options,
        /// Where to compute, such as flex or wgpu:cpu.
        #[arg(long, default_value = "flex")]
        device: DeviceName,
    },
    /// Time one step of training on random motions; prints one JSON line.
    BenchTraining {
        #[command(flatten)]
        options: xtask::training::Options,
        /// Where to compute, such as flex or wgpu:cpu.
        #[arg(long, default_value = "flex")]
        device: DeviceName,
    },
    /// Generate everyday sentences and check on the body whether the motions do what is said; --validate checks the checks.
    Truth {
        #[command(flatten)]
        options: xtask::truth::Options,
        /// Where to compute, such as flex or wgpu:cpu.
        #[arg(long, default_value = "flex")]
        device: DeviceName,
    },
    /// Predict the answers of a study on similar motions by Laban features: which of them people see; prints a page of Markdown.
    Perception {
        #[command(flatten)]
        options: xtask::perception::Options,
        /// Where to compute, such as flex or wgpu:cpu.
        #[arg(long, default_value = "flex")]
        device: DeviceName,
    },
    /// Measure where motions go from one sentence to the next, beside clips that are cross-faded; prints a table.
    Seams {
        #[command(flatten)]
        options: xtask::seams::Options,
        /// Where to compute, such as flex or wgpu:cpu.
        #[arg(long, default_value = "flex")]
        device: DeviceName,
    },
    /// Generate sentences with paths and positions to reach, and measure how near they come in files; prints a table in Markdown.
    Places {
        #[command(flatten)]
        options: xtask::places::Options,
        /// Where to compute, such as flex or wgpu:cpu.
        #[arg(long, default_value = "flex")]
        device: DeviceName,
    },
    /// Ask of sentences the places at which captured motions were, and measure what these cost (R-precision, FID, jerk); prints a table in
    /// Markdown.
    CapturedPlaces {
        #[command(flatten)]
        options: xtask::captured_places::Options,
        /// Where to compute, such as flex or wgpu:cpu.
        #[arg(long, default_value = "flex")]
        device: DeviceName,
    },
    /// Write the captions of a packed data set in other words, with their contents, and a tokenizer of them: what
    /// crates/lamogen-train/scripts/text_encoder.py makes a text encoder from.
    Phrasings {
        #[command(flatten)]
        options: xtask::phrasings::Options,
    },
    /// Turn a model folder into what the crate lamogen-compact embeds: weights in 16 or 8 bits.
    Embed {
        /// A model folder (docs/checkpoints.md).
        from: PathBuf,
        /// Folder to write to.
        #[arg(long, default_value = "crates/lamogen-compact/model")]
        to: PathBuf,
        /// Licence of the weights, as an SPDX identifier.
        #[arg(long, default_value = "CC-BY-4.0")]
        license: String,
        /// Bits a number: 16, or 8 with a scale for each row of a matrix.
        #[arg(long, default_value = "16", value_parser = PossibleValuesParser::new(["16", "8"]).try_map(|bits| bits.parse::<Precision>()))]
        bits: Precision,
        /// Whom to name when the weights are passed on.
        #[arg(long, default_value = include_str!("../../crates/lamogen-compact/ATTRIBUTION"), hide_default_value = true)]
        attribution: String,
    },
}

fn main() -> ExitCode {
    match Arguments::parse().task {
        Task::Test { cpu_only, all } => xtask::test::run(match (cpu_only, all) {
            (true, _) => Backends::Cpu,
            (_, true) => Backends::All,
            _ => Backends::Possible,
        }),
        Task::Judges { only } => xtask::judges::run(only.as_deref().unwrap_or("")),
        Task::Parity {
            folder,
            device,
            allow_rounding,
        } => with_device(device, |device| parity(&folder, device, allow_rounding)),
        Task::Bench {
            options,
            device: name,
        } => with_device(name, |device| bench(&options, name, device)),
        Task::Measure {
            options,
            device: name,
        } => with_device(name, |device| {
            match xtask::measure::run(&options, device, &mut |line| eprintln!("{line}")) {
                Ok(results) => {
                    println!("{results:#}");
                    ExitCode::SUCCESS
                }
                Err(error) => fail(&*error),
            }
        }),
        Task::Handles { options, device } => {
            with_device(device, |device| {
                match xtask::handles::run(&options, device, &mut |line| eprintln!("{line}")) {
                    Ok(table) => {
                        print!("{table}");
                        ExitCode::SUCCESS
                    }
                    Err(error) => fail(&*error),
                }
            })
        }
        Task::Strips { options, device } => {
            with_device(device, |device| {
                match xtask::strips::run(&options, device) {
                    Ok(()) => ExitCode::SUCCESS,
                    Err(error) => fail(&*error),
                }
            })
        }
        Task::Bodies { options, device } => {
            with_device(device, |device| {
                match xtask::bodies::run(&options, device) {
                    Ok(()) => ExitCode::SUCCESS,
                    Err(error) => fail(&*error),
                }
            })
        }
        Task::BenchTraining {
            options,
            device: name,
        } => with_device(name, |device| {
            match xtask::training::run(&options, device) {
                Ok(seconds) => {
                    let line = serde_json::json!({
                        "threads": rayon::current_num_threads(),
                        "device": name.to_string(),
                        "batch": options.batch,
                        "frames": options.frames,
                        "training_step_s": seconds,
                        "peak_mib": xtask::bench::peak_memory(),
                    });
                    println!("{line}");
                    ExitCode::SUCCESS
                }
                Err(error) => fail(&*error),
            }
        }),
        Task::Sweep { size, out, device } => {
            with_device(device, |device| {
                match xtask::sweep::run(size, device, &out, &mut |line| println!("{line}")) {
                    Ok(()) => ExitCode::SUCCESS,
                    Err(error) => fail(&*error),
                }
            })
        }
        Task::Load { options } => printed(xtask::load::run(&options, &mut say)),
        Task::Truth { options, device } => truth(&options, device),
        Task::Seams { options, device } => with_device(device, |device| {
            printed(xtask::seams::run(&options, device, &mut |line| say(&line)))
        }),
        Task::Perception { options, device } => with_device(device, |device| {
            printed(xtask::perception::run(&options, device, &mut say))
        }),
        Task::Places { options, device } => with_device(device, |device| {
            printed(xtask::places::run(&options, device, &mut say))
        }),
        Task::CapturedPlaces { options, device } => with_device(device, |device| {
            printed(xtask::captured_places::run(&options, device, &mut say))
        }),
        Task::Phrasings { options } => printed(xtask::phrasings::run(&options)),
        Task::Embed {
            from,
            to,
            license,
            bits,
            attribution,
        } => match xtask::embed::run(&from, &to, bits, license, attribution) {
            Ok(bytes) => {
                println!("{bytes} bytes of weights in {}", to.display());
                ExitCode::SUCCESS
            }
            Err(error) => fail(&*error),
        },
    }
}

/// Runs a task on a device.
fn with_device(name: DeviceName, task: impl FnOnce(&Device) -> ExitCode) -> ExitCode {
    match name.open() {
        Ok(device) => task(&device),
        Err(error) => fail(&error),
    }
}

/// Prints a line about what is being measured.
fn say(line: &str) {
    eprintln!("{line}");
}

/// Prints a table or a page, or why there is none.
fn printed(result: Result<String, Box<dyn std::error::Error>>) -> ExitCode {
    match result {
        Ok(text) => {
            print!("{text}");
            ExitCode::SUCCESS
        }
        Err(error) => fail(&*error),
    }
}

/// Runs a golden case and prints the comparison.
fn parity(folder: &Path, device: &Device, allow_rounding: bool) -> ExitCode {
    let spinner = ProgressBar::new_spinner();
    let result = xtask::parity::run(folder, device, &mut |step| {
        let (pass, index, steps) = (step.pass, step.index + 1, step.steps);
        spinner.set_message(format!("{pass} pass, step {index} of {steps}"));
        spinner.tick();
    });
    spinner.finish_and_clear();
    match result {
        Ok(rows) => report(&rows, allow_rounding),
        Err(error) => fail(&error),
    }
}

/// Times a network and prints the result as JSON.
fn bench(options: &Options, device_name: DeviceName, device: &Device) -> ExitCode {
    let times = match xtask::bench::run(options, device) {
        Ok(times) => times,
        Err(error) => return fail(&*error),
    };
    let line = serde_json::json!({
        "threads": rayon::current_num_threads(),
        "device": device_name.to_string(),
        "batch": options.batch,
        "frames": options.frames,
        "steps": options.steps,
        "denoiser_s": times.denoiser,
        "baseline_step_s": times.baseline_step,
        "guided_step_s": times.guided_step,
        "peak_mib": xtask::bench::peak_memory(),
    });
    println!("{line}");
    ExitCode::SUCCESS
}

/// Checks everyday sentences, or validates the checks.
fn truth(options: &xtask::truth::Options, device: DeviceName) -> ExitCode {
    let data = options.data.as_deref().filter(|_| options.validate);
    if let Some(data) = data {
        return match xtask::truth::validate(
            data,
            options.more_captions.as_deref(),
            options.out.as_deref(),
        ) {
            Ok((page, is_valid)) => {
                print!("{page}");
                match is_valid {
                    true => ExitCode::SUCCESS,
                    false => ExitCode::FAILURE,
                }
            }
            Err(error) => fail(&*error),
        };
    }
    with_device(device, |device| {
        match xtask::truth::run(options, device, &mut |line| eprintln!("{line}")) {
            Ok(page) => {
                print!("{page}");
                ExitCode::SUCCESS
            }
            Err(error) => fail(&*error),
        }
    })
}

/// Prints an error.
fn fail(error: &dyn std::error::Error) -> ExitCode {
    eprintln!("error: {error}");
    ExitCode::FAILURE
}

/// Prints the rows of a comparison; fails if a value is too far off.
fn report(rows: &[Row], allow_rounding: bool) -> ExitCode {
    let (mut failed, mut within_rounding) = (0, 0);
    for Row { name, result } in rows {
        let Some(result) = result else {
            println!("{name:20} not yet covered");
            continue;
        };
        let is_within_rounding = !result.is_within_tolerance() && result.is_within_rounding();
        let passes = result.is_within_tolerance() || (is_within_rounding && allow_rounding);
        failed += usize::from(!passes);
        within_rounding += usize::from(!passes && is_within_rounding);
        let verdict = match passes {
            true => "ok",
            false => "TOO FAR OFF",
        };
        let rounding = match result.rounding {
            Some(rounding) => format!(" (rounding alone moves it by {rounding:.1e})"),
            None => String::new(),
        };
        println!(
            "{name:20} {:9.2e}  of at most {:.0e}  {verdict}{rounding}",
            result.error, result.tolerance
        );
    }
    if failed == 0 {
        return ExitCode::SUCCESS;
    }
    println!(
        "{failed} too far off, {within_rounding} of them within what rounding alone does in this case \
         (docs/parity.md; --allow-rounding accepts those)"
    );
    ExitCode::FAILURE
}
