//! `lamogen eval`: evaluates a model by the experiments of the paper.
//!
//! ```text
//! options ──plan.rs──▶ planned motions ──runner.rs──▶ records (a line each) ──summary.rs──▶ figures ──report.rs──▶ report
//!                 measure.rs: on a BVH ─┘                   side_effects.rs ─┘             pictures.rs ─┘
//! ```

mod document;
mod measure;
mod paper;
mod pictures;
mod plan;
mod record;
mod report;
mod runner;
mod side_effects;
mod summary;

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

use crate::arguments::EvalArguments;
use crate::console::Console;
use crate::dataset;
use crate::failure::{Failure, FailureCode};
use crate::source::{ModelSource, open_device};
pub use measure::MeasurementTarget;
use plan::{EvalPlan, EvalPrompt, PlanDefaults, PlannedMotion, PromptSelection};
pub use plan::{Method, Study};
use record::{BodyMeasurements, MotionOutcome, RecordFile, RecordKey, read_records};
use runner::{EvalRunner, RealMotions, evaluation_failure};
use summary::EvalData;

/// The number of motions that are generated and measured together.
const BATCH_SIZE: usize = 8;

/// Runs `lamogen eval`.
pub fn run(options: &EvalArguments, console: &Console) -> Result<(), Failure> {
    if options.out.exists() && !options.out.is_dir() {
        let reason = "expected a folder, found a file";
        return Err(Failure::output(&options.out, reason));
    }
    remove_stale_temporaries(&options.out);
    let device = open_device(options.source.device)?;
    let source = ModelSource::open(&options.source, console)?;
    let evaluator = Evaluator::load(&options.evaluator, &device).map_err(|error| {
        Failure::new(FailureCode::Input, error)
            .hint("lamogen train --evaluator makes one: its folder is best")
    })?;
    let (prompts, real) = load_prompts(options, &source, &evaluator, console)?;
    let plan = EvalPlan::new(options, source.model.preset(), prompts.len());
    let runner = EvalRunner {
        source: &source,
        evaluator: &evaluator,
        prompts: &prompts,
        device: &device,
        measure: options.measure,
    };
    let all: Vec<PlannedMotion<'_>> = plan.planned_motions().collect();
    // All sentences are checked before the first motion is generated.
    runner.check(&all)?;
    let texts = embed_captions(&runner, options.repeats)?;
    let identity = run_identity(&plan, &runner, &real);
    let is_begun = is_begun(options, &identity)?;
    if options.dry_run {
        let records = match is_begun {
            true => read_records(&record_files(&options.out)?)?,
            false => HashMap::new(),
        };
        return print_estimate(&plan, &missing_motions(&all, &records), &runner, console);
    }
    if !is_begun {
        begin_folder(&options.out, &identity)?;
    }
    if !options.merge {
        generate_missing(options, &all, &runner, console)?;
    }
    let records = read_records(&record_files(&options.out)?)?;
    let missing = missing_motions(&all, &records).len();
    let mut paths = Vec::new();
    if missing > 0 && options.shard.is_some() {
        console.notice(format!(
            "{missing} of {} motions are for other shards; --merge writes the report of what there is",
            all.len()
        ));
    } else {
        let data = EvalData {
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
        let report =
            report::Report::new(&plan, &data, &runner, missing).map_err(evaluation_failure)?;
        paths = report.write(&options.out)?;
    }
    let paths = paths.iter().map(|path| path.display().to_string());
    let paths: Vec<String> = paths.collect();
    let done = all.len() - missing;
    console.print(match (console.json, paths.is_empty()) {
        (true, _) => json!({ "motions": done, "missing": missing, "files": paths }).to_string(),
        (false, true) => format!("{done} of {} motions", all.len()),
        (false, false) => paths.join("\n"),
    })
}

/// Returns the planned motions without a record.
fn missing_motions<'a>(
    all: &[PlannedMotion<'a>],
    records: &HashMap<RecordKey, MotionOutcome>,
) -> Vec<PlannedMotion<'a>> {
    let missing = all
        .iter()
        .filter(|planned| !records.contains_key(&planned.key()));
    missing.copied().collect()
}

