//! `lamogen pack`.

use std::collections::HashSet;

use lamogen::FRAMES_PER_SECOND;
use lamogen::motion::remove_stale_temporaries;
use lamogen_data::{Dataset, PackOptions, Problems, Split, pack_all};
use serde_json::{Map, json};

use crate::arguments::Pack;
use crate::console::{Console, counted};
use crate::failure::{Code, Failure};
use crate::opened::read_options;

/// Broken motions that are named; `--json` names all.
const NAMED: usize = 20;

pub fn run(options: &Pack, console: &Console) -> Result<(), Failure> {
    if let Some(format) = options.reading.from {
        let message = format!(
            "--from {}: expected none, since nothing is packed from standard input",
            format.ending()
        );
        return Err(Failure::new(Code::Usage, message));
    }
    // A data set is made beside its folder.
    if let Some(parent) = options.out.parent() {
        let here = std::path::Path::new(".");
        remove_stale_temporaries(if parent.as_os_str().is_empty() {
            here
        } else {
            parent
        });
    }
    let bar = console.bar("files");
    let packing = PackOptions {
        captions: options.captions.clone(),
        more_captions: options.more_captions.clone(),
        speeds: options.speeds.clone(),
        mirror: !options.no_mirror,
        min_frames: options.min_frames,
        max_frames: options.max_frames,
        seed: options.seed,
        reading: read_options(&options.reading)?,
        force: options.force,
    };
    let packed = pack_all(&options.sources, &options.out, &packing, &mut |progress| {
        bar.set_length(progress.all as u64);
        bar.set_position(progress.done as u64);
    });
    bar.finish_and_clear();
    let data = packed?;
    let folder = options.out.display();
    tell_problems(data.problems(), console);
    for group in data.unchanging() {
        console.notice(format!(
            "{} never changes in the motions for training",
            group.name()
        ));
    }
    match console.json {
        true => console.say(report(options, &data)),
        false => console.say(format!("{folder}\n{}", summary(&data))),
    }
}

/// Names motions that are broken, and says how many were left out for which reason.
pub fn tell_problems(problems: &Problems, console: &Console) {
    for problem in problems.broken().take(NAMED) {
        let (name, reason) = (&problem.name, &problem.reason);
        console.notice(format!("left out: {name}: {reason}"));
    }
    let broken = problems.broken().count();
    if broken > NAMED {
        console.notice(format!("left out: {} more that are broken", broken - NAMED));
    }
    let counts = problems.counts();
    if !counts.is_empty() {
        let counts = counts.iter().map(|(kind, count)| format!("{count} {kind}"));
        let counts: Vec<String> = counts.collect();
        console.notice(format!("left out in all: {}", counts.join(", ")));
    }
}

/// What lies in a split.
struct Share {
    entries: usize,
    mirrored: usize,
    clips: usize,
    /// Of all entries, mirror images included.
    minutes: f64,
}

impl Share {
    fn of(data: &Dataset, split: Split) -> Share {
        let frames: usize = data.split(split).map(|entry| entry.frames).sum();
        Share {
            entries: data.split(split).count(),
            mirrored: data.split(split).filter(|entry| entry.mirror).count(),
            clips: data
                .split(split)
                .map(lamogen_data::Entry::clip)
                .collect::<HashSet<_>>()
                .len(),
            minutes: frames as f64 / f64::from(FRAMES_PER_SECOND) / 60.0,
        }
    }
}

fn summary(data: &Dataset) -> String {
    let mut lines = Vec::new();
    for split in Split::ALL {
        let Share {
            entries,
            mirrored,
            clips,
            minutes,
        } = Share::of(data, split);
        let images = match mirrored {
            0 => String::new(),
            _ => format!(", {mirrored} of them mirror images"),
        };
        let [clips, entries] = [
            counted(clips, "clip", "clips"),
            counted(entries, "entry", "entries"),
        ];
        lines.push(format!(
            "{split:9} {clips}, {entries}{images}, {minutes:.1} min"
        ));
    }
    for (kind, count) in data.problems().counts() {
        lines.push(format!("left out  {count} {kind}"));
    }
    lines.join("\n")
}

fn report(options: &Pack, data: &Dataset) -> String {
    let splits: Map<String, serde_json::Value> = Split::ALL
        .into_iter()
        .map(|split| {
            let Share { entries, mirrored, clips, minutes } = Share::of(data, split);
            let share = json!({ "clips": clips, "entries": entries, "mirrored": mirrored, "minutes": minutes });
            (split.to_string(), share)
        })
        .collect();
    let counts = data.problems().counts().into_iter();
    let counts: Map<String, serde_json::Value> = counts
        .map(|(kind, count)| (kind.to_string(), count.into()))
        .collect();
    let problems = data.problems().iter().map(
        |problem| json!({ "name": problem.name, "kind": problem.kind.name(), "reason": problem.reason }),
    );
    json!({
        "folder": options.out.to_string_lossy(),
        "splits": splits,
        "left_out": counts,
        "problems": problems.collect::<Vec<_>>(),
    })
    .to_string()
}
