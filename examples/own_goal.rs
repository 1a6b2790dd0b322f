//! A goal of one's own: a hand passes a place at a moment.
//!
//! `cargo run --release --example own_goal -- --at 2.0 --place -0.3,1.6,0.3`

use std::error::Error;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;

use clap::Parser;
use lamogen::files::{WriteOptions, write};
use lamogen::{
    Device, FRAMES_PER_SECOND, Joint, LaMoGen, LossTarget, LossTerm, Preset, Request, Tag, Tensor,
};

/// Generates a motion whose right hand passes a place at a moment, and prints how near it came.
#[derive(Parser)]
struct Arguments {
    /// What the person does.
    #[arg(long, default_value = "a person raises the right arm")]
    prompt: String,
    /// The moment, in seconds.
    #[arg(long, default_value_t = 2.0)]
    at: f32,
    /// The place in metres: x to the left, y up, z forward; the pelvis starts at x = z = 0 and faces forward.
    #[arg(long, default_value = "-0.3,1.6,0.3", value_parser = place, allow_hyphen_values = true)]
    place: [f32; 3],
    /// Weight of a metre in the loss.
    #[arg(long, default_value_t = 20.0)]
    weight: f32,
    /// Tags of the motion, such as light or sudden.
    #[arg(long)]
    tag: Vec<Tag>,
    /// Length of the motion in seconds, 2 to 9.8.
    #[arg(long, default_value_t = 4.0)]
    seconds: f32,
    /// Seed of the start noise.
    #[arg(long, default_value_t = 7)]
    seed: u64,
    /// The file to write; its ending says which format.
    #[arg(long, default_value = "target/own_goal.glb")]
    out: PathBuf,
}

/// Reads a place: three numbers with commas between them.
fn place(text: &str) -> Result<[f32; 3], String> {
    let numbers = text.split(',').map(|number| number.trim().parse::<f32>());
    let numbers: Result<Vec<f32>, _> = numbers.collect();
    { numbers.ok() }
        .and_then(|numbers| numbers.try_into().ok())
        .ok_or_else(|| format!("expected three numbers such as -0.3,1.6,0.3, found `{text}`"))
}

/// A joint that shall be at a place at one frame.
#[derive(Debug)]
struct JointAt {
    joint: Joint,
    frame: usize,
    place: [f32; 3],
    weight: f32,
}

impl LossTerm for JointAt {
    fn name(&self) -> String {
        format!("place of the {}", self.joint.name())
    }

    fn value_name(&self, value: usize) -> String {
        format!("{} of the {}", ["x", "y", "z"][value], self.joint.name())
    }

    fn measure(&self, joints: Tensor<4>, _lengths: &[usize]) -> Tensor<3> {
        joints.narrow(2, self.joint.index(), 1).squeeze_dim(2)
    }

    fn target(&self, baseline: Tensor<3>, _lengths: &[usize]) -> LossTarget {
        let [_, frames, _] = baseline.dims();
        LossTarget::constant(&self.place, self.weight, &baseline.device())
            .at_frame(self.frame, frames)
    }
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
    if !(0.0..arguments.seconds).contains(&arguments.at) {
        return Err("expected a moment within the motion".into());
    }
    let frame = (arguments.at * FRAMES_PER_SECOND).round() as usize;
    let goal = JointAt {
        joint: Joint::RightWrist,
        frame,
        place: arguments.place,
        weight: arguments.weight,
    };
    let request = Request::new(&arguments.prompt)
        .seconds(arguments.seconds)
        .seed(arguments.seed)
        .preset(Preset::Precise)
        .tags(arguments.tag.iter().copied())
        .loss_term(Arc::new(goal));
    let generation = LaMoGen::embedded(&Device::flex())?.generate(&request)?;
    let term = &generation.terms[0];
    let distance = |place: &[f32]| {
        let squares = place
            .iter()
            .zip(arguments.place)
            .map(|(a, b)| (a - b).powi(2));
        100.0 * squares.sum::<f32>().sqrt()
    };
    println!(
        "{} at {} s: {:.1} cm from the goal in the baseline, {:.1} cm in the guided motion",
        term.name,
        arguments.at,
        distance(&term.baseline[frame]),
        distance(&term.guided[frame]),
    );
    write(&arguments.out, &generation.guided, &WriteOptions::default())?;
    println!("{}", arguments.out.display());
    Ok(())
}
