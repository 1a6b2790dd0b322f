//! `lamogen eval`: the paper's evidence for a model.
//!
//! ```text
//! options ──plan.rs──▶ cells ──work.rs──▶ records (a line each) ──summary.rs──▶ figures ─┬─report.rs──▶ report.md, report.html
//!                      measure.rs: on a BVH ─┘                      stays.rs ─┘ pictures.rs ──┘
//! ```

mod document;
mod measure;
mod paper;
mod pictures;
mod plan;
mod record;
mod report;
mod stays;
mod summary;
mod work;

use std::collections::HashMap;
use std::fmt::Display;
use std::fs;
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::time::Instant;

use lamogen::Preset;
use lamogen::motion::remove_stale_temporaries;
use lamogen::motion::write_atomically;
use lamogen_data::{Checksum, Entry, LoadOptions};
use lamogen_eval::{Embeddings, Evaluator};
use serde_json::{Value, json};

use crate::arguments::Eval;
use crate::console::Console;
use crate::dataset;
use crate::failure::{Code, Failure};
use crate::source::{Source, device};
pub use measure::Measure;
use plan::{Basis, Cell, Places, Plan, Prompt};
pub use plan::{Method, Study};
use record::{Body, Key, Outcome, Store, read};
use summary::Evidence;
use work::{Real, Work, unjudged};

/// Judged at a time, and generated together.
const TOGETHER: usize = 8;

pub fn run(options: &Eval, console: &Console) -> Result<(), Failure> {
    if options.out.exists() && !options.out.is_dir() {
        let reason = "expected a folder, found a file";
        return Err(Failure::output(&options.out, reason));
    }
    remove_stale_temporaries(&options.out);
    let device = device(options.source.device)?;
    let source = Source::open(&options.source, console)?;
    let evaluator = Evaluator::load(&options.evaluator, &device).map_err(|error| {
        Failure::new(Code::Input, error)
            .hint("lamogen train --evaluator makes one: its folder is best")
    })?;
    let (prompts, real) = prompts(options, &source, &evaluator, console)?;
    let plan = Plan::new(options, source.model.preset(), prompts.len());
    let work = Work {
        source: &source,
        evaluator: &evaluator,
        prompts: &prompts,
        device: &device,
        measure: options.measure,
    };
    let all: Vec<Cell<'_>> = plan.cells().collect();
    // All that can be wrong with a sentence is better known before the first motion.
    work.check(&all)?;
    let texts = texts(&work, options.repeats)?;
    let identity = identity(&plan, &work, &real);
    let is_begun = is_begun(options, &identity)?;
    if options.dry_run {
        let records = match is_begun {
            true => read(&files(&options.out)?)?,
            false => HashMap::new(),
        };
        return estimate(&plan, &missing(&all, &records), &work, console);
    }
    if !is_begun {
        begin(&options.out, &identity)?;
    }
    if !options.merge {
        generate(options, &all, &work, console)?;
    }
    let records = read(&files(&options.out)?)?;
    let missing = missing(&all, &records).len();
    let mut paths = Vec::new();
    if missing > 0 && options.shard.is_some() {
        console.notice(format!(
            "{missing} of {} motions are for other shards; --merge writes the report of what there is",
            all.len()
        ));
    } else {
        let evidence = Evidence {
            records: &records,
            prompts: &prompts,
            texts: &texts,
            real: &real,
            repeats: options.repeats,
        };
        if missing > 0 {
            console.notice(format!(
                "{missing} of {} motions are not made yet; the report is of the others",
                all.len()
            ));
        }
        let report = report::Report::new(&plan, &evidence, &work, missing).map_err(unjudged)?;
        paths = report.write(&options.out)?;
    }
    let paths = paths.iter().map(|path| path.display().to_string());
    let paths: Vec<String> = paths.collect();
    let there = all.len() - missing;
    console.say(match (console.json, paths.is_empty()) {
        (true, _) => json!({ "motions": there, "missing": missing, "files": paths }).to_string(),
        (false, true) => format!("{there} of {} motions", all.len()),
        (false, false) => paths.join("\n"),
    })
}

/// What there is no record of.
fn missing<'a>(all: &[Cell<'a>], records: &HashMap<Key, Outcome>) -> Vec<Cell<'a>> {
    let missing = all.iter().filter(|cell| !records.contains_key(&cell.key()));
    missing.copied().collect()
}

/// The captions of every repeat, where the evaluator sees them.
fn texts(work: &Work<'_>, repeats: u64) -> Result<Vec<Embeddings>, Failure> {
    let of_repeat = |repeat| {
        let captions = work.prompts.iter().map(|prompt| prompt.caption(repeat));
        let captions: Vec<&str> = captions.collect();
        work.evaluator.texts(&captions)
    };
    let texts = (0..repeats).map(of_repeat).collect::<Result<_, _>>();
    texts.map_err(|error| Failure::new(Code::Input, error))
}

