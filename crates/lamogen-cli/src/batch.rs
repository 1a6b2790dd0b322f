//! `lamogen batch`: generates the motions of many requests. It can be stopped at any time, and then goes on where it
//! was stopped.
//!
//! ```text
//! requests.jsonl ──read──▶ lines ──shard──▶ items ──finished?──▶ pending ──checked──▶ groups of motions
//!                                                    skipped ◀──┘                          │
//!                            id.glb, … and last id.json: this motion is finished ◀─────────┘
//!                            id-unfinished.glb, …: stretches of a long motion, after a stop ◀┘
//! ```

mod line;

use std::collections::HashMap;
use std::io::ErrorKind;
use std::ops::ControlFlow;
use std::path::Path;
use std::time::Instant;

use lamogen::model::Denoiser;
use lamogen::motion::remove_stale_temporaries;
use lamogen::{Error, Generation, PartialResults, Request};
use serde_json::{Value, json};

use crate::arguments::{BatchArguments, HandsName};
use crate::console::Console;
use crate::failure::{Failure, FailureCode};
use crate::generate::generation_facts;
use crate::motion_file::STANDARD_INPUT;
use crate::output::{OutputFile, OutputFormat};
use crate::scene::Scene;
use crate::signals::{self, StopRequest};
use crate::source::ModelSource;
use crate::unfinished::UnfinishedMotion;
use line::BatchItem;

/// The largest number of wrong lines that an error lists.
const MAX_LISTED: usize = 10;

/// Runs `lamogen batch`.
pub fn run(options: &BatchArguments, console: &Console) -> Result<(), Failure> {
    let stop = signals::stop_on_signals();
    let mut items = read_items(options, console)?;
    options.writing.check(&options.format)?;
    for notice in options.writing.notices(&options.format) {
        console.notice(notice);
    }
    match options.merge {
        true if !options.out.is_dir() => {
            let message = format!(
                "{}: expected the folder of a batch, found none",
                options.out.display()
            );
            return Err(Failure::new(FailureCode::Input, message));
        }
        true => {}
        false => {
            std::fs::create_dir_all(&options.out)
                .and_then(|()| tempfile::tempfile_in(&options.out).map(drop))
                .map_err(|error| Failure::output(&options.out, error))?;
            remove_stale_temporaries(&options.out);
        }
    }
    let mut source = ModelSource::open(&options.source, console)?;
    let batch_size = options.batch_size.map(|size| size as usize);
    let batch_size = batch_size.unwrap_or(source.model.batch_size());
    source.model = source.model.with_batch_size(batch_size);
    let runner = BatchRunner {
        options,
        source: &source,
        console,
        stop,
        character_checksum: { options.writing.onto.onto.as_ref() }
            .and_then(|path| line::file_checksum(path)),
    };
    let mut checksums = HashMap::new();
    for item in &mut items {
        item.compute_checksums(&mut checksums);
    }
    if options.merge {
        return runner.report_missing(&items);
    }
    let (finished, mut pending): (Vec<BatchItem>, Vec<BatchItem>) =
        { items.into_iter() }.partition(|item| runner.missing_part(item).is_none());
    runner.read_files(&mut pending)?;
    runner.check(&pending)?;

    let start = Instant::now();
    let bar = console.progress_bar("motions");
    bar.set_length(pending.len() as u64);
    let mut failed: Vec<(String, String)> = Vec::new();
    sort_within_windows(&mut pending, batch_size);
    let mut done = 0;
    for items in pending.chunks(batch_size) {
        match runner.generate(items, &bar, &mut failed)? {
            ControlFlow::Continue(()) => done += items.len(),
            ControlFlow::Break(kept) => {
                bar.finish_and_clear();
                let made = done + kept.finished - failed.len();
                if made == 0 && kept.stretches == 0 {
                    signals::clean_up_and_exit();
                }
                let message = format!(
                    "stopped; {} of {} motions are finished",
                    finished.len() + made,
                    finished.len() + pending.len()
                );
                return Err(Failure::new(FailureCode::Stopped, message)
                    .hint("the same command makes the others"));
            }
        }
    }
    bar.finish_and_clear();

    let made = pending.len() - failed.len();
    let seconds = start.elapsed().as_secs_f64();
    let failures = failed
        .iter()
        .map(|(id, reason)| json!({ "id": id, "reason": reason }));
    let summary = json!({
        "made": made,
        "finished_before": finished.len(),
        "failed": failures.collect::<Vec<_>>(),
        "seconds": seconds,
        "folder": options.out.to_string_lossy(),
    });
    match console.json {
        true => console.print(summary.to_string())?,
        false => {
            let each = match made {
                0 => String::new(),
                made => format!(" in {seconds:.1} s, {:.2} s each", seconds / made as f64),
            };
            console.print(format!(
                "{made} made{each}; {} finished before; {} failed; {}",
                finished.len(),
                failed.len(),
                options.out.display()
            ))?;
        }
    }
    match failed.is_empty() {
        true => Ok(()),
        false => {
            let reasons: Vec<String> = failed
                .iter()
                .map(|(id, reason)| format!("{id}: {reason}"))
                .collect();
            Err(Failure::new(FailureCode::Partial, reasons.join("\n")))
        }
    }
}

