//! `lamogen eval`: evaluates a model as in the paper, and reports the results.

use indicatif::ProgressBar;
use lamogen::evaluation::{
    EvaluatedModel, EvaluationError, EvaluationErrorKind, EvaluationEstimate, EvaluationObserver,
    EvaluationOptions, accepted_lengths, estimate, evaluate,
};
pub use lamogen::evaluation::{MeasurementTarget, Method, Study};
use lamogen_data::LoadOptions;
use lamogen_eval::Evaluator;
use serde_json::json;

use crate::arguments::{EvalArguments, PresetName};
use crate::console::Console;
use crate::dataset;
use crate::failure::{Failure, FailureCode};
use crate::source::{EMBEDDED, ModelSource, open_device};

/// Runs `lamogen eval`.
pub fn run(arguments: &EvalArguments, console: &Console) -> Result<(), Failure> {
    if arguments.out.exists() && !arguments.out.is_dir() {
        let reason = "expected a folder, found a file";
        return Err(Failure::output(&arguments.out, reason));
    }
    let device = open_device(arguments.source.device)?;
    let source = ModelSource::open(&arguments.source, console)?;
    let evaluator = Evaluator::load(&arguments.evaluator, &device).map_err(|error| {
        Failure::new(FailureCode::Input, error)
            .hint("lamogen train --evaluator makes one: its folder is best")
    })?;
    let lengths = accepted_lengths(source.model.network(), &evaluator);
    let limits = LoadOptions {
        min_frames: *lengths.start(),
        max_frames: LoadOptions::default().max_frames.max(*lengths.end()),
    };
    let dataset = dataset::open(&arguments.data, &limits, console)?;
    let name = match source.name.as_str() {
        EMBEDDED => "the embedded model".into(),
        name => format!("the model {name}"),
    };
    let model = EvaluatedModel {
        model: &source.model,
        name: &name,
        fingerprint: lamogen_train::fingerprint(source.model.network()),
    };
    let options = options(arguments);
    let mut progress = Progress { console, bar: None };
    if arguments.dry_run {
        let folder = &arguments.out;
        let estimates = estimate(
            &model,
            &evaluator,
            &dataset,
            folder,
            &options,
            &mut progress,
        )?;
        return print_estimates(&estimates, console);
    }
    let evaluation = evaluate(
        &model,
        &evaluator,
        &dataset,
        &arguments.out,
        &options,
        &mut progress,
    );
    progress.finish();
    let evaluation = evaluation?;
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
fn options(arguments: &EvalArguments) -> EvaluationOptions {
    EvaluationOptions {
        split: arguments.split,
        prompts: arguments.prompts.map(|count| count as usize),
        repeats: arguments.repeats,
        preset: arguments.preset.map(PresetName::preset),
        steps: arguments.steps,
        noise_steps: arguments.noise_steps,
        methods: arguments.methods.clone(),
        studies: arguments.studies.clone(),
        measure: arguments.measure,
        study_prompts: arguments.study_prompts as usize,
        shard: arguments.shard,
        merge: arguments.merge,
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

/// Prints how many motions are missing, and about how long they take.
fn print_estimates(estimates: &[EvaluationEstimate], console: &Console) -> Result<(), Failure> {
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
        let estimate = json!({ "motions": motions, "seconds": seconds, "settings": settings });
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
