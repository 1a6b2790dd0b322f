//! `lamogen train`.

use std::collections::HashMap;
use std::fs;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use indicatif::ProgressBar;
use lamogen::model::{MotionDiffuse, Tokenizer, learn};
use lamogen::{Device, FRAMES_PER_SECOND, LaMoGen, Request};
use lamogen_data::{Dataset, LoadOptions, Split};
use lamogen_train::{
    CaptionTokens, Denoising, Ended, Length, LogLine, Plan, RunObserver, RunProgress, StepReport,
    TrainError, TrainingConfig, TrainingConfigError, identity, run as train,
};
use lamogen_view::{LossCurve, Row, losses, save, strip};
use serde_json::json;

use crate::arguments::Train;
use crate::console::Console;
use crate::failure::{Code, Failure};
use crate::source::device;

/// The vocabulary of CLIP, whose tokenizer is part of the program.
const CLIP_VOCABULARY: usize = 49408;

/// Steps whose losses make one point of the plot.
const POINTS: usize = 300;

pub fn run(options: &Train, console: &Console) -> Result<(), Failure> {
    let device = device(options.device)?;
    let config = match options.config.to_str() {
        Some("compact") => TrainingConfig::compact(),
        _ => TrainingConfig::from_file(&options.config)?,
    };
    let model = &config.model;
    if model.prediction == lamogen::model::Prediction::Epsilon
        && model.latent_dim < model.input_feats
    {
        console.notice(format!(
            "the network predicts noise in {} features through {} channels: what does not fit through cannot be learned; \
             \"sample\" has no such limit",
            model.input_feats, model.latent_dim
        ));
    }
    let dataset = open(options, console)?;
    let tokens = tokens(options, &config, &dataset, console)?;
    let metadata = [
        ("license", &options.license),
        ("attribution", &options.attribution),
    ];
    let metadata: HashMap<String, String> = metadata
        .into_iter()
        .filter_map(|(name, text)| Some((name.to_owned(), text.clone()?)))
        .collect();
    let task = Denoising::new(&dataset, &tokens, &config, &device)?.with_metadata(metadata);
    let identity = identity("denoiser", &config, &dataset, &tokens);
    console.notice(format!(
        "Training on {} motions; the folder {} has all that is needed to go on after a stop.",
        task.motions(),
        options.out.display()
    ));
    let mut watch = Watch::new(options, &dataset, &tokens, &device, console)?;
    let ended = train(
        &task,
        &options.out,
        &identity,
        &plan(options),
        &device,
        &mut watch,
    );
    watch.bar.finish_and_clear();
    if let Some(failure) = watch.failed {
        return Err(failure);
    }
    report(options, &ended?, console)
}

fn plan(options: &Train) -> Plan {
    let minutes = |minutes: f64| Duration::from_secs_f64(60.0 * minutes);
    Plan {
        length: match (options.steps, options.minutes) {
            (Some(steps), _) => Length::Steps(steps),
            (None, time) => Length::Time(minutes(time.expect("clap asks for one of them"))),
        },
        validate_every: options.validate_every,
        checkpoint_every: minutes(options.checkpoint_minutes),
    }
}

fn open(options: &Train, console: &Console) -> Result<Dataset, Failure> {
    let bar = console.bar("files");
    let dataset = Dataset::open(&options.data, &LoadOptions::default(), &mut |progress| {
        bar.set_length(progress.all as u64);
        bar.set_position(progress.done as u64);
    });
    bar.finish_and_clear();
    let dataset = dataset?;
    let broken: Vec<_> = dataset.problems().broken().collect();
    for problem in broken.iter().take(20) {
        console.notice(format!("left out: {}: {}", problem.name, problem.reason));
    }
    if broken.len() > 20 {
        let more = broken.len() - 20;
        console.notice(format!("left out: {more} more"));
    }
    Ok(dataset)
}

