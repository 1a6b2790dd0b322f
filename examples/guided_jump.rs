//! A sentence and Laban tags become a motion, on the model that lamogen carries.
//!
//! `cargo run --release --example guided_jump -- --help`

use std::error::Error;
use std::io::{ErrorKind, Write};
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;
use indicatif::{ProgressBar, ProgressStyle};
use lamogen::files::{WriteOptions, write};
use lamogen::{Component, Device, Generation, LaMoGen, Preset, Request, Tag, TimeSummary};
use lamogen_view::{LabanCurve, LabelledMotion, Page, PageFigure, curves, page, save, strip};

/// Generates a motion from a sentence, once as the text alone gives it and once as the tags ask.
#[derive(Parser)]
struct Arguments {
    /// What the person does.
    #[arg(long, default_value = "a person jumps")]
    prompt: String,
    /// How: light or strong, sustained or sudden, bound or free, near or far; may be repeated.
    #[arg(long = "tag", default_values = ["strong", "sudden"])]
    tags: Vec<Tag>,
    /// Length of the motion in seconds, 2 to 9.8.
    #[arg(long, default_value_t = 3.0)]
    seconds: f32,
    /// DDIM steps of each of the two passes, 1 to 1000.
    #[arg(long, default_value_t = Preset::Precise.steps())]
    steps: usize,
    /// Seed of the start noise.
    #[arg(long, default_value_t = 7)]
    seed: u64,
    /// Folder for the files.
    #[arg(long, default_value = "target/guided_jump")]
    out: PathBuf,
}

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: &Arguments) -> Result<(), Box<dyn Error>> {
    // A folder that cannot be written to should be known before the work, not after.
    std::fs::create_dir_all(&arguments.out)
        .and_then(|()| tempfile::tempfile_in(&arguments.out))
        .map_err(|error| format!("{}: {error}", arguments.out.display()))?;
    let model = LaMoGen::embedded(&Device::flex())?;
    if let Some(licence) = model.licence() {
        eprintln!("Weights: {licence}");
    }
    let request = Request::new(&arguments.prompt)
        .tags(arguments.tags.iter().copied())
        .seconds(arguments.seconds)
        .steps(arguments.steps)
        .seed(arguments.seed);
    let style = "{msg:9} {bar:40} {pos}/{len} steps, {elapsed}";
    let bar = ProgressBar::no_length().with_style(ProgressStyle::with_template(style)?);
    let result = model.generate_with(&request, &mut |progress| {
        bar.set_length(progress.total as u64);
        bar.set_message(progress.step.pass.to_string());
        bar.set_position(progress.done as u64);
        ControlFlow::Continue(())
    })?;
    bar.finish();
    if result.cut_tokens > 0 {
        eprintln!(
            "The prompt is too long: its last {} tokens were left out.",
            result.cut_tokens
        );
    }
    write_files(arguments, &result)?;
    match std::io::stdout().write_all(report(arguments, &result).as_bytes()) {
        // Whoever reads along may stop reading.
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(error.into()),
        _ => Ok(()),
    }
}

/// What changed, as a table.
fn report(arguments: &Arguments, result: &Generation) -> String {
    let mut lines = Vec::new();
    for (summary, name) in [
        (TimeSummary::Maximum, "maximum over time"),
        (TimeSummary::Mean, "mean over time"),
    ] {
        let [baseline, target, guided] =
            [&result.baseline_laban, &result.target, &result.guided_laban]
                .map(|laban| laban.summary(summary));
        lines.push(format!(
            "{name:18} {:>10} {:>10} {:>10} {:>9} {:>9}",
            "baseline", "target", "guided", "asked", "change"
        ));
        for component in Component::ALL {
            let [baseline, target, guided] =
                [baseline, target, guided].map(|values| values[component.index()]);
            // Without a sign where it rounds to nothing.
            let change = |value: f32| (100.0 * (value / baseline - 1.0)).round() + 0.0;
            lines.push(format!(
                "{component:18} {baseline:10.4} {target:10.4} {guided:10.4} {:+8.0}% {:+8.0}%",
                change(target),
                change(guided)
            ));
        }
        lines.push(String::new());
    }
    lines.push(format!(
        "The two motions are {:.2} m apart on average.",
        result.guided.distance(&result.baseline)
    ));
    lines.push(format!(
        "Files in {}: player.html (open it in a browser), guided.glb (for Blender and engines), strip.svg, \
         curves.svg, baseline.npy and guided.npy (joints in metres, frames × 22 × 3)",
        arguments.out.display()
    ));
    lines.join("\n") + "\n"
}

fn write_files(arguments: &Arguments, result: &Generation) -> Result<(), Box<dyn Error>> {
    let out = |name: &str| arguments.out.join(name);
    result.baseline.save_joints(out("baseline.npy"))?;
    result.guided.save_joints(out("guided.npy"))?;
    write(out("guided.glb"), &result.guided, &WriteOptions::default())?;
    let tags: Vec<String> = arguments.tags.iter().map(Tag::to_string).collect();
    let tags = tags.join(", ");
    let rows = [
        LabelledMotion::new("text alone", &result.baseline),
        LabelledMotion::new(&tags, &result.guided),
    ];
    save(out("strip.svg"), &strip(&rows, 10))?;
    let title = format!("{}: {tags}", arguments.prompt);
    let lines = [
        LabanCurve::baseline(&result.baseline_laban),
        LabanCurve::target(&result.target),
        LabanCurve::guided(&result.guided_laban),
    ];
    save(out("curves.svg"), &curves(&title, &lines)?)?;
    let figures = [
        PageFigure::baseline(&result.baseline),
        PageFigure::guided(&result.guided),
    ];
    let player = Page {
        title: &arguments.prompt,
        notes: &tags,
        figures: &figures,
        curves: &lines,
        captions: &[],
    };
    save(out("player.html"), &page(&player))?;
    Ok(())
}
