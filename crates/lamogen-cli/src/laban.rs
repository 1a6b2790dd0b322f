//! `lamogen laban`: measures motion files.

use std::path::Path;

use serde_json::{Value, json};

use crate::arguments::LabanArguments;
use crate::console::Console;
use crate::failure::Failure;
use crate::motion_file::{MotionFile, open_motion_file};
use crate::report;
use crate::source::open_device;

/// Runs `lamogen laban`.
pub fn run(options: &LabanArguments, console: &Console) -> Result<(), Failure> {
    let device = open_device(None)?;
    let open = |path: &Path| open_motion_file(path, &options.reading, &device, console);
    let other = options.compare.as_deref().map(open).transpose()?;
    let mut failures: Vec<Failure> = Vec::new();
    for (place, path) in options.files.iter().enumerate() {
        let file = match open(path) {
            Ok(file) => file,
            Err(failure) => {
                failures.push(failure);
                continue;
            }
        };
        if console.json {
            console.print(as_json(&file, other.as_ref()).to_string())?;
            continue;
        }
        if place > 0 {
            console.print("\n")?;
        }
        console.print(as_text(&file, other.as_ref()))?;
    }
    // The files that could be read were measured; the errors of the others are printed at the end.
    let messages: Vec<&str> = failures
        .iter()
        .map(|failure| failure.message.as_str())
        .collect();
    match failures.first() {
        None => Ok(()),
        Some(first) => Err(Failure::new(first.code, messages.join("\n"))),
    }
}

/// Formats the measurements of a file as text, and its comparison with another file.
fn as_text(file: &MotionFile, other: Option<&MotionFile>) -> String {
    let measured = file.scene.main();
    let motion = &measured.motion;
    let mut text = format!(
        "{}: {:.2} s, {} frames\n",
        measured.label,
        motion.seconds(),
        motion.frames()
    );
    if !file.assumptions.is_empty() {
        text += &format!("read with {}\n", file.assumptions);
    }
    text += &report::measurement_table(measured);
    if let Some(other) = other {
        let other = other.scene.main();
        let columns = [shorten(&other.label), shorten(&measured.label)];
        let columns = [&*columns[0], &*columns[1]];
        text += &format!("\ncompared with {}\n", other.label);
        text += &report::comparison_table(columns, &other.laban, &measured.laban);
        text += &format!(
            "joints are {:.3} m apart on average\n",
            motion.distance(&other.motion)
        );
    }
    text
}

/// Shortens a name so that it fits a column.
fn shorten(name: &str) -> String {
    let letters: Vec<char> = name.chars().collect();
    match letters.len() > 12 {
        true => letters[..11].iter().chain(&['…']).collect(),
        false => name.to_owned(),
    }
}

/// Returns the measurements of a file as JSON, and its comparison with another file.
fn as_json(file: &MotionFile, other: Option<&MotionFile>) -> Value {
    let mut measurements = report::measurement_json(&file.scene);
    if let Some(other) = other {
        let [motion, other_motion] = [file, other].map(|file| &file.scene.main().motion);
        let comparison = json!({
            "other": report::measurement_json(&other.scene),
            "distance_m": motion.distance(other_motion),
        });
        measurements.insert("compared".into(), comparison);
    }
    measurements.into()
}
