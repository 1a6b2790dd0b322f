//! `lamogen eval`: the paper's evidence for a model.
//!
//! ```text
//! options ──plan.rs──▶ cells ──work.rs──▶ records (a line each) ──summary.rs──▶ figures ──report.rs──▶ report.md, report.html
//! ```

mod document;
mod paper;
mod plan;
mod record;
mod report;
mod summary;
mod work;

use std::path::PathBuf;
use std::time::Instant;

use lamogen_data::{Dataset, Entry, LoadOptions};
use lamogen_eval::{Embeddings, Judge};
use serde_json::json;

use crate::arguments::Eval;
use crate::console::Console;
use crate::failure::{Code, Failure};
use crate::source::{Source, device};
use plan::{Basis, Cell, Prompt, Setting, merged};
pub use plan::{Method, Study};
use record::{Store, read};
use summary::{Evidence, cells};
use work::{Work, unjudged};

/// Judged at a time, and generated together.
const TOGETHER: usize = 8;

pub fn run(options: &Eval, console: &Console) -> Result<(), Failure> {
    let device = device(options.source.device)?;
    let source = Source::open(&options.source, console)?;
    let judge = Judge::load(&options.evaluator, &device)
        .map_err(|error| Failure::new(Code::Input, error))?;
    let (prompts, real) = prompts(options, &source, &judge)?;
    let study = Plan::new(options, &source, prompts.len());
    let work = Work {
        source: &source,
        judge: &judge,
        prompts: &prompts,
        device: &device,
    };
    let all: Vec<Cell<'_>> = study.cells().collect();
    if options.dry_run {
        return estimate(&study, &all, &work, console);
    }
    std::fs::create_dir_all(&options.out).map_err(|error| Failure::output(&options.out, error))?;
    check_identity(options, &source, &prompts)?;
    if !options.merge {
        generate(options, &all, &work, console)?;
    }
    let records = read(&files(&options.out)?)?;
    let missing = all
        .iter()
        .filter(|cell| !records.contains_key(&cell.id()))
        .count();
    if missing > 0 {
        console.notice(format!(
            "{missing} of {} motions are still to be made, by other shards or by the same command; the report is of the others",
            all.len()
        ));
    }
    let repeats = 0..options.repeats;
    let texts: Vec<Embeddings> = repeats
        .map(|repeat| {
            let captions: Vec<&str> = prompts.iter().map(|p| p.caption(repeat)).collect();
            judge.texts(&captions).map_err(unjudged)
        })
        .collect::<Result<_, _>>()?;
    let evidence = Evidence {
        records: &records,
        prompts: &prompts,
        texts: &texts,
        real: &real,
        repeats: options.repeats,
    };
    let report = report::Report::new(&study, &evidence, &work, missing).map_err(unjudged)?;
    let paths = report.write(&options.out)?;
    match console.json {
        true => console.say(
            json!({
                "motions": all.len() - missing,
                "missing": missing,
                "files": paths.iter().map(|path| path.to_string_lossy()).collect::<Vec<_>>(),
            })
            .to_string(),
        ),
        false => console.say(
            paths
                .iter()
                .map(|path| path.display().to_string())
                .collect::<Vec<_>>()
                .join("\n"),
        ),
    }
}

/// All that is generated.
pub struct Plan {
    pub basis: Basis,
    pub methods: Vec<Setting>,
    /// Each with its rows: a label and a setting.
    pub studies: Vec<(Study, Vec<(String, Setting)>)>,
    /// Of both, each once.
    pub settings: Vec<Setting>,
    pub repeats: u64,
}

impl Plan {
    fn new(options: &Eval, source: &Source, prompts: usize) -> Plan {
        let preset = options
            .preset
            .map_or(source.preset, |preset| preset.preset());
        let basis = Basis {
            preset,
            steps: options.steps.unwrap_or(preset.steps()),
            noise_steps: options.noise_steps,
        };
        let methods = [Method::Text].iter().chain(&options.methods);
        let mut methods: Vec<Setting> = methods
            .map(|&method| basis.method(method, prompts))
            .collect();
        methods.dedup_by(|a, b| a.name == b.name);
        let few = options.study_prompts.min(prompts);
        let studies = options.studies.iter();
        let studies = studies.map(|&study| (study, basis.study(study, few)));
        let studies: Vec<(Study, Vec<(String, Setting)>)> = studies.collect();
        let of_studies = studies
            .iter()
            .flat_map(|(_, rows)| rows.iter().map(|(_, setting)| setting));
        let settings = merged(methods.iter().chain(of_studies).cloned());
        Plan {
            basis,
            methods,
            studies,
            settings,
            repeats: options.repeats,
        }
    }

    /// A setting under the name by which its motions are kept: that of the first that generates the same.
    pub fn generated(&self, setting: &Setting) -> Setting {
        let same = self
            .settings
            .iter()
            .find(|other| other.generates_as(setting));
        let name = same.map_or(&setting.name, |other| &other.name).clone();
        Setting {
            name,
            ..setting.clone()
        }
    }

    fn cells(&self) -> impl Iterator<Item = Cell<'_>> {
        let settings = self.settings.iter();
        settings.flat_map(|setting| cells(setting, self.repeats))
    }
}

