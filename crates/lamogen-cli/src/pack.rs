//! `lamogen pack`: packs data sets and motion files into one data set.

use std::collections::HashSet;

use lamogen::FRAMES_PER_SECOND;
use lamogen::motion::remove_stale_temporaries;
use lamogen_data::{Dataset, PackOptions, Problems, Split, pack_all};
use serde_json::{Map, json};

use crate::arguments::PackArguments;
use crate::console::{Console, count_noun};
use crate::failure::{Failure, FailureCode};
use crate::motion_file::read_options;

/// The largest number of broken motions that are listed by name; `--json` lists all.
const MAX_LISTED: usize = 20;

/// Runs `lamogen pack`.
pub fn run(options: &PackArguments, console: &Console) -> Result<(), Failure> {
    if let Some(format) = options.reading.from {
        let message = format!(
            "--from {}: expected none, since nothing is packed from standard input",
            format.ending()
        );
        return Err(Failure::new(FailureCode::Usage, message));
    }
    // A data set is written to a temporary folder beside its own.
    if let Some(parent) = options.out.parent() {
        let current = std::path::Path::new(".");
        remove_stale_temporaries(if parent.as_os_str().is_empty() {
            current
        } else {
            parent
        });
    }
    let bar = console.progress_bar("files");
    let packing = PackOptions {
        captions: options.captions.clone(),
        more_captions: options.more_captions.clone(),
        compositions: options.compositions.clone(),
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
    print_problems(data.problems(), console);
    for group in data.unchanging() {
        console.notice(format!(
            "{} never changes in the motions for training",
            group.name()
        ));
    }
    match console.json {
        true => console.print(summary_json(options, &data)),
        false => console.print(format!("{folder}\n{}", summary_text(&data))),
    }
}

/// Prints the broken motions by name, and how many motions were left out for which reason.
pub fn print_problems(problems: &Problems, console: &Console) {
    for problem in problems.broken().take(MAX_LISTED) {
        let (name, reason) = (&problem.name, &problem.reason);
        console.notice(format!("left out: {name}: {reason}"));
    }
    let broken = problems.broken().count();
    if broken > MAX_LISTED {
        let more = broken - MAX_LISTED;
        console.notice(format!("left out: {more} more that are broken"));
    }
    let counts = problems.counts();
    if !counts.is_empty() {
        let counts = counts.iter().map(|(kind, count)| format!("{count} {kind}"));
        let counts: Vec<String> = counts.collect();
        console.notice(format!("left out in all: {}", counts.join(", ")));
    }
}

/// The size of a split.
struct SplitSize {
    entries: usize,
    /// The number of entries that are mirror images.
    mirrored: usize,
    clips: usize,
    /// The duration of all entries, mirror images included.
    minutes: f64,
}

impl SplitSize {
    fn of(data: &Dataset, split: Split) -> SplitSize {
        let frames: usize = data.split(split).map(|entry| entry.frames).sum();
        SplitSize {
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

/// Describes the splits of a data set, and how many motions were left out.
fn summary_text(data: &Dataset) -> String {
    let mut lines = Vec::new();
    for split in Split::ALL {
        let SplitSize {
            entries,
            mirrored,
            clips,
            minutes,
        } = SplitSize::of(data, split);
        let images = match mirrored {
            0 => String::new(),
            _ => format!(", {mirrored} of them mirror images"),
        };
        let [clips, entries] = [
            count_noun(clips, "clip", "clips"),
            count_noun(entries, "entry", "entries"),
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

/// Describes the splits of a data set, and the motions that were left out, as JSON.
fn summary_json(options: &PackArguments, data: &Dataset) -> String {
    let splits: Map<String, serde_json::Value> = Split::ALL
        .into_iter()
        .map(|split| {
            let SplitSize { entries, mirrored, clips, minutes } = SplitSize::of(data, split);
            let size = json!({ "clips": clips, "entries": entries, "mirrored": mirrored, "minutes": minutes });
            (split.to_string(), size)
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
