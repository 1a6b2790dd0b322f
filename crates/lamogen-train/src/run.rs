//! A whole training run in its own folder.
//!
//! ```text
//! RUN/run.json          the identity of the run: task, config and data; only the same run resumes in the folder
//!     losses.jsonl      one line for each step and for each validation
//!     checkpoints/      the states from which the run resumes
//!     model/            the network with the averaged weights, at the last validation
//!     best/             the network with the lowest validation loss
//! ```

use std::fs::{self, File, TryLockError};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use burn::tensor::Device;
use serde_json::Value;

use crate::checkpoint::{self, CheckpointFolder, CheckpointState};
use crate::error::TrainError;
use crate::identity::{IdentityError, write_or_check_identity};
use crate::log::{LogLine, LossLog};
use crate::task::TrainingTask;
use crate::trainer::{StepReport, Trainer};

/// The length of a run, and how often it validates and writes checkpoints.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RunPlan {
    /// The length of the run.
    pub length: RunLength,
    /// The number of steps between two validations; the network is always validated after the last step.
    pub validate_every: u64,
    /// The time between two checkpoints.
    pub checkpoint_every: Duration,
}

/// The length of a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RunLength {
    /// A number of steps.
    Steps(u64),
    /// As many steps as fit into this time, estimated from the speed of the first steps. Their number depends on the machine; once
    /// it is estimated, the run has this number of steps.
    Time(Duration),
}

/// The number of steps whose time is measured to estimate the speed.
const TIMED_STEPS: u64 = 40;
/// The number of steps before them that are not measured, because the first steps are slow.
const UNTIMED_STEPS: u64 = 10;

/// An observer that a run informs of its steps and validations.
pub trait RunObserver<T: TrainingTask> {
    /// Is called after every step. A break stops the run, which then writes a checkpoint.
    fn step(&mut self, report: &StepReport, progress: &RunProgress) -> ControlFlow<()>;

    /// Is called after every validation, with the averaged network.
    fn validated(&mut self, _loss: Option<f64>, _progress: &RunProgress, _network: &T::Network) {}
}

/// The progress of a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RunProgress {
    /// The number of steps that were made, including those before the run was resumed.
    pub step: u64,
    /// The number of all steps, once it is known.
    pub steps: Option<u64>,
    /// The number of steps that were made before the run was resumed by this call; 0 for a new run.
    pub resumed_at: u64,
}

/// The outcome of a call of [`run`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RunOutcome {
    /// The progress of the run.
    pub progress: RunProgress,
    /// Whether all steps were made; if not, the same call resumes the run.
    pub finished: bool,
    /// The lowest validation loss of the run.
    pub best: Option<f64>,
    /// The last validation loss, if this call measured one.
    pub last: Option<f64>,
}

/// Trains in a folder, or resumes the run that was begun there.
///
/// The run may be stopped at any moment, even by a lost machine. Called again, it ends with the same weights as without the stop:
/// bit for bit on the CPU (`flex`), if the plan is a number of steps.
///
/// `identity` identifies the task, the config and the data of the run. A folder with another run is refused.
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
    Run::open(task, folder, identity, plan, device)?.train(observer)
}

/// An open run.
struct Run<'a, T: TrainingTask> {
    folder: PathBuf,
    plan: RunPlan,
    trainer: Trainer<'a, T>,
    checkpoints: CheckpointFolder,
    log: LossLog,
    state: CheckpointState,
    resumed_at: u64,
    /// The last validation loss.
    last: Option<f64>,
    /// The lock on the folder, which is held as long as the run is open.
    _lock: File,
}

