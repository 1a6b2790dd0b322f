//! `lamogen train`.
//!
//! ```text
//!      start.rs: a model to begin with
//!                                │
//!                                ▼
//! data, config, tokenizer ──▶ denoiser.rs ──┐
//!                        └──▶ evaluator.rs ─┴─▶ lamogen_train::run ──▶ watch.rs: bar, plot, pictures
//! ```

mod denoiser;
mod evaluator;
mod start;
mod watch;

use std::collections::HashMap;
use std::fs;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::time::Duration;

use lamogen::model::{Tokenizer, train_tokenizer};
use lamogen::motion::remove_stale_temporaries;
use lamogen::{Device, Licence};
use lamogen_data::{Dataset, LoadOptions, Split};
use lamogen_train::{
    CaptionTokens, RunLength, RunOutcome, RunPlan, TrainError, TrainingConfigError, TrainingTask,
    other_phrasings,
};
use serde_json::{Value, json};

use crate::arguments::Train;
use crate::console::Console;
use crate::dataset;
use crate::failure::{Code, Failure};
use watch::Watch;

/// The vocabulary of CLIP, whose tokenizer is part of the program.
const CLIP_VOCABULARY: usize = 49408;

pub fn run(options: &Train, console: &Console) -> Result<(), Failure> {
    match options.evaluator {
        true => evaluator::run(options, console),
        false => denoiser::run(options, console),
    }
}

/// Trains, or goes on; `look` draws what the network makes.
fn work<T: TrainingTask>(
    (task, motions): (&T, usize),
    identity: &Value,
    device: &Device,
    look: impl FnMut(u64, &T::Network) -> Result<(), Failure>,
    options: &Train,
    console: &Console,
) -> Result<RunOutcome, Failure> {
    let out = &options.out;
    remove_stale_temporaries(&options.out);
    console.notice(format!(
        "Training on {motions} motions. {} gets all that is needed to go on after a stop.",
        out.display()
    ));
    let mut watch = Watch::new(options, console, look)?;
    let ended = lamogen_train::run(task, out, identity, &plan(options), device, &mut watch);
    watch.finish()?;
    Ok(ended?)
}

/// What travels with the weights; of weights that come of others, what those say.
fn metadata(options: &Train, others: Option<&Licence>) -> HashMap<String, String> {
    let name = others.map(|licence| licence.name.clone());
    let attribution = others.and_then(|licence| licence.attribution.clone());
    let texts = [
        ("license", options.license.clone().or(name)),
        ("attribution", options.attribution.clone().or(attribution)),
    ];
    let texts = texts.into_iter();
    texts
        .filter_map(|(name, text)| Some((name.to_owned(), text?)))
        .collect()
}

fn plan(options: &Train) -> RunPlan {
    let minutes = |minutes: f64| Duration::from_secs_f64(60.0 * minutes);
    RunPlan {
        length: match (options.steps, options.minutes) {
            (Some(steps), _) => RunLength::Steps(steps),
            (None, time) => RunLength::Time(minutes(time.expect("clap asks for one of them"))),
        },
        validate_every: options.validate_every,
        checkpoint_every: minutes(options.checkpoint_minutes),
    }
}

/// The data, with all motions that have one of the lengths; longer ones are seen in parts.
fn open(
    options: &Train,
    lengths: RangeInclusive<usize>,
    console: &Console,
) -> Result<Dataset, Failure> {
    let usual = LoadOptions::default();
    let limits = LoadOptions {
        min_frames: *lengths.start(),
        max_frames: usual.max_frames.max(*lengths.end()),
    };
    dataset::open(&options.data, &limits, console)
}

/// The tokens that a network knows.
#[derive(Clone, Copy)]
struct Vocabulary {
    size: usize,
    context_length: usize,
}

/// A file with its name for messages.
type Named = (Vec<u8>, PathBuf);

fn read(path: &Path) -> Result<Named, Failure> {
    let unreadable = |reason| Failure::new(Code::Input, format!("{}: {reason}", path.display()));
    Ok((fs::read(path).map_err(unreadable)?, path.to_owned()))
}

