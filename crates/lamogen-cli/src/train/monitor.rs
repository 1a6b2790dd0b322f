//! The display of a training run: progress bar, losses and sample pictures.

use std::ops::ControlFlow;
use std::path::Path;
use std::time::Instant;

use indicatif::ProgressBar;
use lamogen_train::{LogLine, RunObserver, RunProgress, StepReport, TrainingTask};
use lamogen_view::{LossCurve, losses, save};

use crate::arguments::TrainArguments;
use crate::console::Console;
use crate::failure::{Failure, FailureCode};
use crate::signals::{self, StopRequest};

/// The largest number of points of the training curve in the plot. Each point is a mean over several steps.
const MAX_POINTS: usize = 300;

/// A function that draws motions that the network generates; its arguments are the step and the network.
pub type SampleCallback<'a, T> =
    dyn FnMut(u64, &<T as TrainingTask>::Network) -> Result<(), Failure> + 'a;

/// Observes a training run: it shows a progress bar, prints a line at every validation, draws the losses and the
/// samples, and stops the run on Ctrl-C or at the time limit.
pub struct TrainingMonitor<'a, T: TrainingTask> {
    options: &'a TrainArguments,
    console: &'a Console,
    bar: ProgressBar,
    draw_samples: Box<SampleCallback<'a, T>>,
    start: Instant,
    stop: StopRequest,
    /// An exponential mean of the loss over the last steps.
    loss: Option<f64>,
    /// The first failure to draw a picture.
    drawing_failure: Option<Failure>,
}

impl<'a, T: TrainingTask> TrainingMonitor<'a, T> {
    /// Makes the observer, and installs a signal handler that stops the run.
    pub fn new(
        options: &'a TrainArguments,
        console: &'a Console,
        draw_samples: impl FnMut(u64, &T::Network) -> Result<(), Failure> + 'a,
    ) -> Result<Self, Failure> {
        // If a second signal ends the program at once, the last checkpoint is kept.
        let stop = signals::stop_on_signals();
        stop.heed(true);
        Ok(TrainingMonitor {
            bar: console.progress_bar("steps"),
            options,
            console,
            draw_samples: Box::new(draw_samples),
            start: Instant::now(),
            stop,
            loss: None,
            drawing_failure: None,
        })
    }

    /// Removes the progress bar. Fails if a picture could not be drawn during the run.
    pub fn finish(self) -> Result<(), Failure> {
        self.bar.finish_and_clear();
        self.drawing_failure.map_or(Ok(()), Err)
    }
}

impl<T: TrainingTask> RunObserver<T> for TrainingMonitor<'_, T> {
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
        let minutes = self.start.elapsed().as_secs_f64() / 60.0;
        let is_over_time_limit = self
            .options
            .time_limit
            .is_some_and(|time_limit| minutes > time_limit);
        match is_over_time_limit {
            true => ControlFlow::Break(()),
            false => self.stop.control_flow(),
        }
    }

    fn validated(&mut self, loss: Option<f64>, progress: &RunProgress, network: &T::Network) {
        let steps = (progress.step - progress.resumed_at) as f64;
        let rate = steps / self.start.elapsed().as_secs_f64();
        let all = progress
            .steps
            .map_or(String::new(), |steps| format!("/{steps}"));
        let training = self
            .loss
            .map_or(String::new(), |loss| format!(" training {loss:.4},"));
        let validation = loss.map_or("no motions to validate on".into(), |loss| {
            format!("validation {loss:.4}")
        });
        let step = progress.step;
        let line = format!("step {step}{all}:{training} {validation}, {rate:.2} steps/s");
        self.bar.suspend(|| self.console.notice(line));
        // A picture that cannot be drawn must not stop a long training: a notice is printed, and the run goes on.
        let result = plot_losses(&self.options.out);
        let result = result.and_then(|()| (self.draw_samples)(step, network));
        if let (Err(failure), None) = (result, &self.drawing_failure) {
            let line = format!("no picture: {}", failure.message);
            self.bar.suspend(|| self.console.notice(line));
            self.drawing_failure = Some(failure);
        }
    }
}

/// Draws the losses of a run up to now.
fn plot_losses(run: &Path) -> Result<(), Failure> {
    let (mut training, mut validation) = (Vec::new(), Vec::new());
    for line in LogLine::read(run.join("losses.jsonl"))? {
        match line {
            LogLine::Step(report) => training.push((report.step, report.loss)),
            LogLine::Validation {
                step,
                validation_loss,
            } => validation.push((step, validation_loss)),
        }
    }
    let steps_per_point = training.len().div_ceil(MAX_POINTS).max(1);
    let means = training.chunks(steps_per_point).map(|steps| {
        let sum: f64 = steps.iter().map(|(_, loss)| loss).sum();
        (steps[steps.len() / 2].0, sum / steps.len() as f64)
    });
    let means: Vec<(u64, f64)> = means.collect();
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
    let path = run.join("losses.svg");
    let title = run.file_name().unwrap_or_default();
    let picture = losses(&title.to_string_lossy(), &curves);
    let picture = picture.map_err(|error| Failure::output(&path, error))?;
    save(&path, &picture).map_err(|error| Failure::new(FailureCode::Output, error))
}
