//! A motion file as the command opens it.

use std::path::Path;

use lamogen::Device;
use lamogen::files::{Imported, Mapping, ReadOptions, read};

use crate::arguments::ReadingArguments;
use crate::failure::Failure;
use crate::scene::Scene;

/// A file, and what was assumed of it.
pub struct Opened {
    pub scene: Scene,
    pub assumed: String,
}

/// Reads a motion file.
pub fn open(path: &Path, reading: &ReadingArguments, device: &Device) -> Result<Opened, Failure> {
    let imported = read(path, &read_options(reading)?)?;
    Ok(Opened {
        assumed: assumed(&imported),
        scene: Scene::file(path, imported, device),
    })
}

/// What is known of motion files beforehand.
pub fn read_options(reading: &ReadingArguments) -> Result<ReadOptions, Failure> {
    Ok(ReadOptions {
        unit: reading.unit,
        up: reading.up,
        mapping: reading.names.as_ref().map(Mapping::read).transpose()?,
        animation: reading.animation.clone(),
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