/// The captions as ids: by the tokenizer that is given, CLIP's own, or one that is learned from the captions in all their phrasings and from
/// other sentences.
fn tokens(
    tokenizer: Option<Named>,
    vocabulary: Vocabulary,
    dataset: &Dataset,
    phrasings: usize,
    sentences: &str,
    console: &Console,
) -> Result<CaptionTokens, Failure> {
    let Vocabulary {
        size,
        context_length,
    } = vocabulary;
    let file = match tokenizer {
        Some(file) => Some(file),
        None if size == CLIP_VOCABULARY => None,
        None => {
            let entries = dataset
                .split(Split::Train)
                .flat_map(|entry| &entry.captions);
            let captions: Vec<&str> = entries.map(|caption| caption.text.as_str()).collect();
            let others = captions
                .iter()
                .flat_map(|text| other_phrasings(text, phrasings));
            let others: Vec<String> = others.collect();
            let others = others.iter().map(String::as_str);
            let texts = captions.into_iter().chain(others).chain(sentences.lines());
            let learned = train_tokenizer(texts, size);
            let learned = learned.map_err(|error| Failure::new(Code::Usage, error))?;
            Some((learned, PathBuf::from("the learned tokenizer")))
        }
    };
    let failed = |error| Failure::new(Code::Input, error);
    let (tokenizer, file) = match file {
        None => (Tokenizer::clip(context_length), None),
        Some((json, name)) => {
            let tokenizer = Tokenizer::from_json(&json, name, size, context_length);
            (tokenizer.map_err(failed)?, Some(json))
        }
    };
    let tokens = CaptionTokens::new(dataset, tokenizer, file, phrasings).map_err(failed)?;
    if tokens.cut() > 0 {
        console.notice(format!(
            "{} captions are longer than the {context_length} tokens that the network reads, and are cut",
            tokens.cut()
        ));
    }
    Ok(tokens)
}

/// Says how a run ended; `hint` is what to do with its model, `measured` what is known of it beside losses.
fn ended(
    options: &Train,
    ended: &RunOutcome,
    hint: &str,
    measured: &[Value],
    console: &Console,
) -> Result<(), Failure> {
    let folder = options.out.join("model");
    // Whoever goes on with the model after the command must not do so with half of one.
    let end = match ended.finished {
        true => Ok(()),
        false => Err(Failure::said(Code::Stopped)),
    };
    if console.json {
        console.say(
            json!({
                "run": options.out.to_string_lossy(),
                "finished": ended.finished,
                "step": ended.progress.step,
                "steps": ended.progress.steps,
                "validation_loss": ended.last,
                "best_validation_loss": ended.best,
                "measured": measured,
                "model": ended.finished.then(|| folder.to_string_lossy()),
            })
            .to_string(),
        )?;
        return end;
    }
    let step = ended.progress.step;
    let best = ended.best.map_or(String::new(), |best| {
        format!(", lowest validation loss {best:.4}")
    });
    if !ended.finished {
        console.say(format!(
            "stopped after step {step}{best}; the same command goes on from there"
        ))?;
        return end;
    }
    let run = options.out.display();
    console.say(format!("{run}: after {step} steps{best}\n{hint}"))
}

/// A path as a shell takes it.
fn quoted(path: &Path) -> String {
    let text = path.display().to_string();
    match text.contains(' ') {
        true => format!("\"{text}\""),
        false => text,
    }
}

impl From<TrainError> for Failure {
    fn from(error: TrainError) -> Self {
        match &error {
            TrainError::NoMotions { .. } => Failure::new(Code::Input, error),
            TrainError::NotFinite { .. } => Failure::new(Code::Run, error),
            TrainError::OtherRun { .. } => Failure::new(Code::Usage, error),
            TrainError::Captions { .. } | TrainError::Busy { .. } | TrainError::Sizes { .. } => {
                Failure::new(Code::Usage, error)
            }
            TrainError::Validation { .. } => Failure::new(Code::Run, error),
            TrainError::Checkpoint { .. } => Failure::new(Code::Input, error).hint(
                "a checkpoint before it is in the same folder; without the damaged one, the run goes on from there",
            ),
            _ => Failure::new(Code::Output, error),
        }
    }
}

impl From<TrainingConfigError> for Failure {
    fn from(error: TrainingConfigError) -> Self {
        let code = match &error {
            TrainingConfigError::Io { .. } => Code::Input,
            _ => Code::Usage,
        };
        Failure::new(code, error).hint("`lamogen help recipe` says what a config may have")
    }
}
