//! What a run needs to go on as if it had never stopped.
//!
//! ```text
//! RUN/checkpoints/step-00001000/  network.bpk, average.bpk, moment_1.bpk, moment_2.bpk, state.json
//! ```
//!
//! What is drawn at a step depends on the step's number alone, so that no generator and no place in the data have to be kept.

use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use burn::module::Module;
use serde::{Deserialize, Serialize};

use crate::error::TrainError;
use crate::task::TrainingTask;
use crate::trainer::{State, Trainer, tracked};

/// Checkpoints that are kept: the newest, and the one before in case the newest is damaged with the disk.
const KEPT: usize = 2;

/// What a checkpoint keeps as networks: weights, their average, and their moments.
const NETWORKS: [&str; 4] = ["network.bpk", "average.bpk", "moment_1.bpk", "moment_2.bpk"];

/// What stands in a checkpoint beside weights.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Progress {
    /// Steps that were made.
    pub(crate) step: u64,
    /// Steps that the run will have, once that is known.
    pub(crate) steps: Option<u64>,
    /// The lowest validation loss so far.
    pub(crate) best: Option<f32>,
}

/// The folder of a run's checkpoints.
pub(crate) struct Checkpoints {
    folder: PathBuf,
}

impl Checkpoints {
    pub(crate) fn of(run: &Path) -> Self {
        Checkpoints {
            folder: run.join("checkpoints"),
        }
    }

    /// The newest complete checkpoint.
    pub(crate) fn newest(&self) -> Result<Option<PathBuf>, TrainError> {
        Ok(self.named("step-")?.pop())
    }

    /// What has a name that begins so, in order. Checkpoints that are not finished begin with a dot.
    fn named(&self, start: &str) -> Result<Vec<PathBuf>, TrainError> {
        let io = |reason| TrainError::io(&self.folder, reason);
        let entries = match fs::read_dir(&self.folder) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
            entries => entries.map_err(io)?,
        };
        let mut found = Vec::new();
        for entry in entries {
            let path = entry.map_err(io)?.path();
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            if name.starts_with(start) {
                found.push(path);
            }
        }
        found.sort();
        Ok(found)
    }

    /// Writes a checkpoint under a temporary name, renames it, and removes old ones.
    pub(crate) fn write<T: TrainingTask>(
        &self,
        trainer: &Trainer<'_, T>,
        progress: &Progress,
    ) -> Result<(), TrainError> {
        let name = format!("step-{:08}", progress.step);
        let path = self.folder.join(&name);
        if path.exists() {
            return Ok(());
        }
        let temporary = self.folder.join(format!(".{name}"));
        let io = |reason| TrainError::io(&temporary, reason);
        // What a lost machine left half written.
        remove(&self.named(".step-")?)?;
        fs::create_dir_all(&temporary).map_err(io)?;
        let State {
            network,
            average,
            moments: [first, second],
            ..
        } = &trainer.state;
        for (name, network) in NETWORKS.into_iter().zip([network, average, first, second]) {
            let saved = network.valid().save_file(temporary.join(name));
            saved.map_err(|reason| TrainError::record(&temporary, reason))?;
        }
        let json = serde_json::to_vec_pretty(progress).expect("numbers are JSON");
        let mut state = fs::File::create(temporary.join("state.json")).map_err(io)?;
        state.write_all(&json).map_err(io)?;
        state.sync_all().map_err(io)?;
        fs::rename(&temporary, &path).map_err(io)?;
        // The new one must be there for good before old ones go.
        #[cfg(unix)]
        fs::File::open(&self.folder)
            .and_then(|folder| folder.sync_all())
            .map_err(io)?;
        let all = self.named("step-")?;
        remove(&all[..all.len().saturating_sub(KEPT)])
    }
}

fn remove(folders: &[PathBuf]) -> Result<(), TrainError> {
    for folder in folders {
        fs::remove_dir_all(folder).map_err(|reason| TrainError::io(folder, reason))?;
    }
    Ok(())
}

/// Reads what a checkpoint says of its run.
pub(crate) fn progress(checkpoint: &Path) -> Result<Progress, TrainError> {
    let path = checkpoint.join("state.json");
    let bytes = fs::read(&path).map_err(|reason| TrainError::io(&path, reason))?;
    serde_json::from_slice(&bytes).map_err(|reason| TrainError::Checkpoint {
        problem: reason.to_string(),
        path,
    })
}

impl<T: TrainingTask> Trainer<'_, T> {
    /// Goes back to a checkpoint.
    pub(crate) fn restore(&mut self, checkpoint: &Path, step: u64) -> Result<(), TrainError> {
        let mut read = NETWORKS.into_iter().map(|name| {
            let path = checkpoint.join(name);
            let fresh = self.state.average.clone();
            let network = fresh.try_load_file(&path);
            network.map_err(|reason| TrainError::record(&path, reason))
        });
        let mut next = || read.next().expect("as many as there are names");
        // Their parameters have the numbers that they were saved with, the same in all of them: by these they find each other.
        self.state = State {
            step,
            network: tracked(next()?),
            average: next()?,
            moments: [next()?, next()?],
        };
        Ok(())
    }
}
