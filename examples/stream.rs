//! A motion that plays while it is made: sentences and a factor arrive on the way.
//!
//! `cargo run --release --example stream`

use std::error::Error;
use std::process::ExitCode;
use std::sync::mpsc;
use std::time::Instant;

use clap::Parser;
use lamogen::{Device, LaMoGen, Motion, Request, Scale, Tag};

/// Plays a motion while it is made, and prints when each stretch was there.
#[derive(Parser)]
struct Arguments {
    /// How the motion is done from the beginning: light or strong, sustained or sudden, bound or free, near or far; may be repeated.
    #[arg(long = "tag")]
    tags: Vec<Tag>,
    /// DDIM steps of each pass, 1 to 1000; usually those of the model's preset.
    #[arg(long)]
    steps: Option<usize>,
    /// Length of the first sentence in seconds: until it is made, nothing plays.
    #[arg(long, default_value_t = 2.0)]
    first: f32,
    /// Seed of the start noise.
    #[arg(long, default_value_t = 7)]
    seed: u64,
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

/// A stretch as a player gets it.
struct Delivery {
    label: String,
    seconds: f32,
    motion: Motion,
}

fn run(arguments: &Arguments) -> Result<(), Box<dyn Error>> {
    let model = LaMoGen::embedded(&Device::flex())?;
    let walk = |seconds: f32| {
        Request::new("a person walks forward")
            .seconds(seconds)
            .tags(arguments.tags.iter().copied())
    };
    // The first motion of a process costs a little more than the others.
    model.generate(&walk(2.0).steps(2))?;
    let start = Instant::now();
    let first = walk(arguments.first).seed(arguments.seed);
    let first = match arguments.steps {
        Some(steps) => first.steps(steps),
        None => first,
    };
    let mut stream = model.stream(&first)?;
    stream.then(&walk(8.0))?;
    let (sender, receiver) = mpsc::channel();
    std::thread::scope(|scope| -> Result<(), Box<dyn Error>> {
        let player = scope.spawn(move || play(receiver, start));
        let mut is_steered = false;
        while let Some(stretch) = stream.next() {
            let stretch = stretch?;
            let label = format!("{} {}", stretch.sentence, stretch.generation.goals);
            let (seconds, end) = (stretch.seconds(), stretch.frames.end);
            let motion = stretch.generation.guided;
            sender.send(Delivery {
                label,
                seconds,
                motion,
            })?;
            // What a game might do meanwhile.
            if !is_steered && end > 100 {
                is_steered = true;
                stream.steer(Scale::from_tags(&[Tag::Strong])?)?;
                stream.then(&Request::new("a person jumps").seconds(3.0))?;
            }
        }
        drop(sender);
        player.join().map_err(|_| "the player failed")?;
        Ok(())
    })
}

/// Plays stretches: the first as soon as it is there, and each one after the one before.
fn play(stretches: mpsc::Receiver<Delivery>, start: Instant) {
    println!("sentence, goals          from      ready   times real time   waited for");
    // The time at which what is there has been played.
    let mut played_until: Option<f32> = None;
    let mut last = 0.0;
    for Delivery {
        label,
        seconds,
        motion,
    } in stretches
    {
        let ready = start.elapsed().as_secs_f32();
        let begin = played_until.unwrap_or(ready).max(ready);
        let wait = begin - played_until.unwrap_or(begin);
        played_until = Some(begin + motion.seconds());
        let speed = motion.seconds() / (ready - last);
        last = ready;
        println!("{label:<22} {seconds:>5.1} s {ready:>8.2} s {speed:>17.1} {wait:>10.2} s");
    }
}
