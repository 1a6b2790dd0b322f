//! A sentence whose Laban components change in the middle of the motion.
//!
//! `cargo run --release --example time_varying -- --weight "0:1 1:strong 2:light" --seconds 3`

use std::error::Error;
use std::io::{ErrorKind, Write};
use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;
use lamogen::{
    COMPONENTS, Component, Device, FRAMES_PER_SECOND, Factor, Generation, LaMoGen, Preset, Request,
    ScaleCurve, TimeSummary,
};
use lamogen_view::{LabanCurve, LabelledMotion, curves, save, strip};

/// Generates a motion whose Weight, Time, Flow or Shape is asked to change over time.
///
/// A factor is a number or a word, or keys seconds:factor in the order of time, such as "0:1 1:strong
/// 2:light": each holds until the next. With ~ between two keys the factor slides: "0:1 ~ 2:0.5". Before
/// the first key it is 1.
#[derive(Parser)]
struct Arguments {
    /// What the person does.
    #[arg(long, default_value = "a person walks forward")]
    prompt: String,
    /// Factor on Weight; words: light, strong.
    #[arg(long, default_value = "0:light 2:strong", value_parser = factor(Component::Weight))]
    weight: Factor,
    /// Factor on Time; words: sustained, sudden.
    #[arg(long, default_value = "1", value_parser = factor(Component::Time))]
    time: Factor,
    /// Factor on Flow; words: bound, free.
    #[arg(long, default_value = "1", value_parser = factor(Component::Flow))]
    flow: Factor,
    /// Factor on Shape; words: near, far.
    #[arg(long, default_value = "1", value_parser = factor(Component::Shape))]
    shape: Factor,
    /// Weight in the loss of the components that shall change, instead of the library's default: more follows
    /// the factors more exactly and keeps the other components less.
    #[arg(long)]
    emphasis: Option<f32>,
    /// Length of the motion in seconds, 2 to 9.8.
    #[arg(long, default_value_t = 4.0)]
    seconds: f32,
    /// DDIM steps of each of the two passes, 1 to 1000.
    #[arg(long, default_value_t = Preset::Precise.steps())]
    steps: usize,
    /// Seed of the start noise.
    #[arg(long, default_value_t = 7)]
    seed: u64,
    /// Folder for the files.
    #[arg(long, default_value = "target/time_varying")]
    out: PathBuf,
}

/// Reads a component's factor.
fn factor(
    component: Component,
) -> impl Fn(&str) -> Result<Factor, lamogen::FactorError> + Clone + Send + Sync {
    move |text| Factor::parse(component, text)
}

fn main() -> ExitCode {
    match run(Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: Arguments) -> Result<(), Box<dyn Error>> {
    // A folder that cannot be written to should be known before the work, not after.
    std::fs::create_dir_all(&arguments.out)
        .and_then(|()| tempfile::tempfile_in(&arguments.out))
        .map_err(|error| format!("{}: {error}", arguments.out.display()))?;
    let model = LaMoGen::embedded(&Device::flex())?;
    if let Some(licence) = model.licence() {
        eprintln!("Weights: {licence}");
    }
    let scale = ScaleCurve::default()
        .with(Component::Weight, arguments.weight)
        .with(Component::Time, arguments.time)
        .with(Component::Flow, arguments.flow)
        .with(Component::Shape, arguments.shape);
    let mut guidance = Preset::Precise.guidance();
    if let Some(emphasis) = arguments.emphasis {
        guidance.emphasis = [emphasis; COMPONENTS];
    }
    let request = Request::new(&arguments.prompt)
        .scale(scale)
        .guidance(guidance)
        .seconds(arguments.seconds)
        .steps(arguments.steps)
        .seed(arguments.seed);
    let result = model.generate(&request)?;

    let label = result.goals.to_string();
    let out = |name: &str| arguments.out.join(name);
    result.baseline.save_joints(out("baseline.npy"))?;
    result.guided.save_joints(out("guided.npy"))?;
    let rows = [("text alone", &result.baseline), (&label, &result.guided)];
    let rows = rows.map(|(label, motion)| LabelledMotion::new(label, motion));
    save(out("strip.svg"), &strip(&rows, 10))?;
    let lines = [
        LabanCurve::baseline(&result.baseline_laban),
        LabanCurve::target(&result.target),
        LabanCurve::guided(&result.guided_laban),
    ];
    let title = format!("{}: {label}", arguments.prompt);
    save(out("curves.svg"), &curves(&title, &lines)?)?;

    let report = format!(
        "{}\nFiles in {}: baseline.npy and guided.npy (joints in metres, frames × 22 × 3), strip.svg, curves.svg\n",
        report(&result),
        arguments.out.display()
    );
    match std::io::stdout().write_all(report.as_bytes()) {
        // Whoever reads along may stop reading.
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(error.into()),
        _ => Ok(()),
    }
}

/// What was asked of each component and what came out, from key to key, by the mean.
fn report(result: &Generation) -> String {
    let mut table = format!(
        "{:18} {:>10} {:>10} {:>10} {:>9} {:>9}\n",
        "mean of", "baseline", "target", "guided", "asked", "change"
    );
    let segments = result.goals.scale().segments(result.guided.frames());
    for component in Component::ALL {
        for frames in &segments {
            let [baseline, target, guided] =
                [&result.baseline_laban, &result.target, &result.guided_laban]
                    .map(|laban| laban.section(frames.clone()).summary(TimeSummary::Mean))
                    .map(|means| means[component.index()]);
            // Without a sign where it rounds to nothing.
            let change = |value: f32| (100.0 * (value / baseline - 1.0)).round() + 0.0;
            let [start, end] = [frames.start, frames.end].map(|t| t as f32 / FRAMES_PER_SECOND);
            let name = format!("{component} {start:.1}–{end:.1} s");
            table += &format!(
                "{name:18} {baseline:10.4} {target:10.4} {guided:10.4} {:+8.0}% {:+8.0}%\n",
                change(target),
                change(guided)
            );
        }
    }
    table
}
