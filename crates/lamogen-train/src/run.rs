//! A whole training, in a folder of its own.
//!
//! ```text
//! RUN/run.json          what is trained, on what; a run in the folder goes on only with the same
//!     losses.jsonl      a line a step, and the validation losses
//!     checkpoints/      what it needs to go on
//!     model/            the network with the averaged weights, at the last measurement
//!     best/             the one with the lowest validation loss
//! ```

use std::fs::{self, File, TryLockError};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use burn::tensor::Device;
use serde_json::Value;

use crate::checkpoint::{self, Checkpoints, Progress};
use crate::error::TrainError;
use crate::identity::{ClaimError, claim};
use crate::log::{Log, LogLine};
use crate::task::TrainingTask;
use crate::trainer::{StepReport, Trainer};

/// How long a run is, and how often it stops to look.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RunPlan {
    /// How long it is.
    pub length: RunLength,
    /// Steps between two measurements on the validation split; the last step is always measured.
    pub validate_every: u64,
    /// Time between two checkpoints.
    pub checkpoint_every: Duration,
}

/// How long a run is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RunLength {
    /// So many steps.
    Steps(u64),
    /// As many steps as fit into this time, going by the first ones. How many that are depends on the machine; from then on
    /// the run is one of so many steps.
    Time(Duration),
}

/// Steps by which the speed is told, and those before them, which do not count: the first ones are slow.
const TIMED: u64 = 40;
const UNTIMED: u64 = 10;

/// What a run says of itself.
pub trait RunObserver<T: TrainingTask> {
    /// After every step. A break stops the run, with a checkpoint.
    fn step(&mut self, report: &StepReport, progress: &RunProgress) -> ControlFlow<()>;

    /// After every measurement, with the averaged network.
    fn validated(&mut self, _loss: Option<f64>, _progress: &RunProgress, _network: &T::Network) {}
}

/// Where a run is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RunProgress {
    /// Steps that were made, in earlier sittings too.
    pub step: u64,
    /// Steps in all, once known.
    pub steps: Option<u64>,
    /// Steps that were made before this sitting.
    pub resumed_at: u64,
}

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RunOutcome {
    /// Where it is.
    pub progress: RunProgress,
    /// Whether all steps were made; if not, the same call goes on.
    pub finished: bool,
    /// The lowest validation loss.
    pub best: Option<f64>,
    /// The last validation loss, where it was measured in this sitting.
    pub last: Option<f64>,
}

/// Trains in a folder, or goes on with what was begun there. Stopped at any moment, even by a lost machine, and called again,
/// it ends with the same weights as without the stop: bit for bit on the CPU (`flex`), for a plan of steps.
///
/// `identity` says what the run is: which task, config and data. A folder with another run is refused.
///
/// # Errors
///
/// If a file cannot be read or written, the folder holds another run, or a loss is not finite.
pub fn run<T: TrainingTask>(
    task: &T,
    folder: &Path,
    identity: &Value,
    plan: &RunPlan,
    device: &Device,
    observer: &mut dyn RunObserver<T>,
) -> Result<RunOutcome, TrainError> {
    Run::open(task, folder, identity, plan, device)?.go_on(observer)
}

struct Run<'a, T: TrainingTask> {
    folder: PathBuf,
    plan: RunPlan,
    trainer: Trainer<'a, T>,
    checkpoints: Checkpoints,
    log: Log,
    progress: Progress,
    resumed_at: u64,
    last: Option<f64>,
    /// Held as long as the run is.
    _lock: File,
}

impl<'a, T: TrainingTask> Run<'a, T> {
    fn open(
        task: &'a T,
        folder: &Path,
        identity: &Value,
        plan: &RunPlan,
        device: &Device,
    ) -> Result<Self, TrainError> {
        fs::create_dir_all(folder).map_err(|reason| TrainError::io(folder, reason))?;
        let lock = lock(folder)?;
        check_identity(folder, identity)?;
        let checkpoints = Checkpoints::of(folder);
        let mut trainer = Trainer::new(task, device);
        let mut progress = Progress {
            step: 0,
            steps: None,
            best: None,
        };
        if let Some(newest) = checkpoints.newest()? {
            progress = checkpoint::progress(&newest)?;
            trainer.restore(&newest, progress.step)?;
        }
        if let RunLength::Steps(steps) = plan.length {
            match progress.steps {
                Some(planned) if planned != steps => {
                    return Err(TrainError::OtherRun {
                        path: folder.to_owned(),
                        expected: format!("a plan of {steps} steps"),
                        found: format!("a plan of {planned} steps"),
                    });
                }
                None if progress.step > steps => {
                    return Err(TrainError::OtherRun {
                        path: folder.to_owned(),
                        expected: format!("{steps} steps"),
                        found: format!("{} steps already", progress.step),
                    });
                }
                _ => progress.steps = Some(steps),
            }
        }
        Ok(Run {
            log: Log::open(folder, progress.step)?,
            folder: folder.to_owned(),
            plan: *plan,
            resumed_at: progress.step,
            trainer,
            checkpoints,
            progress,
            last: None,
            _lock: lock,
        })
    }