/// The sentences, and their motions where the evaluator sees them.
fn prompts(
    options: &Eval,
    source: &Source,
    judge: &Judge,
) -> Result<(Vec<Prompt>, Embeddings), Failure> {
    use lamogen::model::Denoiser;
    let data = Dataset::open(&options.data, &LoadOptions::default(), &mut |_| ())?;
    let network = source.model.network();
    let longest = network
        .max_frames()
        .min(judge.evaluator().config().max_motion_length);
    let lengths = network.min_frames()..=longest;
    let entries: Vec<&Entry> = data
        .split(options.split)
        .filter(|entry| !entry.mirror && lengths.contains(&entry.frames))
        .collect();
    // Some of them are from all over the data, which may be sorted.
    let all = entries.len();
    let wanted = options.prompts.unwrap_or(all).min(all);
    let entries: Vec<&Entry> = (0..wanted)
        .map(|place| entries[place * all / wanted])
        .collect();
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
    let features = entries.iter().map(|entry| {
        let mut rows = Vec::new();
        data.features(entry, 0..entry.frames, &mut rows);
        rows
    });
    let real = judge
        .motions(&features.collect::<Vec<_>>())
        .map_err(unjudged)?;
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
    let name = match options.shard {
        None => "records.jsonl".into(),
        Some((part, parts)) => format!("records-{part}-of-{parts}.jsonl"),
    };
    let mut store = Store::open(&options.out.join(name))?;
    let (part, parts) = options.shard.unwrap_or((1, 1));
    // Whole groups, so that a group is the same with and without shards, and with it the last bits of its numbers.
    let groups: Vec<&[Cell<'_>]> = all
        .chunk_by(|a, b| a.setting.name == b.setting.name)
        .flat_map(|setting| setting.chunks(TOGETHER))
        .collect();
    let own = groups
        .into_iter()
        .enumerate()
        .filter(|(place, _)| place % parts == part - 1);
    let open: Vec<Vec<Cell<'_>>> = own
        .map(|(_, group)| {
            group
                .iter()
                .filter(|cell| !store.has(&cell.id()))
                .copied()
                .collect()
        })
        .filter(|group: &Vec<Cell<'_>>| !group.is_empty())
        .collect();
    let bar = console.bar("motions");
    bar.set_length(open.iter().map(Vec::len).sum::<usize>() as u64);
    for group in &open {
        bar.set_message(group[0].setting.name.clone());
        for record in work.records(group)? {
            store.add(record)?;
        }
        bar.inc(group.len() as u64);
    }
    bar.finish_and_clear();
    Ok(())
}

/// Says what there is to do, and how long it takes by the first motions of each setting's kind.
fn estimate(
    plan: &Plan,
    all: &[Cell<'_>],
    work: &Work<'_>,
    console: &Console,
) -> Result<(), Failure> {
    let mut lines = Vec::new();
    let mut seconds = 0.0;
    for setting in &plan.settings {
        let of_setting: Vec<Cell<'_>> = all
            .iter()
            .filter(|cell| cell.setting.name == setting.name)
            .copied()
            .collect();
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
            json!({ "motions": all.len(), "seconds": seconds, "settings": settings.collect::<Vec<_>>() }).to_string(),
        );
    }
    let rows = lines
        .iter()
        .map(|(name, motions, each)| format!("{motions:6} × {each:6.2} s  {name}"));
    console.say(format!(
        "{}\n{:6} motions, about {}",
        rows.collect::<Vec<_>>().join("\n"),
        all.len(),
        duration(seconds)
    ))
}

fn duration(seconds: f64) -> String {
    match seconds {
        ..120.0 => format!("{seconds:.0} s"),
        ..7200.0 => format!("{:.0} min", seconds / 60.0),
        _ => format!("{:.1} h", seconds / 3600.0),
    }
}

/// A folder's records are of one model on one data set.
fn check_identity(options: &Eval, source: &Source, prompts: &[Prompt]) -> Result<(), Failure> {
    let path = options.out.join("eval.json");
    let texts = prompts.iter().flat_map(|prompt| &prompt.captions);
    let identity = json!({
        "model": lamogen_train::fingerprint(source.model.network()),
        "coherence": source.coherence_frames(),
        "prompts": { "number": prompts.len(), "captions": texts.collect::<Vec<_>>() },
        "preset": options.preset.map(|preset| preset.name()),
        "steps": options.steps,
        "noise_steps": options.noise_steps,
    });
    let text = identity.to_string();
    match std::fs::read_to_string(&path) {
        Ok(found) if found == text => Ok(()),
        Ok(_) => Err(Failure::new(
            Code::Usage,
            format!(
                "{}: the records in this folder are of another model, other sentences or other options",
                path.display()
            ),
        )
        .hint("another --out begins anew")),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            lamogen::motion::write_atomically(&path, |file| {
                std::io::Write::write_all(file, text.as_bytes())
            })
            .map_err(|error| Failure::output(&path, error))
        }
        Err(error) => Err(Failure::new(Code::Input, format!("{}: {error}", path.display()))),
    }
}

/// All files of records in a folder, in the order of their names.
fn files(folder: &std::path::Path) -> Result<Vec<PathBuf>, Failure> {
    let unreadable = |error| Failure::new(Code::Input, format!("{}: {error}", folder.display()));
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(unreadable)? {
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
