//! What a run shows while it goes on.

use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use indicatif::ProgressBar;
use lamogen_train::{LogLine, RunObserver, RunProgress, StepReport, TrainingTask};
use lamogen_view::{LossCurve, losses, save};

use crate::arguments::Train;
use crate::console::{Console, tell};
use crate::failure::{Code, Failure};
use crate::signals;

/// Steps whose losses make one point of the plot.
const POINTS: usize = 300;

/// Draws what a network makes after so many steps.
pub type Look<'a, T> = dyn FnMut(u64, &<T as TrainingTask>::Network) -> Result<(), Failure> + 'a;

/// A bar, a line at every measurement, a plot of the losses, pictures; and when to stop.
pub struct Watch<'a, T: TrainingTask> {
    options: &'a Train,
    console: &'a Console,
    bar: ProgressBar,
    look: Box<Look<'a, T>>,
    start: Instant,
    stopped: Arc<AtomicBool>,
    /// A mean over the last steps.
    loss: Option<f64>,
    failed: Option<Failure>,
}

impl<'a, T: TrainingTask> Watch<'a, T> {
    pub fn new(
        options: &'a Train,
        console: &'a Console,
        look: impl FnMut(u64, &T::Network) -> Result<(), Failure> + 'a,
    ) -> Result<Self, Failure> {
        let stopped = Arc::new(AtomicBool::new(false));
        let flag = Arc::clone(&stopped);
        let handler = move || {
            if flag.swap(true, Ordering::Relaxed) {
                // Asked twice. The last checkpoint stays.
                signals::end();
            }
            tell("Stopping after this step; once more stops at once.");
        };
        ctrlc::set_handler(handler).map_err(|error| Failure::new(Code::Run, error))?;
        Ok(Watch {
            bar: console.bar("steps"),
            options,
            console,
            look: Box::new(look),
            start: Instant::now(),
            stopped,
            loss: None,
            failed: None,
        })
    }

    /// Removes the bar. What could not be drawn on the way is an error now that the run is over.
    pub fn finish(self) -> Result<(), Failure> {
        self.bar.finish_and_clear();
        self.failed.map_or(Ok(()), Err)
    }
}

impl<T: TrainingTask> RunObserver<T> for Watch<'_, T> {
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
        let over = self
            .options
            .time_limit
            .is_some_and(|time_limit| minutes > time_limit);
        match over || self.stopped.load(Ordering::Relaxed) {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        }
    }

    fn validated(&mut self, loss: Option<f64>, progress: &RunProgress, network: &T::Network) {
        let made = (progress.step - progress.resumed_at) as f64;
        let rate = made / self.start.elapsed().as_secs_f64();
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
        // Hours of training are worth more than a picture: its failure is told, and the run goes on.
        let drawn = plot(&self.options.out).and_then(|()| (self.look)(step, network));
        if let (Err(failure), None) = (drawn, &self.failed) {
            let line = format!("no picture: {}", failure.message);
            self.bar.suspend(|| self.console.notice(line));
            self.failed = Some(failure);
        }
    }
}

/// Draws the losses so far of a run.
fn plot(run: &Path) -> Result<(), Failure> {
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
    let at_once = training.len().div_ceil(POINTS).max(1);
    let means = training.chunks(at_once).map(|steps| {
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
    save(&path, &picture).map_err(|error| Failure::new(Code::Output, error))
}
