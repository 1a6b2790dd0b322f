//! Opening a motion file, or standard input.

use std::io::Read;
use std::path::Path;

use lamogen::Device;
use lamogen::files::{ImportedMotion, JointMapping, ReadOptions, read};
use lamogen::motion::placeholder;

use crate::arguments::{MotionReadingArguments, StreamFormat};
use crate::console::Console;
use crate::failure::{Failure, FailureCode};
use crate::scene::Scene;

/// A motion file that was read, and the assumptions made while reading it.
pub struct MotionFile {
    pub scene: Scene,
    /// The assumptions in words; empty if there are none.
    pub assumptions: String,
}

/// The path that means standard input.
pub const STANDARD_INPUT: &str = "-";

/// Reads a motion file, or standard input if the path is `-`, and prints notices about unusual contents and about
/// options without effect.
pub fn open_motion_file(
    path: &Path,
    reading: &MotionReadingArguments,
    device: &Device,
    console: &Console,
) -> Result<MotionFile, Failure> {
    let (name, imported) = match path == Path::new(STANDARD_INPUT) {
        true => (Path::new("standard input"), read_standard_input(reading)?),
        false => (path, read_file(path, reading)?),
    };
    let unused_options = unused_option_notices(path, reading);
    let notices = imported.notices.iter().map(ToString::to_string);
    for notice in notices.chain(unused_options) {
        console.notice(format!("{}: {notice}", name.display()));
    }
    Ok(MotionFile {
        assumptions: assumptions(&imported),
        scene: Scene::from_file(name, imported, device),
    })
}

/// Reads a file.
fn read_file(path: &Path, reading: &MotionReadingArguments) -> Result<ImportedMotion, Failure> {
    if let Some(format) = reading.from {
        let message = format!(
            "--from {}: expected standard input (-), found {}",
            format.ending(),
            path.display()
        );
        let hint = "the ending of a file's name says its format";
        return Err(Failure::new(FailureCode::Usage, message).hint(hint));
    }
    Ok(read(path, &read_options(reading)?)?)
}

/// Reads standard input in the format that `--from` states, or that the first bytes show.
fn read_standard_input(reading: &MotionReadingArguments) -> Result<ImportedMotion, Failure> {
    let failed = |reason: &dyn std::fmt::Display| {
        Failure::new(FailureCode::Input, format!("standard input: {reason}"))
    };
    let mut bytes = Vec::new();
    { std::io::stdin().lock() }
        .read_to_end(&mut bytes)
        .map_err(|error| failed(&error))?;
    if let Some(problem) = placeholder(&bytes) {
        return Err(failed(&problem));
    }
    let format = reading.from.or_else(|| StreamFormat::detect(&bytes));
    let format = format.ok_or_else(|| {
        let expected = "expected a motion in BVH, GLB, glTF or NumPy's format, found none of these";
        failed(&expected).hint("--from bvh, glb, gltf or npy says which")
    })?;
    let folder = tempfile::tempdir().map_err(|error| failed(&error))?;
    let path = folder.path().join(format!("stdin.{}", format.ending()));
    std::fs::write(&path, bytes).map_err(|error| failed(&error))?;
    let imported = read(&path, &read_options(reading)?);
    imported.map_err(|error| {
        let failure = Failure::from(error);
        Failure {
            message: { failure.message }.replace(&*path.to_string_lossy(), "standard input"),
            ..failure
        }
    })
}

/// Returns a notice for each option that was given and has no effect on a file of this format.
fn unused_option_notices(path: &Path, reading: &MotionReadingArguments) -> Vec<String> {
    let ending = path.extension().unwrap_or_default().to_string_lossy();
    let ends_with = |endings: &[&str]| {
        let mut endings = endings.iter();
        endings.any(|known| ending.eq_ignore_ascii_case(known))
    };
    let options = [
        (
            "--animation",
            reading.animation.is_some() && ends_with(&["bvh"]),
        ),
        (
            "--input-fps",
            reading.input_fps.is_some() && ends_with(&["glb", "gltf", "vrm", "vrma"]),
        ),
        ("--names", reading.names.is_some() && ends_with(&["npy"])),
    ];
    let unused = options.into_iter().filter(|(_, is_unused)| *is_unused);
    unused
        .map(|(option, _)| format!("{option} changes nothing in .{ending}"))
        .collect()
}

/// Returns the options of reading that the arguments state.
pub fn read_options(reading: &MotionReadingArguments) -> Result<ReadOptions, Failure> {
    Ok(ReadOptions {
        unit: reading.unit,
        up: reading.up,
        mapping: reading.names.as_ref().map(JointMapping::read).transpose()?,
        animation: reading.animation.clone(),
        frames_per_second: reading.input_fps,
    })
}

/// Describes the assumptions that were made while a file was read.
fn assumptions(imported: &ImportedMotion) -> String {
    let mut parts = Vec::new();
    if let Some(scheme) = imported.scheme {
        parts.push(format!("joints as {scheme}"));
        parts.push(format!("unit {}", imported.unit));
        parts.push(format!("{} up", imported.up));
        parts.push(
            format!("{:.4} frames a second", imported.source_frames_per_second)
                .replace(".0000", ""),
        );
    }
    if !imported.placed.is_empty() {
        let placed: Vec<&str> = imported.placed.iter().map(|joint| joint.name()).collect();
        parts.push(format!("placed by rule: {}", placed.join(", ")));
    }
    if !imported.other_animations.is_empty() {
        let others = imported.other_animations.join(", ");
        parts.push(format!("not read: the animations {others} (--animation)"));
    }
    if let Some(announced) = imported.announced_frames {
        parts.push(format!(
            "{} frames where {announced} are announced",
            imported.source_frames
        ));
    }
    parts.join("; ")
}