impl<'a, T: TrainingTask> Run<'a, T> {
    /// Locks the folder, checks that it is new or holds the same run, and restores the newest checkpoint.
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
        let checkpoints = CheckpointFolder::of(folder);
        let mut trainer = Trainer::new(task, device);
        let mut state = CheckpointState {
            step: 0,
            steps: None,
            best: None,
        };
        if let Some(newest) = checkpoints.newest()? {
            state = checkpoint::read_state(&newest)?;
            trainer.restore(&newest, state.step)?;
        }
        if let RunLength::Steps(steps) = plan.length {
            match state.steps {
                Some(planned) if planned != steps => {
                    return Err(TrainError::OtherRun {
                        path: folder.to_owned(),
                        expected: format!("a plan of {steps} steps"),
                        found: format!("a plan of {planned} steps"),
                    });
                }
                None if state.step > steps => {
                    return Err(TrainError::OtherRun {
                        path: folder.to_owned(),
                        expected: format!("{steps} steps"),
                        found: format!("{} steps already", state.step),
                    });
                }
                _ => state.steps = Some(steps),
            }
        }
        Ok(Run {
            log: LossLog::open(folder, state.step)?,
            folder: folder.to_owned(),
            plan: *plan,
            resumed_at: state.step,
            trainer,
            checkpoints,
            state,
            last: None,
            _lock: lock,
        })
    }

    /// Makes the remaining steps, until the observer stops the run.
    fn train(mut self, observer: &mut dyn RunObserver<T>) -> Result<RunOutcome, TrainError> {
        let mut last_checkpoint = Instant::now();
        let mut timed: Option<(u64, Instant)> = None;
        while self.state.steps.is_none_or(|steps| self.state.step < steps) {
            let report = self.trainer.advance(self.state.steps)?;
            self.state.step = report.step;
            self.log.write(&LogLine::Step(report))?;
            let is_planned = self.plan_steps(&mut timed, report.step);
            let is_finished = self.state.steps == Some(report.step);
            if is_finished || report.step.is_multiple_of(self.plan.validate_every) {
                self.validate(observer)?;
            }
            let is_stopped = observer.step(&report, &self.progress()).is_break();
            let is_due = last_checkpoint.elapsed() >= self.plan.checkpoint_every;
            if is_finished || is_stopped || is_planned || is_due {
                // The log must have every step of a checkpoint.
                self.log.sync()?;
                self.checkpoints.write(&self.trainer, &self.state)?;
                last_checkpoint = Instant::now();
            }
            if is_stopped {
                break;
            }
        }
        Ok(RunOutcome {
            progress: self.progress(),
            finished: self.state.steps == Some(self.state.step),
            best: self.state.best.map(f64::from),
            last: self.last,
        })
    }

    /// Estimates the number of all steps from the time of the first steps of this call, if the plan is a time. Returns whether this
    /// step completed the estimate.
    fn plan_steps(&mut self, timed: &mut Option<(u64, Instant)>, step: u64) -> bool {
        let (None, RunLength::Time(time)) = (self.state.steps, self.plan.length) else {
            return false;
        };
        let (first, start) = match *timed {
            None if step - self.resumed_at == UNTIMED_STEPS => {
                *timed = Some((step, Instant::now()));
                return false;
            }
            Some(timed) if step - timed.0 == TIMED_STEPS => timed,
            _ => return false,
        };
        let step_seconds = start.elapsed().as_secs_f64() / TIMED_STEPS as f64;
        let start = Instant::now();
        self.trainer.task.validate(self.trainer.average());
        let validation_seconds = start.elapsed().as_secs_f64() / self.plan.validate_every as f64;
        let elapsed = (step - first + UNTIMED_STEPS) as f64 * step_seconds;
        let rest = (time.as_secs_f64() - elapsed).max(0.0);
        self.state.steps = Some(step + (rest / (step_seconds + validation_seconds)) as u64);
        true
    }

    /// Measures and logs the validation loss, and saves the averaged network.
    fn validate(&mut self, observer: &mut dyn RunObserver<T>) -> Result<(), TrainError> {
        let network = self.trainer.average();
        // In 32 bits, so that it is the same after a round trip through JSON.
        let loss = self.trainer.task.validate(network).map(|loss| loss as f32);
        if let Some(loss) = loss {
            if !loss.is_finite() {
                return Err(TrainError::Validation {
                    step: self.state.step,
                    loss: f64::from(loss),
                });
            }
            self.log.write(&LogLine::Validation {
                step: self.state.step,
                validation_loss: f64::from(loss),
            })?;
            if self.state.best.is_none_or(|best| loss < best) {
                self.state.best = Some(loss);
                self.save("best")?;
            }
        }
        self.save("model")?;
        let loss = loss.map(f64::from);
        self.last = loss;
        observer.validated(loss, &self.progress(), self.trainer.average());
        Ok(())
    }

    /// Saves the averaged network in a folder of the run.
    fn save(&self, name: &str) -> Result<(), TrainError> {
        let folder = self.folder.join(name);
        fs::create_dir_all(&folder).map_err(|reason| TrainError::io(&folder, reason))?;
        self.trainer.task.save(self.trainer.average(), &folder)
    }

    /// Returns the progress for observers.
    fn progress(&self) -> RunProgress {
        RunProgress {
            step: self.state.step,
            steps: self.state.steps,
            resumed_at: self.resumed_at,
        }
    }
}

/// Locks the folder against other processes.
fn lock(folder: &Path) -> Result<File, TrainError> {
    let path = folder.join(".lock");
    let file = File::create(&path).map_err(|reason| TrainError::io(&path, reason))?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => Err(TrainError::Busy {
            path: folder.to_owned(),
        }),
        // Not every file system supports locks; the folder is then not protected.
        Err(TryLockError::Error(_)) => Ok(file),
    }
}

/// Writes the identity of a new run, or compares it with the one that the folder holds.
fn check_identity(folder: &Path, identity: &Value) -> Result<(), TrainError> {
    let path = folder.join("run.json");
    write_or_check_identity(&path, identity).map_err(|error| match error {
        IdentityError::Io(reason) => TrainError::io(&path, reason),
        IdentityError::Format(reason) => TrainError::Checkpoint {
            problem: reason.to_string(),
            path,
        },
        IdentityError::Mismatch { expected, found } => TrainError::OtherRun {
            path,
            expected,
            found,
        },
    })
}
