//! `lamogen laban`.

use std::path::Path;

use lamogen::Device;
use lamogen::files::{Imported, Mapping, ReadOptions, read};
use serde_json::{Value, json};

use crate::arguments::{Laban, ReadingArguments};
use crate::console::Console;
use crate::failure::Failure;
use crate::report;
use crate::scene::Scene;
use crate::source::device;

pub fn run(options: &Laban, console: &Console) -> Result<(), Failure> {
    let device = device(None)?;
    let open = |path: &Path| open(path, &options.reading, &device);
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
            console.say(as_json(&file, other.as_ref()).to_string())?;
            continue;
        }
        if place > 0 {
            console.say("\n")?;
        }
        console.say(as_text(&file, other.as_ref()))?;
    }
    // The others were measured; what could not be is told at the end.
    let messages: Vec<&str> = failures
        .iter()
        .map(|failure| failure.message.as_str())
        .collect();
    match failures.first() {
        None => Ok(()),
        Some(first) => Err(Failure::new(first.code, messages.join("\n"))),
    }
}

/// A file, and what was assumed of it.
pub struct Opened {
    pub scene: Scene,
    pub assumed: String,
}

/// Reads a motion file.
pub fn open(path: &Path, reading: &ReadingArguments, device: &Device) -> Result<Opened, Failure> {
    let mapping = reading.names.as_ref().map(Mapping::read).transpose()?;
    let options = ReadOptions {
        unit: reading.unit,
        up: reading.up,
        mapping,
        animation: reading.animation.clone(),
    };
    let imported = read(path, &options)?;
    Ok(Opened {
        assumed: assumed(&imported),
        scene: Scene::file(path, imported, device),
    })
}

/// What was taken for granted, in a sentence.
fn assumed(imported: &Imported) -> String {
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

fn as_text(file: &Opened, other: Option<&Opened>) -> String {
    let shown = file.scene.main();
    let motion = &shown.motion;
    let mut text = format!(
        "{}: {:.2} s, {} frames\n",
        shown.label,
        motion.seconds(),
        motion.frames()
    );
    if !file.assumed.is_empty() {
        text += &format!("read with {}\n", file.assumed);
    }
    text += &report::text(shown);
    if let Some(other) = other {
        let with = other.scene.main();
        let columns = [short(&with.label), short(&shown.label)];
        text += &format!("\ncompared with {}\n", with.label);
        text += &report::comparison([&columns[0], &columns[1]], &with.laban, &shown.laban, None);
        text += &format!(
            "joints are {:.3} m apart on average\n",
            motion.distance(&with.motion)
        );
    }
    text
}

/// A name that fits a column.
fn short(name: &str) -> String {
    let letters: Vec<char> = name.chars().collect();
    match letters.len() > 12 {
        true => letters[..11].iter().chain(&['…']).collect(),
        false => name.to_owned(),
    }
}

fn as_json(file: &Opened, other: Option<&Opened>) -> Value {
    let mut whole = report::measured(&file.scene);
    if let Some(other) = other {
        let [motion, other_motion] = [file, other].map(|opened| &opened.scene.main().motion);
        let compared = json!({
            "other": report::measured(&other.scene),
            "distance_m": motion.distance(other_motion),
        });
        whole.insert("compared".into(), compared);
    }
    whole.into()
}