/// Sorts items so that motions that run together well are neighbours: those with goals, those without, and those of
/// similar length. Items are sorted within windows only, so that a command that is stopped has finished the first lines
/// of its file.
fn sort_within_windows(items: &mut [BatchItem], batch_size: usize) {
    /// The number of batches in a window.
    const WINDOW: usize = 16;
    if batch_size > 1 {
        for window in items.chunks_mut(WINDOW * batch_size) {
            window.sort_by(|a, b| {
                let guided = a.is_guided().cmp(&b.is_guided());
                guided.then(a.seconds().total_cmp(&b.seconds()))
            });
        }
    }
}

/// Returns the name of the file of requests for messages.
fn requests_name(options: &BatchArguments) -> &Path {
    match options.requests == Path::new(STANDARD_INPUT) {
        true => Path::new("standard input"),
        false => &options.requests,
    }
}

/// Reads the requests of the file that belong to this shard, in their order.
fn read_items(options: &BatchArguments, console: &Console) -> Result<Vec<BatchItem>, Failure> {
    let path = requests_name(options);
    let text = match options.requests == Path::new(STANDARD_INPUT) {
        true => std::io::read_to_string(std::io::stdin()),
        false => std::fs::read_to_string(&options.requests),
    };
    let text = text.map_err(|error| {
        Failure::new(FailureCode::Input, format!("{}: {error}", path.display()))
    })?;
    let endings: Vec<&str> = { formats(options).chain([OutputFormat::Json]) }
        .map(OutputFormat::ending)
        .collect();
    let (items, wrong) = line::parse_items(&text, &endings);
    reject_lines(path, wrong)?;
    if items.is_empty() {
        console.notice(format!(
            "{}: expected requests, one JSON object a line; found no line that is not blank",
            path.display()
        ));
    }
    for item in &items {
        for notice in item.line.places().notices() {
            console.notice(format!(
                "{}, line {}: {notice}",
                path.display(),
                item.number
            ));
        }
    }
    let (shard, shards) = options.shard.unwrap_or((1, 1));
    let items_of_shard = items
        .into_iter()
        .enumerate()
        .filter(|(place, _)| place % shards == shard - 1);
    Ok(items_of_shard.map(|(_, item)| item).collect())
}

/// Returns the formats to write without JSON, which is always written, and last.
fn formats(options: &BatchArguments) -> impl Iterator<Item = OutputFormat> + '_ {
    let formats = options.format.iter().copied();
    formats.filter(|format| *format != OutputFormat::Json)
}

/// Fails if there are wrong lines, each given by its number and the reason. This is called before anything is
/// generated.
fn reject_lines(path: &Path, mut wrong: Vec<(usize, String)>) -> Result<(), Failure> {
    if wrong.is_empty() {
        return Ok(());
    }
    let more = wrong.len().saturating_sub(MAX_LISTED);
    wrong.truncate(MAX_LISTED);
    let mut lines: Vec<String> = wrong
        .into_iter()
        .map(|(number, reason)| format!("{}, line {number}: {reason}", path.display()))
        .collect();
    if more > 0 {
        lines.push(format!("and {more} more lines"));
    }
    Err(Failure::new(FailureCode::Usage, lines.join("\n")).hint("nothing was run"))
}

/// What was kept of the motions that were being generated when the user stopped the batch.
struct KeptMotions {
    /// The number of motions that were finished.
    finished: usize,
    /// The number of long motions of which some stretches were finished.
    stretches: usize,
}

/// Generates motions and writes their files.
struct BatchRunner<'a> {
    options: &'a BatchArguments,
    source: &'a ModelSource,
    console: &'a Console,
    stop: StopRequest,
    /// The checksum of the file of the character that the motions are put on.
    character_checksum: Option<String>,
}

