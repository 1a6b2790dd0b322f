//! `lamogen eval`: evaluates a model as in the paper, and reports the results.

use indicatif::ProgressBar;
use lamogen::Device;
use lamogen_data::{BenchmarkSplit, DataError, LoadOptions};
use lamogen_eval::protocol::{Protocol, PublicEvaluator, PublicFile, PublicFiles};
use lamogen_eval::{Evaluator, EvaluatorError};
use lamogen_evaluation::{
    EvaluatedModel, Evaluation, EvaluationError, EvaluationErrorKind, EvaluationEstimate,
    EvaluationObserver, EvaluationOptions, MultimodalityOptions, PUBLIC_LENGTHS, PublicBenchmark,
    accepted_lengths, estimate, estimate_publicly, evaluate, evaluate_publicly,
};
pub use lamogen_evaluation::{MeasurementTarget, Method, Study};
use serde_json::json;

use crate::arguments::{EvalArguments, PresetName};
use crate::console::Console;
use crate::dataset;
use crate::failure::{Failure, FailureCode};
use crate::pack::print_problems;
use crate::source::{EMBEDDED, ModelSource, open_device};

/// Runs `lamogen eval`.
pub fn run(arguments: &EvalArguments, console: &Console) -> Result<(), Failure> {
    if arguments.out.exists() && !arguments.out.is_dir() {
        let reason = "expected a folder, found a file";
        return Err(Failure::output(&arguments.out, reason));
    }
    if arguments.dry_run {
        check_folders(arguments, console)?;
    }
    let device = open_device(arguments.source.device)?;
    let files = public_files(arguments);
    if let Some(files) = &files {
        check_missing(files, arguments, console)?;
    }
    let mut source = ModelSource::open(&arguments.source, console)?;
    if files.is_some() {
        let shortest = *PUBLIC_LENGTHS.start().min(source.model.lengths().start());
        source.model = source.model.with_min_frames(shortest);
    }
    let name = match source.name.as_str() {
        EMBEDDED => "the embedded model".into(),
        name => format!("the model {name}"),
    };
    let model = EvaluatedModel {
        model: &source.model,
        name: &name,
        fingerprint: lamogen_train::fingerprint(source.model.network()),
    };
    let options = options(arguments, files.is_some());
    let mut progress = Progress { console, bar: None };
    let (progress, folder) = (&mut progress, &arguments.out);
    let outcome = match &files {
        Some(files) => {
            let evaluator = load_public(files, &device)?;
            let split = open_benchmark(arguments, console)?;
            let benchmark = PublicBenchmark {
                evaluator: evaluator.as_ref(),
                split: &split,
            };
            match arguments.dry_run {
                true => estimate_publicly(&model, benchmark, folder, &options, progress)
                    .map(EvalOutcome::Estimates),
                false => evaluate_publicly(&model, benchmark, folder, &options, progress)
                    .map(EvalOutcome::Evaluation),
            }
        }
        None => {
            let evaluator = Evaluator::load(&arguments.evaluator, &device).map_err(|error| {
                Failure::new(FailureCode::Input, error)
                    .hint("lamogen train --evaluator makes one: its folder is best; the public one has text_mot_match, Comp_v6_KLD01 and glove")
            })?;
            let lengths = accepted_lengths(source.model.network(), &evaluator);
            let limits = LoadOptions {
                min_frames: *lengths.start(),
                max_frames: LoadOptions::default().max_frames.max(*lengths.end()),
            };
            let data = dataset::open(&arguments.data, &limits, console)?;
            match arguments.dry_run {
                true => estimate(&model, &evaluator, &data, folder, &options, progress)
                    .map(EvalOutcome::Estimates),
                false => evaluate(&model, &evaluator, &data, folder, &options, progress)
                    .map(EvalOutcome::Evaluation),
            }
        }
    };
    progress.finish();
    match outcome? {
        EvalOutcome::Estimates(estimates) => {
            let missing = files.as_ref().map_or(&[][..], PublicFiles::missing);
            print_estimates(&estimates, missing, console)
        }
        EvalOutcome::Evaluation(evaluation) => print_evaluation(&evaluation, console),
    }
}

/// What an evaluation or a dry run gives.
enum EvalOutcome {
    Estimates(Vec<EvaluationEstimate>),
    Evaluation(Evaluation),
}