/// Returns the evaluator's embeddings of the captions of every repeat.
fn embed_captions(runner: &EvalRunner<'_>, repeats: u64) -> Result<Vec<Embeddings>, Failure> {
    let embed_repeat = |repeat| {
        let captions = runner.prompts.iter().map(|prompt| prompt.caption(repeat));
        let captions: Vec<&str> = captions.collect();
        runner.evaluator.texts(&captions)
    };
    let texts = (0..repeats).map(embed_repeat).collect::<Result<_, _>>();
    texts.map_err(|error| Failure::new(FailureCode::Input, error))
}

/// Loads the prompts, and embeds and measures the real motions of these prompts.
fn load_prompts(
    options: &EvalArguments,
    source: &ModelSource,
    evaluator: &Evaluator,
    console: &Console,
) -> Result<(Vec<EvalPrompt>, RealMotions), Failure> {
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
    let places = PromptSelection::spread(wanted, entries.len()).iter();
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
        return Err(Failure::new(FailureCode::Input, message));
    }
    let measure = |entry: &&Entry| {
        let motion = data.motion(entry).map_err(|error| error.to_string())?;
        let measured = options.measure.measured_motion(&motion)?;
        Ok((measured.features(), measured.body()))
    };
    let measurements: Result<(Vec<Vec<f32>>, Vec<BodyMeasurements>), String> =
        entries.iter().map(measure).collect();
    let (features, bodies) =
        measurements.map_err(|error| Failure::new(FailureCode::Input, error))?;
    let real = RealMotions {
        points: evaluator.motions(&features).map_err(evaluation_failure)?,
        bodies,
    };
    let prompts = entries.iter().map(|entry| EvalPrompt {
        captions: entry
            .captions
            .iter()
            .map(|caption| caption.text.clone())
            .collect(),
        frames: entry.frames,
    });
    Ok((prompts.collect(), real))
}

