//! `lamogen batch`: many requests, stopped and gone on with at will.
//!
//! ```text
//! requests.jsonl ──read──▶ lines ──shard──▶ items ──finished?──▶ pending ──checked──▶ groups of motions
//!                                                    skipped ◀──┘                          │
//!                            id.glb, … and last id.json: this motion is finished ◀─────────┘
//! ```

mod line;

use std::collections::HashMap;
use std::io::ErrorKind;
use std::path::Path;
use std::time::Instant;

use lamogen::motion::remove_stale_temporaries;
use lamogen::{Generation, Request};
use serde_json::{Value, json};

use crate::arguments::Batch;
use crate::console::Console;
use crate::each::generate_each;
use crate::failure::{Code, Failure};
use crate::generate::facts;
use crate::opened::STANDARD_INPUT;
use crate::output::{Format, Output};
use crate::scene::Scene;
use crate::source::Source;
use line::Item;

/// Wrong lines that are named.
const NAMED: usize = 10;

pub fn run(options: &Batch, console: &Console) -> Result<(), Failure> {
    let mut items = items(options, console)?;
    for unused in options.writing.unused(&options.format) {
        console.notice(unused);
    }
    std::fs::create_dir_all(&options.out)
        .and_then(|()| tempfile::tempfile_in(&options.out).map(drop))
        .map_err(|error| Failure::output(&options.out, error))?;
    remove_stale_temporaries(&options.out);
    let mut source = Source::open(&options.source, console)?;
    let batch_size = options.batch_size.map(|size| size as usize);
    let batch_size = batch_size.unwrap_or(source.model.batch_size());
    source.model = source.model.with_batch_size(batch_size);
    let work = Work {
        options,
        source: &source,
        console,
    };
    let mut known = HashMap::new();
    for item in &mut items {
        item.note_like(&mut known);
    }
    let (finished, mut pending): (Vec<Item>, Vec<Item>) =
        items.into_iter().partition(|item| work.is_finished(item));
    work.prepare(&mut pending)?;
    work.check(&pending)?;

    let start = Instant::now();
    let bar = console.bar("motions");
    bar.set_length(pending.len() as u64);
    let mut failed: Vec<(String, String)> = Vec::new();
    sort_within_windows(&mut pending, batch_size);
    for items in pending.chunks(batch_size) {
        work.generate(items, &bar, &mut failed)?;
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
        true => console.say(summary.to_string())?,
        false => {
            let each = match made {
                0 => String::new(),
                made => format!(" in {seconds:.1} s, {:.2} s each", seconds / made as f64),
            };
            console.say(format!(
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
            Err(Failure::new(Code::Partly, reasons.join("\n")))
        }
    }
}

/// Puts motions that run together well beside each other: those with goals or without, of nearly the same length. Only within windows, so that
/// a batch that is stopped has finished the first lines of its file and not some of all.
fn sort_within_windows(items: &mut [Item], batch_size: usize) {
    /// Batches in a window.
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

/// The file of requests, for messages.
fn requests_name(options: &Batch) -> &Path {
    match options.requests == Path::new(STANDARD_INPUT) {
        true => Path::new("standard input"),
        false => &options.requests,
    }
}

/// The lines of the file that are this part's, in their order.
fn items(options: &Batch, console: &Console) -> Result<Vec<Item>, Failure> {
    let path = requests_name(options);
    let text = match options.requests == Path::new(STANDARD_INPUT) {
        true => std::io::read_to_string(std::io::stdin()),
        false => std::fs::read_to_string(&options.requests),
    };
    let text =
        text.map_err(|error| Failure::new(Code::Input, format!("{}: {error}", path.display())))?;
    let endings: Vec<&str> = { formats(options).chain([Format::Json]) }
        .map(Format::ending)
        .collect();
    let (items, wrong) = line::items(&text, &endings);
    refuse(path, wrong)?;
    if items.is_empty() {
        console.notice(format!(
            "{}: expected requests, one JSON object a line; found no line that is not blank",
            path.display()
        ));
    }
    let (part, parts) = options.shard.unwrap_or((1, 1));
    let mine = items
        .into_iter()
        .enumerate()
        .filter(|(place, _)| place % parts == part - 1);
    Ok(mine.map(|(_, item)| item).collect())
}

/// Formats beside the JSON, which is always written, and last.
fn formats(options: &Batch) -> impl Iterator<Item = Format> + '_ {
    let formats = options.format.iter().copied();
    formats.filter(|format| *format != Format::Json)
}

/// Names the lines that are no requests or make no sense. Nothing has been run.
fn refuse(path: &Path, mut wrong: Vec<(usize, String)>) -> Result<(), Failure> {
    if wrong.is_empty() {
        return Ok(());
    }
    let more = wrong.len().saturating_sub(NAMED);
    wrong.truncate(NAMED);
    let mut lines: Vec<String> = wrong
        .into_iter()
        .map(|(number, reason)| format!("{}, line {number}: {reason}", path.display()))
        .collect();
    if more > 0 {
        lines.push(format!("and {more} more lines"));
    }
    Err(Failure::new(Code::Usage, lines.join("\n")).hint("nothing was run"))
}

struct Work<'a> {
    options: &'a Batch,
    source: &'a Source,
    console: &'a Console,
}

impl Work<'_> {
    fn request(&self, item: &Item) -> Request {
        item.request(&self.options.pass, self.source.model.preset())
    }

    /// What makes a motion this one: a finished file that says the same need not be made again.
    fn identity(&self, item: &Item) -> Value {
        let pass = item.pass(&self.options.pass);
        let formats = self.options.format.iter().map(|format| format.ending());
        let writing = &self.options.writing;
        json!({
            "request": item.line,
            "model": self.source.name,
            "weights": self.source.checksum(),
            "like": item.like_checksum(),
            "preset": pass.preset.map(|name| name.preset().name()),
            "steps": pass.steps,
            "emphasis": pass.emphasis,
            "body": pass.body.map(|body| body.name()),
            "temporal_smoothing": self.source.temporal_smoothing_frames(),
            "text_scale": self.source.model.text_scale(),
            "stand_in": self.source.model.stand_in(&item.line.prompt),
            "formats": formats.collect::<Vec<_>>(),
            "fps": writing.fps,
            "bvh_unit": writing.bvh_unit.to_string(),
            "bvh_names": writing.bvh_names.name(),
            "gif_width": writing.gif_width,
            "generator": concat!("lamogen ", env!("CARGO_PKG_VERSION")),
        })
    }

    fn output(&self, item: &Item, format: Format) -> Output {
        let name = format!("{}.{}", item.id, format.ending());
        Output {
            path: self.options.out.join(name),
            format,
        }
    }

    fn is_finished(&self, item: &Item) -> bool {
        let record = self.output(item, Format::Json).path;
        // Through JSON numbers lose what they would lose in the file.
        let identity = serde_json::from_str::<Value>(&self.identity(item).to_string());
        let found = read_identity(&record);
        found.is_some()
            && found == identity.ok()
            && formats(self.options).all(|format| {
                self.output(item, format)
                    .path
                    .metadata()
                    .is_ok_and(|file| file.len() > 0)
            })
    }

    /// Reads what requests refer to, before anything is run.
    fn prepare(&self, items: &mut [Item]) -> Result<(), Failure> {
        let device = self.source.device();
        let wrong = items.iter_mut().filter_map(|item| {
            let reason = item.prepare(&device).err()?;
            Some((item.number, reason))
        });
        refuse(requests_name(self.options), wrong.collect())
    }

    /// Refuses requests that make no sense, before anything is run.
    fn check(&self, items: &[Item]) -> Result<(), Failure> {
        let wrong = items.iter().filter_map(|item| {
            let reason = self.source.model.check(&self.request(item)).err()?;
            Some((item.number, reason.to_string()))
        });
        refuse(requests_name(self.options), wrong.collect())
    }

    /// Makes some motions together. One that fails is left out, and the others are made without it.
    fn generate(
        &self,
        items: &[Item],
        bar: &indicatif::ProgressBar,
        failed: &mut Vec<(String, String)>,
    ) -> Result<(), Failure> {
        let requests: Vec<Request> = items.iter().map(|item| self.request(item)).collect();
        let results = generate_each(&self.source.model, &requests, &mut |progress| {
            let share = 100 * progress.done / progress.total.max(1);
            bar.set_message(format!("next {share:3} %"));
        })?;
        for (item, result) in items.iter().zip(results) {
            match result {
                Ok(generation) => self.write(item, generation)?,
                Err(reason) => failed.push((item.id.clone(), reason)),
            }
            bar.inc(1);
        }
        Ok(())
    }

    fn write(&self, item: &Item, generation: Generation) -> Result<(), Failure> {
        let pass = item.pass(&self.options.pass);
        let mut facts = facts(
            &item.line.prompt,
            item.seed(),
            &generation,
            &pass,
            self.source,
        );
        facts.insert("id".into(), item.id.as_str().into());
        facts.insert("batch".into(), self.identity(item));
        let licence = self.source.model.licence();
        let scene = Scene::generated(&item.line.prompt, generation, facts, licence);
        // The JSON says that the motion is finished, so it comes last.
        // An old one would say that of a motion of other options while files of this one are written beside it.
        let record = self.output(item, Format::Json).path;
        match std::fs::remove_file(&record) {
            Err(error) if error.kind() != ErrorKind::NotFound => {
                return Err(Failure::output(&record, error));
            }
            _ => {}
        }
        for format in formats(self.options).chain([Format::Json]) {
            let output = self.output(item, format);
            let quiet = self.console.hushed();
            output.write(&scene, &self.options.writing, &quiet)?;
        }
        Ok(())
    }
}

/// What a finished motion's record says of how it was made; none if it is not there or not whole.
fn read_identity(path: &Path) -> Option<Value> {
    let text = std::fs::read_to_string(path).ok()?;
    let mut record: Value = serde_json::from_str(&text).ok()?;
    Some(record.get_mut("batch")?.take())
}