/// The sentences, and their motions.
fn prompts(
    options: &Eval,
    source: &Source,
    evaluator: &Evaluator,
    console: &Console,
) -> Result<(Vec<Prompt>, Real), Failure> {
    use lamogen::model::Denoiser;
    let network = source.model.network();
    let longest = network
        .max_frames()
        .min(evaluator.network().config().max_motion_length);
    let lengths = network.min_frames()..=longest;
    let limits = LoadOptions {
        min_frames: *lengths.start(),
        max_frames: LoadOptions::default().max_frames.max(longest),
    };
    let data = dataset::open(&options.data, &limits, console)?;
    let entries: Vec<&Entry> = data
        .split(options.split)
        .filter(|entry| !entry.mirror && lengths.contains(&entry.frames))
        .collect();
    let wanted = options.prompts.map_or(entries.len(), |n| n as usize);
    if wanted > entries.len() {
        console.notice(format!(
            "the {} split has {} sentences, not {wanted}: all are taken",
            options.split,
            entries.len()
        ));
    }
    let places = Places::spread(wanted, entries.len()).iter();
    let entries: Vec<&Entry> = places.map(|place| entries[place]).collect();
    if entries.len() < 2 {
        let message = format!(
            "{}: expected at least 2 motions of {} to {} frames in the {} split, found {}",
            options.data.display(),
            lengths.start(),
            lengths.end(),
            options.split,
            entries.len()
        );
        return Err(Failure::new(Code::Input, message));
    }
    let subject = |entry: &&Entry| {
        let motion = data.motion(entry).map_err(|error| error.to_string())?;
        let subject = options.measure.subject(&motion)?;
        Ok((subject.features(), subject.body()))
    };
    let subjects: Result<(Vec<Vec<f32>>, Vec<Body>), String> =
        entries.iter().map(subject).collect();
    let (features, bodies) = subjects.map_err(|error| Failure::new(Code::Input, error))?;
    let real = Real {
        points: evaluator.motions(&features).map_err(unjudged)?,
        bodies,
    };
    let prompts = entries.iter().map(|entry| Prompt {
        captions: entry
            .captions
            .iter()
            .map(|caption| caption.text.clone())
            .collect(),
        frames: entry.frames,
    });
    Ok((prompts.collect(), real))
}