/// Generates and measures the motions of this shard that have no record yet.
fn generate_missing(
    options: &EvalArguments,
    all: &[PlannedMotion<'_>],
    runner: &EvalRunner<'_>,
    console: &Console,
) -> Result<(), Failure> {
    let (part, parts) = options.shard.unwrap_or((1, 1));
    let name = match parts {
        1 => "records.jsonl".into(),
        _ => format!("records-{part}-of-{parts}.jsonl"),
    };
    let mut record_file = RecordFile::open(&options.out.join(name))?;
    let records = read_records(&record_files(&options.out)?)?;
    // A shard gets whole groups. The groups are then the same with and without shards, and so are the last bits of the
    // numbers.
    let settings = all.chunk_by(|a, b| a.setting.name == b.setting.name);
    let groups = settings.flat_map(|setting| setting.chunks(BATCH_SIZE));
    let groups_of_shard = groups.skip(part - 1).step_by(parts);
    let pending = groups_of_shard.map(|group| missing_motions(group, &records));
    let pending: Vec<Vec<PlannedMotion<'_>>> = pending.filter(|group| !group.is_empty()).collect();
    let bar = console.progress_bar("motions");
    bar.set_length(pending.iter().map(Vec::len).sum::<usize>() as u64);
    for group in &pending {
        bar.set_message(group[0].setting.name.clone());
        for record in runner.records(group)? {
            record_file.add(&record)?;
        }
        bar.inc(group.len() as u64);
    }
    bar.finish_and_clear();
    Ok(())
}

/// Prints how many motions are missing, and an estimate of the time to generate them. The estimate comes from generating
/// the first motions of each setting.
fn print_estimate(
    plan: &EvalPlan,
    missing: &[PlannedMotion<'_>],
    runner: &EvalRunner<'_>,
    console: &Console,
) -> Result<(), Failure> {
    let mut lines = Vec::new();
    let mut seconds = 0.0;
    for setting in &plan.settings {
        let motions = missing.iter();
        let motions = motions.filter(|planned| planned.setting.name == setting.name);
        let motions: Vec<PlannedMotion<'_>> = motions.copied().collect();
        if motions.is_empty() {
            continue;
        }
        let first = &motions[..BATCH_SIZE.min(motions.len())];
        let start = Instant::now();
        runner.records(first)?;
        let each = start.elapsed().as_secs_f64() / first.len() as f64;
        seconds += each * motions.len() as f64;
        lines.push((setting.name.clone(), motions.len(), each));
    }
    if console.json {
        let settings = lines.iter().map(|(name, motions, each)| {
            json!({ "setting": name, "motions": motions, "seconds_each": each })
        });
        return console.print(
            json!({ "motions": missing.len(), "seconds": seconds, "settings": settings.collect::<Vec<_>>() }).to_string(),
        );
    }
    let rows = lines
        .iter()
        .map(|(name, motions, each)| format!("{motions:6} × {each:6.2} s  {name}"));
    let all = format!(
        "{:6} motions, about {}",
        missing.len(),
        format_duration(seconds)
    );
    console.print(rows.chain([all]).collect::<Vec<_>>().join("\n"))
}

/// Formats a duration in seconds, minutes or hours.
fn format_duration(seconds: f64) -> String {
    match seconds {
        ..120.0 => format!("{seconds:.0} s"),
        ..7200.0 => format!("{:.0} min", seconds / 60.0),
        _ => format!("{:.1} h", seconds / 3600.0),
    }
}

/// The file with the identity of the run that the records of a folder belong to.
const IDENTITY: &str = "eval.json";

/// Returns the identity of a run: the model, the evaluator, the data set and the options.
fn run_identity(plan: &EvalPlan, runner: &EvalRunner<'_>, real: &RealMotions) -> Value {
    let mut data = Checksum::new(0);
    for (place, prompt) in runner.prompts.iter().enumerate() {
        let captions = prompt.captions.join("\n");
        for bytes in [captions.as_bytes(), &prompt.frames.to_le_bytes()] {
            data.add(bytes);
        }
        for number in real.points.row(place) {
            data.add(&number.to_le_bytes());
        }
    }
    let PlanDefaults {
        preset,
        given_steps: _,
        noise_steps,
    } = plan.defaults;
    json!({
        "model": lamogen_train::fingerprint(runner.source.model.network()),
        "evaluator": lamogen_train::fingerprint(runner.evaluator.network()),
        "temporal_smoothing": runner.source.temporal_smoothing_frames(),
        "text_scale": runner.source.model.text_scale(),
        "prompts": runner.prompts.len(),
        "data": format!("{:016x}", data.value()),
        "preset": preset.name(),
        "steps": plan.defaults.steps(),
        "embedding_steps": plan.defaults.steps_of(Preset::Fast),
        "noise_steps": noise_steps,
        "measure": runner.measure.name(),
        "generator": concat!("lamogen ", env!("CARGO_PKG_VERSION")),
    })
}

/// Whether the folder has records of this run. A folder with records of another run, or with records of an unknown run,
/// is an error.
fn is_begun(options: &EvalArguments, identity: &Value) -> Result<bool, Failure> {
    let path = options.out.join(IDENTITY);
    let input = |reason: &dyn Display| {
        Failure::new(FailureCode::Input, format!("{}: {reason}", path.display()))
    };
    let found = match fs::read_to_string(&path) {
        Ok(found) => found,
        Err(error)
            if error.kind() == ErrorKind::NotFound
                && !options.merge
                && (!options.out.exists() || record_files(&options.out)?.is_empty()) =>
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
        // The checksum of the data depends on the number of sentences and on how the real motions are measured, so it
        // is not listed beside these.
        other.retain(|name| *name != "data");
    }
    if other.is_empty() {
        return Ok(true);
    }
    let other: Vec<String> = { other.into_iter() }
        .map(|name| {
            let text = |value: &Value| value.get(name).map_or("nothing".into(), Value::to_string);
            format!("{name} is {}, now {}", text(&found), text(identity))
        })
        .collect();
    let message = format!(
        "{}: the records in this folder are of another run: {}",
        path.display(),
        other.join(", ")
    );
    Err(
        Failure::new(FailureCode::Usage, message).hint(match options.merge {
            true => "--merge goes with the options of the run",
            false => "another --out begins anew",
        }),
    )
}

/// Makes a folder for the records of this run, with the file of its identity.
fn begin_folder(folder: &Path, identity: &Value) -> Result<(), Failure> {
    fs::create_dir_all(folder).map_err(|error| Failure::output(folder, error))?;
    let path = folder.join(IDENTITY);
    let text = format!("{identity:#}\n");
    write_atomically(&path, |file| file.write_all(text.as_bytes()))
        .map_err(|error| Failure::output(&path, error))
}

/// Returns all record files in a folder, in the order of their names.
fn record_files(folder: &Path) -> Result<Vec<PathBuf>, Failure> {
    let unreadable =
        |error| Failure::new(FailureCode::Input, format!("{}: {error}", folder.display()));
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