/// Returns the files of the public evaluator, if the evaluator's folder has them and is not one that lamogen wrote.
fn public_files(arguments: &EvalArguments) -> Option<PublicFiles> {
    let is_own = ["config.json", "model.safetensors"]
        .iter()
        .any(|name| arguments.evaluator.join(name).exists());
    let files = PublicFiles::find(&arguments.evaluator);
    (!is_own && files.is_any()).then_some(files)
}

/// Says which of the folders of a dry run are missing, all at once. Without one of them nothing can be estimated.
fn check_folders(arguments: &EvalArguments, console: &Console) -> Result<(), Failure> {
    let model = arguments.source.model.as_deref();
    let folders = [
        (
            model,
            "model",
            "MotionDiffuse's and MDM's authors publish theirs, `lamogen train` makes one, and without --model it is the embedded one",
        ),
        (
            Some(&*arguments.data),
            "data",
            "HumanML3D's repository says how its own is made, and `lamogen pack` makes one of motion files",
        ),
        (
            Some(&*arguments.evaluator),
            "evaluator",
            "HumanML3D's repository links the public one, and `lamogen train --evaluator` makes one",
        ),
    ];
    let missing = { folders.into_iter() }
        .filter_map(|(folder, name, source)| Some((folder?, name, source)))
        .filter(|(folder, ..)| !folder.exists());
    let missing: Vec<_> = missing.collect();
    for (folder, name, source) in &missing {
        let folder = folder.display();
        console.notice(format!("missing: the {name}, {folder}: {source}"));
    }
    let names: Vec<String> = { missing.iter() }
        .map(|(folder, ..)| folder.display().to_string())
        .collect();
    match names.is_empty() {
        true => Ok(()),
        false => Err(Failure::new(
            FailureCode::Input,
            format!("nothing can be estimated without {}", names.join(", ")),
        )),
    }
}

/// Says which files of the public evaluator are missing. Only a dry run, or one that was asked to, goes on without them.
fn check_missing(
    files: &PublicFiles,
    arguments: &EvalArguments,
    console: &Console,
) -> Result<(), Failure> {
    if files.missing().is_empty() {
        return Ok(());
    }
    if !arguments.dry_run && !arguments.partial {
        let error = EvaluatorError::Missing {
            folder: files.folder().to_owned(),
            files: files.missing().to_vec(),
        };
        return Err(Failure::new(FailureCode::Input, error)
            .hint("--partial leaves out what needs these files; --dry-run says what that is"));
    }
    for file in files.missing() {
        let (without, source) = (file.needed_for(), file.source());
        console.notice(format!(
            "missing: {file}. Without it there is no {without}. It is in {source}"
        ));
    }
    Ok(())
}

/// Loads the public evaluator; `None` if its networks or statistics are missing.
fn load_public(files: &PublicFiles, device: &Device) -> Result<Option<PublicEvaluator>, Failure> {
    if files.network().is_none() || files.statistics().is_none() {
        return Ok(None);
    }
    let evaluator = PublicEvaluator::load(files, device);
    let evaluator = evaluator.map_err(|error| Failure::new(FailureCode::Input, error))?;
    Ok(Some(evaluator))
}

/// Reads the split of HumanML3D's folder with a progress bar, and prints which motions were left out.
fn open_benchmark(arguments: &EvalArguments, console: &Console) -> Result<BenchmarkSplit, Failure> {
    let bar = console.progress_bar("files");
    let split = BenchmarkSplit::open(&arguments.data, arguments.split, &mut |progress| {
        bar.set_length(progress.all as u64);
        bar.set_position(progress.done as u64);
    });
    bar.finish_and_clear();
    let split = split.map_err(|error| {
        let is_read = matches!(error, DataError::Read { .. });
        let failure = Failure::from(error);
        match is_read {
            true => failure.hint(
                "the public evaluator reads HumanML3D's own folder: new_joint_vecs, texts and test.txt",
            ),
            false => failure,
        }
    })?;
    print_problems(split.problems(), console);
    console.notice(format!(
        "{} motions of {} recordings, as the public evaluation counts them",
        split.clips().len(),
        split.listed()
    ));
    Ok(split)
}