impl BatchRunner<'_> {
    /// Makes the request of an item.
    fn request(&self, item: &BatchItem) -> Request {
        let root_motion = item.root_motion(self.options.writing.root_motion());
        item.request(&self.options.pass, self.source.model.preset())
            .root_motion(root_motion)
    }

    /// Returns everything that determines the files of a motion. A motion with the same identity in its JSON file is
    /// not generated again.
    fn identity(&self, item: &BatchItem) -> Value {
        let pass = item.pass(&self.options.pass);
        let formats = self.options.format.iter().map(|format| format.ending());
        let writing = &self.options.writing;
        let mut identity = json!({
            "request": item.line,
            "model": self.source.name,
            "weights": self.source.checksum(),
            "like": item.like_checksums(),
            "preset": pass.preset.map(|name| name.preset().name()),
            "steps": pass.steps,
            "emphasis": pass.emphasis,
            "body": pass.body.map(|body| body.name()),
            "loop": pass.is_looped,
            "root_motion": item.root_motion(writing.root_motion()).name(),
            "temporal_smoothing": self.source.temporal_smoothing_frames(),
            "text_scale": self.source.model.text_scale().scale,
            "text_scale_until": self.source.model.text_scale().until,
            "stand_in": item.line.sentences().find_map(|sentence| self.source.model.stand_in(&sentence.prompt)),
            "formats": formats.collect::<Vec<_>>(),
            "fps": writing.fps.unwrap_or(20.0),
            "bvh_unit": writing.bvh_unit.to_string(),
            "bvh_names": writing.bvh_names.name(),
            "gif_width": writing.gif_width,
            "generator": concat!("lamogen ", env!("CARGO_PKG_VERSION")),
        });
        if let Some(checksums) = item.named_checksums() {
            identity["neighbours"] = json!(checksums);
        }
        let method = self.source.model.sampling_method();
        if method != self.source.model.network().sampling_method() {
            identity["sampler"] = method.name().into();
        }
        if let Some(character) = &self.character_checksum {
            let onto = &writing.onto;
            identity["onto"] = json!({
                "character": character,
                "fps": writing.fps,
                "animation_name": onto.animation_name,
                "replace_animations": onto.replace_animations,
                "node": onto.character,
                "names": onto.onto_names,
                "free_feet": onto.free_feet,
                "free_hands": onto.free_hands,
                "relax_hands": onto.hands == HandsName::Relax,
            });
        }
        identity
    }

    /// Returns the file of an item in a format.
    fn output(&self, item: &BatchItem, format: OutputFormat) -> OutputFile {
        let name = format!("{}.{}", item.id, format.ending());
        OutputFile {
            path: self.options.out.join(name),
            format,
        }
    }

    /// Returns what an item lacks of being finished; none if all of its files exist and are of this run.
    fn missing_part(&self, item: &BatchItem) -> Option<String> {
        let record = self.output(item, OutputFormat::Json).path;
        // The numbers take the way through text that those in the file took, so that both are rounded alike.
        let identity = serde_json::from_str::<Value>(&self.identity(item).to_string()).ok()?;
        let name = |path: &Path| {
            path.file_name()
                .map(|name| name.to_string_lossy().into_owned())
        };
        let Some(found) = read_identity(&record) else {
            return Some(format!("{} is not there", name(&record)?));
        };
        if found != identity {
            let fields = identity.as_object().into_iter().flatten();
            let differs = fields.filter(|(key, value)| found.get(key) != Some(value));
            let differs: Vec<&str> = differs.map(|(key, _)| key.as_str()).collect();
            return Some(format!(
                "{} is of another run: other {}",
                name(&record)?,
                differs.join(", ")
            ));
        }
        let mut outputs = formats(self.options).map(|format| self.output(item, format).path);
        let missing = outputs.find(|path| !path.metadata().is_ok_and(|file| file.len() > 0))?;
        Some(format!("{} is not there", name(&missing)?))
    }

    /// Prints how many motions are finished, and fails with those that are not.
    fn report_missing(&self, items: &[BatchItem]) -> Result<(), Failure> {
        let missing = items
            .iter()
            .filter_map(|item| Some((item, self.missing_part(item)?)));
        let missing: Vec<(&BatchItem, String)> = missing.collect();
        let finished = items.len() - missing.len();
        match self.console.json {
            true => {
                let missing = missing.iter().map(|(item, reason)| {
                    json!({ "id": item.id, "line": item.number, "reason": reason })
                });
                self.console.print(
                    json!({
                        "motions": items.len(),
                        "finished": finished,
                        "missing": missing.collect::<Vec<_>>(),
                        "folder": self.options.out.to_string_lossy(),
                    })
                    .to_string(),
                )?;
            }
            false => self.console.print(format!(
                "{finished} of {} motions are finished; {}",
                items.len(),
                self.options.out.display()
            ))?,
        }
        if missing.is_empty() {
            return Ok(());
        }
        let listed = missing.iter().take(MAX_LISTED);
        let mut lines: Vec<String> = listed
            .map(|(item, reason)| format!("line {}, {}: {reason}", item.number, item.id))
            .collect();
        if missing.len() > MAX_LISTED {
            lines.push(format!("and {} more", missing.len() - MAX_LISTED));
        }
        Err(Failure::new(FailureCode::Partial, lines.join("\n"))
            .hint("the same command without --merge makes what is missing"))
    }

    /// Resolves the goals of all items, before anything is generated.
    fn read_files(&self, items: &mut [BatchItem]) -> Result<(), Failure> {
        let device = self.source.device();
        let wrong = items.iter_mut().filter_map(|item| {
            let reason = item.read_files(&device).err()?;
            Some((item.number, reason))
        });
        reject_lines(requests_name(self.options), wrong.collect())
    }

    /// Rejects requests that the model cannot run, before anything is generated.
    fn check(&self, items: &[BatchItem]) -> Result<(), Failure> {
        let wrong = items.iter().filter_map(|item| {
            let reason = self.source.model.check(&self.request(item)).err()?;
            Some((item.number, reason.to_string()))
        });
        reject_lines(requests_name(self.options), wrong.collect())
    }

    /// Generates the motions of some items together, and writes their files. If one fails, the others are generated
    /// without it, and its id and the reason are added to `failed`. If the user stops the batch, the files of what is finished are
    /// written.
    fn generate(
        &self,
        items: &[BatchItem],
        bar: &indicatif::ProgressBar,
        failed: &mut Vec<(String, String)>,
    ) -> Result<ControlFlow<KeptMotions>, Failure> {
        let requests: Vec<Request> = items.iter().map(|item| self.request(item)).collect();
        self.stop.heed(true);
        let results = self.source.model.generate_each(&requests, &mut |progress| {
            let share = 100 * progress.done / progress.total.max(1);
            bar.set_message(format!("next {share:3} %"));
            self.stop.control_flow()
        });
        // A signal while files are written ends the command at once; a motion whose record is not written is made again.
        self.stop.heed(false);
        let results = match results {
            Ok(results) => results,
            Err(Error::Stopped(stopped)) => {
                return Ok(ControlFlow::Break(self.keep(items, stopped.partial)?));
            }
            Err(error) => return Err(error.into()),
        };
        for (item, result) in items.iter().zip(results) {
            match result {
                Ok(generation) => self.write(item, generation)?,
                Err(reason) => failed.push((item.id.clone(), reason.to_string())),
            }
            bar.inc(1);
        }
        Ok(ControlFlow::Continue(()))
    }

    /// Writes the files of what a stop has left of some items.
    fn keep(&self, items: &[BatchItem], partial: PartialResults) -> Result<KeptMotions, Failure> {
        let mut kept = KeptMotions {
            finished: partial.finished.len(),
            stretches: 0,
        };
        for (place, generation) in partial.finished {
            self.write(&items[place], generation)?;
        }
        for unfinished in partial.unfinished {
            let Some(stretches) = unfinished.finished else {
                continue;
            };
            let item = &items[unfinished.request];
            let motion = UnfinishedMotion {
                prompt: &item.line.prompt,
                seed: item.seed(),
                seconds: item.seconds(),
                stretches,
            };
            let outputs: Vec<OutputFile> = self.outputs(item).collect();
            motion.write(&outputs, &self.options.writing, self.source, self.console)?;
            kept.stretches += 1;
        }
        Ok(kept)
    }

    /// Returns the files of an item, with that in JSON last.
    fn outputs(&self, item: &BatchItem) -> impl Iterator<Item = OutputFile> {
        let formats = formats(self.options).chain([OutputFormat::Json]);
        formats.map(|format| self.output(item, format))
    }

    /// Writes the files of a motion.
    fn write(&self, item: &BatchItem, generation: Generation) -> Result<(), Failure> {
        let pass = item.pass(&self.options.pass);
        let mut facts = generation_facts(item.seed(), &generation, &pass, self.source);
        facts.insert("id".into(), item.id.as_str().into());
        facts.insert("batch".into(), self.identity(item));
        let scene = Scene::from_generation(generation, facts);
        // The JSON file marks the motion as finished, so it is written last. An old one from a run with other options
        // is removed first, since it would mark the motion as finished while its files are being written.
        let record = self.output(item, OutputFormat::Json).path;
        remove(&record)?;
        for output in self.outputs(item) {
            let quiet = self.console.without_notices();
            output.write(&scene, &self.options.writing, &quiet)?;
        }
        // What an earlier run has left of this motion is superseded.
        for output in self.outputs(item) {
            remove(&output.unfinished().path)?;
        }
        Ok(())
    }
}

/// Removes a file if it exists.
fn remove(path: &Path) -> Result<(), Failure> {
    match std::fs::remove_file(path) {
        Err(error) if error.kind() != ErrorKind::NotFound => Err(Failure::output(path, error)),
        _ => Ok(()),
    }
}

/// Reads the identity in the JSON file of a motion. Returns `None` if the file does not exist or is incomplete.
fn read_identity(path: &Path) -> Option<Value> {
    let text = std::fs::read_to_string(path).ok()?;
    let mut record: Value = serde_json::from_str(&text).ok()?;
    Some(record.get_mut("batch")?.take())
}