/// Makes what is not there yet.
fn generate(
    options: &Eval,
    all: &[Cell<'_>],
    work: &Work<'_>,
    console: &Console,
) -> Result<(), Failure> {
    let (part, parts) = options.shard.unwrap_or((1, 1));
    let name = match parts {
        1 => "records.jsonl".into(),
        _ => format!("records-{part}-of-{parts}.jsonl"),
    };
    let mut store = Store::open(&options.out.join(name))?;
    let found = read(&files(&options.out)?)?;
    // Whole groups, so that a group is the same with and without shards, and with it the last bits of its numbers.
    let settings = all.chunk_by(|a, b| a.setting.name == b.setting.name);
    let groups = settings.flat_map(|setting| setting.chunks(TOGETHER));
    let own = groups.skip(part - 1).step_by(parts);
    let open = own.map(|group| missing(group, &found));
    let open: Vec<Vec<Cell<'_>>> = open.filter(|group| !group.is_empty()).collect();
    let bar = console.bar("motions");
    bar.set_length(open.iter().map(Vec::len).sum::<usize>() as u64);
    for group in &open {
        bar.set_message(group[0].setting.name.clone());
        for record in work.records(group)? {
            store.add(&record)?;
        }
        bar.inc(group.len() as u64);
    }
    bar.finish_and_clear();
    Ok(())
}

/// Says what there is still to do, and how long it takes by the first motions of each setting's kind.
fn estimate(
    plan: &Plan,
    missing: &[Cell<'_>],
    work: &Work<'_>,
    console: &Console,
) -> Result<(), Failure> {
    let mut lines = Vec::new();
    let mut seconds = 0.0;
    for setting in &plan.settings {
        let of_setting = missing.iter();
        let of_setting = of_setting.filter(|cell| cell.setting.name == setting.name);
        let of_setting: Vec<Cell<'_>> = of_setting.copied().collect();
        if of_setting.is_empty() {
            continue;
        }
        let first = &of_setting[..TOGETHER.min(of_setting.len())];
        let start = Instant::now();
        work.records(first)?;
        let each = start.elapsed().as_secs_f64() / first.len() as f64;
        seconds += each * of_setting.len() as f64;
        lines.push((setting.name.clone(), of_setting.len(), each));
    }
    if console.json {
        let settings = lines.iter().map(|(name, motions, each)| {
            json!({ "setting": name, "motions": motions, "seconds_each": each })
        });
        return console.say(
            json!({ "motions": missing.len(), "seconds": seconds, "settings": settings.collect::<Vec<_>>() }).to_string(),
        );
    }
    let rows = lines
        .iter()
        .map(|(name, motions, each)| format!("{motions:6} × {each:6.2} s  {name}"));
    let all = format!("{:6} motions, about {}", missing.len(), duration(seconds));
    console.say(rows.chain([all]).collect::<Vec<_>>().join("\n"))
}

fn duration(seconds: f64) -> String {
    match seconds {
        ..120.0 => format!("{seconds:.0} s"),
        ..7200.0 => format!("{:.0} min", seconds / 60.0),
        _ => format!("{:.1} h", seconds / 3600.0),
    }
}

/// The file that says what a folder's records are of: one model, one evaluator and one data set.
const IDENTITY: &str = "eval.json";

/// What this run is of.
fn identity(plan: &Plan, work: &Work<'_>, real: &Real) -> Value {
    let mut data = Checksum::new(0);
    for (place, prompt) in work.prompts.iter().enumerate() {
        let captions = prompt.captions.join("\n");
        for bytes in [captions.as_bytes(), &prompt.frames.to_le_bytes()] {
            data.add(bytes);
        }
        for number in real.points.row(place) {
            data.add(&number.to_le_bytes());
        }
    }
    let Basis {
        preset,
        given_steps: _,
        noise_steps,
    } = plan.basis;
    json!({
        "model": lamogen_train::fingerprint(work.source.model.network()),
        "evaluator": lamogen_train::fingerprint(work.evaluator.network()),
        "temporal_smoothing": work.source.temporal_smoothing_frames(),
        "text_scale": work.source.model.text_scale(),
        "prompts": work.prompts.len(),
        "data": format!("{:016x}", data.value()),
        "preset": preset.name(),
        "steps": plan.basis.steps(),
        "embedding_steps": plan.basis.steps_of(Preset::Fast),
        "noise_steps": noise_steps,
        "measure": work.measure.name(),
        "generator": concat!("lamogen ", env!("CARGO_PKG_VERSION")),
    })
}

/// Whether the folder is one of this run. One of another, or with records of which nobody knows, is an error.
fn is_begun(options: &Eval, identity: &Value) -> Result<bool, Failure> {
    let path = options.out.join(IDENTITY);
    let input =
        |reason: &dyn Display| Failure::new(Code::Input, format!("{}: {reason}", path.display()));
    let found = match fs::read_to_string(&path) {
        Ok(found) => found,
        Err(error)
            if error.kind() == ErrorKind::NotFound
                && !options.merge
                && (!options.out.exists() || files(&options.out)?.is_empty()) =>
        {
            return Ok(false);
        }
        Err(error) => {
            let hint = "it lies beside the records, in the folder where they were made";
            return Err(input(&error).hint(hint));
        }
    };
    let found: Value = serde_json::from_str(&found).map_err(|error| input(&error))?;
    let differs = |name: &&str| found.get(*name) != identity.get(*name);
    let fields = identity.as_object().into_iter().flatten();
    let mut other: Vec<&str> = fields
        .map(|(name, _)| name.as_str())
        .filter(differs)
        .collect();
    if other.contains(&"prompts") || other.contains(&"measure") {
        // Of more or fewer sentences the motions are others too, and so are those that are measured otherwise.
        other.retain(|name| *name != "data");
    }
    if other.is_empty() {
        return Ok(true);
    }
    let other: Vec<String> = { other.into_iter() }
        .map(|name| {
            let of = |value: &Value| value.get(name).map_or("nothing".into(), Value::to_string);
            format!("{name} is {}, now {}", of(&found), of(identity))
        })
        .collect();
    let message = format!(
        "{}: the records in this folder are of another run: {}",
        path.display(),
        other.join(", ")
    );
    Err(
        Failure::new(Code::Usage, message).hint(match options.merge {
            true => "--merge goes with the options of the run",
            false => "another --out begins anew",
        }),
    )
}

/// Makes a folder for the records of this run.
fn begin(folder: &Path, identity: &Value) -> Result<(), Failure> {
    fs::create_dir_all(folder).map_err(|error| Failure::output(folder, error))?;
    let path = folder.join(IDENTITY);
    let text = format!("{identity:#}\n");
    write_atomically(&path, |file| file.write_all(text.as_bytes()))
        .map_err(|error| Failure::output(&path, error))
}

/// All files of records in a folder, in the order of their names.
fn files(folder: &Path) -> Result<Vec<PathBuf>, Failure> {
    let unreadable = |error| Failure::new(Code::Input, format!("{}: {error}", folder.display()));
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        let name = path
            .file_name()
            .map(|name| name.to_string_lossy().into_owned());
        if name.is_some_and(|name| name.starts_with("records") && name.ends_with(".jsonl")) {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}