/// The captions as ids: by the tokenizer that is named, CLIP's own, or one that is learned from the captions.
fn tokens(
    options: &Train,
    config: &TrainingConfig,
    dataset: &Dataset,
    console: &Console,
) -> Result<CaptionTokens, Failure> {
    let clip = &config.model.clip;
    let file = match &options.tokenizer {
        Some(path) => Some((
            fs::read(path).map_err(|reason| {
                Failure::new(Code::Input, format!("{}: {reason}", path.display()))
            })?,
            path.clone(),
        )),
        None if clip.vocab_size == CLIP_VOCABULARY => None,
        None => {
            let entries = dataset
                .split(Split::Train)
                .flat_map(|entry| &entry.captions);
            let texts: Vec<&str> = entries.map(|caption| caption.text.as_str()).collect();
            let learned = learn(texts.into_iter(), clip.vocab_size);
            let learned = learned.map_err(|error| Failure::new(Code::Usage, error))?;
            Some((learned, PathBuf::from("the learned tokenizer")))
        }
    };
    let failed = |error| Failure::new(Code::Input, error);
    let (tokenizer, file) = match file {
        None => (Tokenizer::clip(clip.context_length), None),
        Some((json, name)) => {
            let (vocabulary, context) = (clip.vocab_size, clip.context_length);
            let tokenizer = Tokenizer::from_json(&json, name, vocabulary, context);
            (tokenizer.map_err(failed)?, Some(json))
        }
    };
    let tokens = CaptionTokens::new(dataset, tokenizer, file).map_err(failed)?;
    if tokens.cut() > 0 {
        console.notice(format!(
            "{} captions are longer than the {} tokens that the network reads, and are cut",
            tokens.cut(),
            clip.context_length
        ));
    }
    Ok(tokens)
}

/// What a run shows while it goes on.
struct Watch<'a> {
    options: &'a Train,
    dataset: &'a Dataset,
    tokens: &'a CaptionTokens,
    device: &'a Device,
    console: &'a Console,
    bar: ProgressBar,
    /// What the sample motions are of.
    samples: Vec<String>,
    start: Instant,
    stopped: Arc<AtomicBool>,
    /// A mean over the last steps.
    loss: Option<f64>,
    failed: Option<Failure>,
}

impl<'a> Watch<'a> {
    fn new(
        options: &'a Train,
        dataset: &'a Dataset,
        tokens: &'a CaptionTokens,
        device: &'a Device,
        console: &'a Console,
    ) -> Result<Self, Failure> {
        let stopped = Arc::new(AtomicBool::new(false));
        let flag = Arc::clone(&stopped);
        let handler = move || {
            if flag.swap(true, Ordering::Relaxed) {
                // Asked twice. The last checkpoint stays.
                std::process::exit(130);
            }
            eprintln!("Stopping after this step; once more stops at once.");
        };
        ctrlc::set_handler(handler).map_err(|error| Failure::new(Code::Run, error))?;
        let samples = match &options.sample[..] {
            [] => usual_samples(dataset),
            samples => samples.to_vec(),
        };
        Ok(Watch {
            bar: console.bar("steps"),
            options,
            dataset,
            tokens,
            device,
            console,
            samples,
            start: Instant::now(),
            stopped,
            loss: None,
            failed: None,
        })
    }

    /// Draws the losses so far.
    fn plot(&self) -> Result<(), Failure> {
        let path = self.options.out.join("losses.jsonl");
        let lines = LogLine::read(path)?;
        let (mut training, mut validation) = (Vec::new(), Vec::new());
        for line in lines {
            match line {
                LogLine::Step(report) => training.push((report.step, report.loss)),
                LogLine::Validation {
                    step,
                    validation_loss,
                } => validation.push((step, validation_loss)),
            }
        }
        let at_once = training.len().div_ceil(POINTS).max(1);
        let means: Vec<(u64, f64)> = training
            .chunks(at_once)
            .map(|steps| {
                let sum: f64 = steps.iter().map(|(_, loss)| loss).sum();
                (steps[steps.len() / 2].0, sum / steps.len() as f64)
            })
            .collect();
        let curves = [
            LossCurve {
                label: "training",
                points: &means,
                colour: [107, 114, 128],
            },
            LossCurve {
                label: "validation, averaged weights",
                points: &validation,
                colour: [194, 65, 12],
            },
        ];
        let path = self.options.out.join("losses.svg");
        let title = self.options.out.file_name().unwrap_or_default();
        let picture = losses(&title.to_string_lossy(), &curves);
        let picture = picture.map_err(|error| Failure::output(&path, error))?;
        save(&path, &picture).map_err(|error| Failure::new(Code::Output, error))
    }