/// Prints the files of a report, or how far the work is.
fn print_evaluation(evaluation: &Evaluation, console: &Console) -> Result<(), Failure> {
    let paths = evaluation
        .files
        .iter()
        .map(|path| path.display().to_string());
    let paths: Vec<String> = paths.collect();
    let done = evaluation.motions - evaluation.missing;
    console.print(match (console.json, paths.is_empty()) {
        (true, _) => {
            json!({ "motions": done, "missing": evaluation.missing, "files": paths }).to_string()
        }
        (false, true) => format!("{done} of {} motions", evaluation.motions),
        (false, false) => paths.join("\n"),
    })
}

/// Returns the options of an evaluation.
fn options(arguments: &EvalArguments, is_public: bool) -> EvaluationOptions {
    let (repeats, measure) = match is_public {
        true => (Protocol::REPLICATIONS, MeasurementTarget::Joints),
        false => (1, MeasurementTarget::Rig),
    };
    EvaluationOptions {
        split: arguments.split,
        prompts: arguments.prompts.map(|count| count as usize),
        repeats: arguments.repeats.unwrap_or(repeats),
        preset: arguments.preset.map(PresetName::preset),
        steps: arguments.steps,
        noise_steps: arguments.noise_steps,
        methods: arguments.methods.clone(),
        studies: arguments.studies.clone(),
        measure: arguments.measure.unwrap_or(measure),
        study_prompts: arguments.study_prompts as usize,
        shard: arguments.shard,
        merge: arguments.merge,
        multimodality: (arguments.mm_texts > 0).then_some(MultimodalityOptions {
            texts: arguments.mm_texts as usize,
            motions: arguments.mm_motions,
        }),
    }
}

/// Shows an evaluation on the console.
struct Progress<'a> {
    console: &'a Console,
    bar: Option<ProgressBar>,
}

impl Progress<'_> {
    /// Removes the bar.
    fn finish(&mut self) {
        if let Some(bar) = self.bar.take() {
            bar.finish_and_clear();
        }
    }
}

impl EvaluationObserver for Progress<'_> {
    fn notice(&mut self, text: &str) {
        self.finish();
        self.console.notice(text);
    }

    fn progress(&mut self, done: usize, total: usize, setting: &str) {
        let bar = self
            .bar
            .get_or_insert_with(|| self.console.progress_bar("motions"));
        bar.set_length(total as u64);
        bar.set_position(done as u64);
        bar.set_message(setting.to_owned());
        if done == total {
            self.finish();
        }
    }
}

/// Prints how many motions are missing, and about how long they take. `missing_files` are those of the public evaluator.
fn print_estimates(
    estimates: &[EvaluationEstimate],
    missing_files: &[PublicFile],
    console: &Console,
) -> Result<(), Failure> {
    let motions: usize = estimates.iter().map(|setting| setting.motions).sum();
    let seconds = estimates
        .iter()
        .map(|setting| setting.seconds_each * setting.motions as f64);
    let seconds: f64 = seconds.sum();
    if console.json {
        let settings = estimates.iter().map(|setting| {
            json!({ "setting": setting.setting, "motions": setting.motions, "seconds_each": setting.seconds_each })
        });
        let settings: Vec<_> = settings.collect();
        let missing_files = missing_files.iter().map(|file| {
            json!({ "file": file.place(), "source": file.source(), "needed_for": file.needed_for() })
        });
        let missing_files: Vec<_> = missing_files.collect();
        let estimate = json!({ "motions": motions, "seconds": seconds, "settings": settings, "missing_files": missing_files });
        return console.print(estimate.to_string());
    }
    let rows = estimates.iter().map(|setting| {
        let EvaluationEstimate {
            setting,
            motions,
            seconds_each,
        } = setting;
        format!("{motions:6} × {seconds_each:6.2} s  {setting}")
    });
    let all = format!("{motions:6} motions, about {}", format_duration(seconds));
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

impl From<EvaluationError> for Failure {
    fn from(error: EvaluationError) -> Self {
        let code = match error.kind {
            EvaluationErrorKind::Generation => FailureCode::Run,
            EvaluationErrorKind::Options => FailureCode::Usage,
            EvaluationErrorKind::Input => FailureCode::Input,
            EvaluationErrorKind::Output => FailureCode::Output,
        };
        let failure = Failure::new(code, error.message);
        match error.hint {
            Some(hint) => failure.hint(hint),
            None => failure,
        }
    }
}