    fn go_on(mut self, observer: &mut dyn RunObserver<T>) -> Result<RunOutcome, TrainError> {
        let mut saved = Instant::now();
        let mut timed: Option<(u64, Instant)> = None;
        while self
            .progress
            .steps
            .is_none_or(|steps| self.progress.step < steps)
        {
            let report = self.trainer.advance(self.progress.steps)?;
            self.progress.step = report.step;
            self.log.write(&LogLine::Step(report))?;
            let planned = self.plan_steps(&mut timed, report.step);
            let finished = self.progress.steps == Some(report.step);
            if finished || report.step.is_multiple_of(self.plan.validate_every) {
                self.validate(observer)?;
            }
            let stop = observer.step(&report, &self.position()).is_break();
            let due = saved.elapsed() >= self.plan.checkpoint_every;
            if finished || stop || planned || due {
                // The log must not be behind a checkpoint.
                self.log.sync()?;
                self.checkpoints.write(&self.trainer, &self.progress)?;
                saved = Instant::now();
            }
            if stop {
                break;
            }
        }
        Ok(RunOutcome {
            progress: self.position(),
            finished: self.progress.steps == Some(self.progress.step),
            best: self.progress.best.map(f64::from),
            last: self.last,
        })
    }

    /// Tells from the first steps of a sitting how many there will be, where the plan is one of time. Whether it is told now.
    fn plan_steps(&mut self, timed: &mut Option<(u64, Instant)>, step: u64) -> bool {
        let (None, RunLength::Time(time)) = (self.progress.steps, self.plan.length) else {
            return false;
        };
        let (first, start) = match *timed {
            None if step - self.resumed_at == UNTIMED => {
                *timed = Some((step, Instant::now()));
                return false;
            }
            Some(timed) if step - timed.0 == TIMED => timed,
            _ => return false,
        };
        let one = start.elapsed().as_secs_f64() / TIMED as f64;
        let start = Instant::now();
        self.trainer.task.validate(self.trainer.average());
        let measurement = start.elapsed().as_secs_f64() / self.plan.validate_every as f64;
        let made = (step - first + UNTIMED) as f64 * one;
        let rest = (time.as_secs_f64() - made).max(0.0);
        self.progress.steps = Some(step + (rest / (one + measurement)) as u64);
        true
    }

    fn validate(&mut self, observer: &mut dyn RunObserver<T>) -> Result<(), TrainError> {
        let network = self.trainer.average();
        // In 32 bits, so that JSON keeps it as it is.
        let loss = self.trainer.task.validate(network).map(|loss| loss as f32);
        if let Some(loss) = loss {
            if !loss.is_finite() {
                return Err(TrainError::Validation {
                    step: self.progress.step,
                    loss: f64::from(loss),
                });
            }
            self.log.write(&LogLine::Validation {
                step: self.progress.step,
                validation_loss: f64::from(loss),
            })?;
            if self.progress.best.is_none_or(|best| loss < best) {
                self.progress.best = Some(loss);
                self.save("best")?;
            }
        }
        self.save("model")?;
        let loss = loss.map(f64::from);
        self.last = loss;
        observer.validated(loss, &self.position(), self.trainer.average());
        Ok(())
    }

    fn save(&self, name: &str) -> Result<(), TrainError> {
        let folder = self.folder.join(name);
        fs::create_dir_all(&folder).map_err(|reason| TrainError::io(&folder, reason))?;
        self.trainer.task.save(self.trainer.average(), &folder)
    }

    fn position(&self) -> RunProgress {
        RunProgress {
            step: self.progress.step,
            steps: self.progress.steps,
            resumed_at: self.resumed_at,
        }
    }
}

/// Keeps other processes out of the folder.
fn lock(folder: &Path) -> Result<File, TrainError> {
    let path = folder.join(".lock");
    let file = File::create(&path).map_err(|reason| TrainError::io(&path, reason))?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => Err(TrainError::Busy {
            path: folder.to_owned(),
        }),
        // Not every file system can; then nobody is kept out.
        Err(TryLockError::Error(_)) => Ok(file),
    }
}

/// Notes what a run is, or compares it with what was noted.
fn check_identity(folder: &Path, identity: &Value) -> Result<(), TrainError> {
    let path = folder.join("run.json");
    claim(&path, identity).map_err(|error| match error {
        ClaimError::Io(reason) => TrainError::io(&path, reason),
        ClaimError::Format(reason) => TrainError::Checkpoint {
            problem: reason.to_string(),
            path,
        },
        ClaimError::Other { expected, found } => TrainError::OtherRun {
            path,
            expected,
            found,
        },
    })
}
