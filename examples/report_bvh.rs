//! A Laban report on a motion file of any skeleton: BVH, GLB or NumPy.
//!
//! `cargo run --release --example report_bvh -- dance.bvh`

use std::error::Error;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;
use lamogen::files::{ReadOptions, WriteOptions, read, write};
use lamogen::motion::{BoneDrift, FootSliding, Rotations};
use lamogen::{
    Component, Device, FRAMES_PER_SECOND, LaMoGen, LabanOptions, LabanSeries, Motion, Request,
    TimeSummary,
};

/// Prints Weight, Time, Flow and Shape of a motion file, where they peak, and what is wrong with the motion.
#[derive(Parser)]
struct Arguments {
    /// A .bvh, .glb, .gltf or .npy file; without one, a jump is generated and written as BVH first.
    file: Option<PathBuf>,
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
    let path = match &arguments.file {
        Some(path) => path.clone(),
        None => jump()?,
    };
    let imported = read(&path, &ReadOptions::default())?;
    let motion = &imported.motion;
    println!(
        "{}: {:.2} s; joints named as {}, unit {}, {} up",
        path.display(),
        motion.seconds(),
        imported.scheme.unwrap_or("HumanML3D's array"),
        imported.unit,
        imported.up
    );
    println!("{}", laban(motion));
    println!("{}", quality(motion));
    Ok(())
}

/// The four components: largest value, mean, and when they peak.
fn laban(motion: &Motion) -> String {
    let series = LabanSeries::of(motion, &LabanOptions::default(), &Device::flex());
    let maxima = series.summary(TimeSummary::Maximum);
    let means = series.summary(TimeSummary::Mean);
    let line = |component: Component| {
        let peaks: Vec<String> = series
            .peaks(component)
            .into_iter()
            .take(3)
            .map(|frame| format!("{:.2} s", frame as f32 / FRAMES_PER_SECOND))
            .collect();
        let (maximum, mean) = (maxima[component.index()], means[component.index()]);
        let peaks = peaks.join(", ");
        format!(
            "{component:7} {maximum:8.4} at most, {mean:8.4} on average ({}), peaks at {peaks}",
            component.unit()
        )
    };
    Component::ALL.map(line).join("\n")
}

/// Sliding feet, drifting bones, and how well a rigid skeleton can follow.
fn quality(motion: &Motion) -> String {
    let (feet, bones) = (FootSliding::of(motion), BoneDrift::of(motion));
    let rigid = Rotations::of(motion).distance(motion);
    format!(
        "feet slide in {:.0} % of the steps; bones drift by {:.1} mm at most ({}); as rotations of rigid bones the \
         joints are {:.1} mm off on average",
        100.0 * feet.ratio,
        1e3 * bones.largest(),
        bones.worst.name(),
        1e3 * rigid.mean
    )
}

/// Something to report on.
fn jump() -> Result<PathBuf, Box<dyn Error>> {
    let folder = PathBuf::from("target/report_bvh");
    std::fs::create_dir_all(&folder)?;
    let path = folder.join("jump.bvh");
    let jump =
        LaMoGen::embedded(&Device::flex())?.generate(&Request::new("a person jumps").seed(7))?;
    write(&path, &jump.guided, &WriteOptions::default())?;
    Ok(path)
}
