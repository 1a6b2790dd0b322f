//! `lamogen laban`.

use std::path::Path;

use serde_json::{Value, json};

use crate::arguments::Laban;
use crate::console::Console;
use crate::failure::Failure;
use crate::opened::{Opened, open};
use crate::report;
use crate::source::device;

pub fn run(options: &Laban, console: &Console) -> Result<(), Failure> {
    let device = device(None)?;
    let open = |path: &Path| open(path, &options.reading, &device, console);
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
        text += &report::comparison([&columns[0], &columns[1]], &with.laban, &shown.laban);
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