    /// Draws motions of the averaged network.
    fn draw_samples(&self, step: u64, network: &MotionDiffuse) -> Result<(), Failure> {
        const STEPS: usize = 50;
        const SECONDS: f32 = 4.0;
        let longest = network.config().num_frames as f32 / FRAMES_PER_SECOND;
        let shortest = network.config().shortest() as f32 / FRAMES_PER_SECOND;
        let model = LaMoGen::new(
            network.clone(),
            self.tokens.tokenizer().clone(),
            self.dataset.normalization(self.device),
        );
        let requests: Vec<Request> = self
            .samples
            .iter()
            .map(|prompt| {
                Request::new(prompt)
                    .seconds(SECONDS.clamp(shortest, longest))
                    .steps(STEPS)
            })
            .collect();
        let motions = model.generate_all(&requests)?;
        let rows: Vec<Row<'_>> = self
            .samples
            .iter()
            .zip(&motions)
            .map(|(label, made)| Row {
                label,
                motion: &made.guided,
            })
            .collect();
        let folder = self.options.out.join("samples");
        fs::create_dir_all(&folder).map_err(|reason| Failure::output(&folder, reason))?;
        let path = folder.join(format!("step-{step:08}.svg"));
        save(&path, &strip(&rows, 12)).map_err(|error| Failure::new(Code::Output, error))
    }
}

impl RunObserver<Denoising<'_>> for Watch<'_> {
    fn step(&mut self, report: &StepReport, progress: &RunProgress) -> ControlFlow<()> {
        let loss = match self.loss {
            Some(loss) => 0.98 * loss + 0.02 * report.loss,
            None => report.loss,
        };
        self.loss = Some(loss);
        if let Some(steps) = progress.steps {
            self.bar.set_length(steps);
        }
        self.bar.set_position(report.step);
        self.bar.set_message(format!("{loss:.4}"));
        let sitting = self.options.sitting;
        let over =
            sitting.is_some_and(|minutes| self.start.elapsed().as_secs_f64() > 60.0 * minutes);
        match over || self.stopped.load(Ordering::Relaxed) || self.failed.is_some() {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        }
    }

    fn validated(&mut self, loss: Option<f64>, progress: &RunProgress, network: &MotionDiffuse) {
        let rate =
            (progress.step - progress.resumed_at) as f64 / self.start.elapsed().as_secs_f64();
        let all = progress
            .steps
            .map_or(String::new(), |steps| format!("/{steps}"));
        let training = self
            .loss
            .map_or(String::new(), |loss| format!(" training {loss:.4},"));
        let validation = loss.map_or("no motions to validate on".into(), |loss| {
            format!("validation {loss:.4}")
        });
        let line = format!(
            "step {}{all}:{training} {validation}, {rate:.2} steps/s",
            progress.step
        );
        self.bar.suspend(|| self.console.notice(line));
        let drawn = self
            .plot()
            .and_then(|()| self.draw_samples(progress.step, network));
        self.failed = self.failed.take().or(drawn.err());
    }
}

/// First captions of motions that were not trained on, of as many contents as can be shown.
fn usual_samples(dataset: &Dataset) -> Vec<String> {
    const SHOWN: usize = 8;
    let mut contents: Vec<Option<&str>> = Vec::new();
    let unseen = dataset
        .split(Split::Validation)
        .chain(dataset.split(Split::Test))
        .chain(dataset.split(Split::Train));
    let new = unseen.filter(|entry| {
        let content = entry.content.as_deref();
        let is_new = content.is_none() || !contents.contains(&content);
        contents.push(content);
        is_new
    });
    new.take(SHOWN)
        .map(|entry| entry.captions[0].text.clone())
        .collect()
}

fn report(options: &Train, ended: &Ended, console: &Console) -> Result<(), Failure> {
    let folder = options.out.join("model");
    if console.json {
        return console.say(
            json!({
                "run": options.out.to_string_lossy(),
                "finished": ended.finished,
                "step": ended.progress.step,
                "steps": ended.progress.steps,
                "validation_loss": ended.last,
                "best_validation_loss": ended.best,
                "model": ended.finished.then(|| folder.to_string_lossy()),
            })
            .to_string(),
        );
    }
    let step = ended.progress.step;
    let best = ended.best.map_or(String::new(), |best| {
        format!(", lowest validation loss {best:.4}")
    });
    if !ended.finished {
        return console.say(format!(
            "stopped after step {step}{best}; the same command goes on from there"
        ));
    }
    console.say(format!(
        "{}: after {step} steps{best}\nlamogen generate \"…\" --model {}",
        options.out.display(),
        quoted(&folder)
    ))
}

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
            TrainError::Checkpoint { .. } => Failure::new(Code::Input, error)
                .hint("the checkpoint before it is in the same folder; remove the damaged one to go on from there"),
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
        Failure::new(code, error).hint("docs/training.md says what a config may have")
    }
}
