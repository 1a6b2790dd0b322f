//! `lamogen train`: trains a denoiser or an evaluator.
//!
//! ```text
//!      start.rs: a model to begin with
//!                                │
//!                                ▼
//! data, config, tokenizer ──▶ denoiser.rs ──┐
//!                        └──▶ evaluator.rs ─┴─▶ lamogen_train::run ──▶ monitor.rs: bar, plot, pictures
//! ```

mod denoiser;
mod evaluator;
mod monitor;
mod start;

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

use crate::arguments::TrainArguments;
use crate::console::Console;
use crate::dataset;
use crate::failure::{Failure, FailureCode};
use monitor::TrainingMonitor;

/// The size of CLIP's vocabulary. CLIP's tokenizer is part of the program.
const CLIP_VOCABULARY: usize = 49408;

/// Runs `lamogen train`.
pub fn run(options: &TrainArguments, console: &Console) -> Result<(), Failure> {
    match options.evaluator {
        true => evaluator::run(options, console),
        false => denoiser::run(options, console),
    }
}

/// Runs a training, or continues one that was stopped. `motions` is the number of motions to train on. `draw_samples`
/// draws motions that the network generates.
fn run_training<T: TrainingTask>(
    (task, motions): (&T, usize),
    identity: &Value,
    device: &Device,
    draw_samples: impl FnMut(u64, &T::Network) -> Result<(), Failure>,
    options: &TrainArguments,
    console: &Console,
) -> Result<RunOutcome, Failure> {
    let out = &options.out;
    remove_stale_temporaries(&options.out);
    console.notice(format!(
        "Training on {motions} motions. {} gets all that is needed to go on after a stop.",
        out.display()
    ));
    let mut monitor = TrainingMonitor::new(options, console, draw_samples)?;
    let plan = run_plan(options);
    let outcome = lamogen_train::run(task, out, identity, &plan, device, &mut monitor);
    monitor.finish()?;
    Ok(outcome?)
}

/// Returns the licence and the attribution that are written into the weight file. If the arguments state none, those of
/// the model that the training begins with are taken.
fn metadata(options: &TrainArguments, start_licence: Option<&Licence>) -> HashMap<String, String> {
    let name = start_licence.map(|licence| licence.name.clone());
    let attribution = start_licence.and_then(|licence| licence.attribution.clone());
    let texts = [
        ("license", options.license.clone().or(name)),
        ("attribution", options.attribution.clone().or(attribution)),
    ];
    let texts = texts.into_iter();
    texts
        .filter_map(|(name, text)| Some((name.to_owned(), text?)))
        .collect()
}

/// Returns the length of the run, and the times of validation and checkpoints.
fn run_plan(options: &TrainArguments) -> RunPlan {
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

/// Opens the data set with all motions that are at least as long as the shortest of the lengths. Motions that are
/// longer than the network allows are trained on in parts.
fn open_dataset(
    options: &TrainArguments,
    lengths: RangeInclusive<usize>,
    console: &Console,
) -> Result<Dataset, Failure> {
    let defaults = LoadOptions::default();
    let limits = LoadOptions {
        min_frames: *lengths.start(),
        max_frames: defaults.max_frames.max(*lengths.end()),
    };
    dataset::open(&options.data, &limits, console)
}

/// The token embeddings of a network.
#[derive(Clone, Copy)]
struct Vocabulary {
    /// The number of different tokens.
    size: usize,
    /// The number of tokens that the network reads.
    context_length: usize,
}

/// The content of a file, and its name for messages.
type NamedFile = (Vec<u8>, PathBuf);

/// Reads a file.
fn read_file(path: &Path) -> Result<NamedFile, Failure> {
    let unreadable =
        |reason| Failure::new(FailureCode::Input, format!("{}: {reason}", path.display()));
    Ok((fs::read(path).map_err(unreadable)?, path.to_owned()))
}

/// Encodes the captions as token ids.
///
/// The tokenizer is the given one, CLIP's own for a network with CLIP's vocabulary, or else one that is trained on the
/// captions in all their phrasings and on `sentences`, one a line.
fn caption_tokens(
    tokenizer: Option<NamedFile>,
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
            let rephrased = captions
                .iter()
                .flat_map(|text| other_phrasings(text, phrasings));
            let rephrased: Vec<String> = rephrased.collect();
            let rephrased = rephrased.iter().map(String::as_str);
            let texts = captions.into_iter().chain(rephrased);
            let texts = texts.chain(sentences.lines());
            let learned = train_tokenizer(texts, size);
            let learned = learned.map_err(|error| Failure::new(FailureCode::Usage, error))?;
            Some((learned, PathBuf::from("the learned tokenizer")))
        }
    };
    let failed = |error| Failure::new(FailureCode::Input, error);
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

/// Prints the outcome of a run. `hint` says how to use the model, and `measured` has measurements of it beside the
/// losses.
fn report_outcome(
    options: &TrainArguments,
    outcome: &RunOutcome,
    hint: &str,
    measured: &[Value],
    console: &Console,
) -> Result<(), Failure> {
    let folder = options.out.join("model");
    // A stopped training is a failure, so that scripts do not go on with an unfinished model.
    let result = match outcome.finished {
        true => Ok(()),
        false => Err(Failure::silent(FailureCode::Stopped)),
    };
    if console.json {
        console.print(
            json!({
                "run": options.out.to_string_lossy(),
                "finished": outcome.finished,
                "step": outcome.progress.step,
                "steps": outcome.progress.steps,
                "validation_loss": outcome.last,
                "best_validation_loss": outcome.best,
                "measured": measured,
                "model": outcome.finished.then(|| folder.to_string_lossy()),
            })
            .to_string(),
        )?;
        return result;
    }
    let step = outcome.progress.step;
    let best = outcome.best.map_or(String::new(), |best| {
        format!(", lowest validation loss {best:.4}")
    });
    if !outcome.finished {
        console.print(format!(
            "stopped after step {step}{best}; the same command goes on from there"
        ))?;
        return result;
    }
    let run = options.out.display();
    console.print(format!("{run}: after {step} steps{best}\n{hint}"))
}

/// Quotes a path for a shell if it contains a space.
fn shell_quoted(path: &Path) -> String {
    let text = path.display().to_string();
    match text.contains(' ') {
        true => format!("\"{text}\""),
        false => text,
    }
}

impl From<TrainError> for Failure {
    fn from(error: TrainError) -> Self {
        match &error {
            TrainError::NoMotions { .. } => Failure::new(FailureCode::Input, error),
            TrainError::NotFinite { .. } => Failure::new(FailureCode::Run, error),
            TrainError::OtherRun { .. } => Failure::new(FailureCode::Usage, error),
            TrainError::Captions { .. } | TrainError::Busy { .. } | TrainError::Sizes { .. } => {
                Failure::new(FailureCode::Usage, error)
            }
            TrainError::Validation { .. } => Failure::new(FailureCode::Run, error),
            TrainError::Checkpoint { .. } => Failure::new(FailureCode::Input, error).hint(
                "a checkpoint before it is in the same folder; without the damaged one, the run goes on from there",
            ),
            _ => Failure::new(FailureCode::Output, error),
        }
    }
}

impl From<TrainingConfigError> for Failure {
    fn from(error: TrainingConfigError) -> Self {
        let code = match &error {
            TrainingConfigError::Io { .. } => FailureCode::Input,
            _ => FailureCode::Usage,
        };
        Failure::new(code, error).hint("`lamogen help recipe` says what a config may have")
    }
}
