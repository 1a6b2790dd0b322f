//! Checkpoints, from which a run resumes as if it had never been stopped.
//!
//! ```text
//! RUN/checkpoints/step-00001000/  network.bpk, average.bpk, moment_1.bpk, moment_2.bpk, state.json
//! ```
//!
//! All random draws of a step depend on the number of the step alone. A checkpoint therefore needs neither the state of a random
//! number generator nor a position in the data.

use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use burn::module::Module;
use serde::{Deserialize, Serialize};

use crate::error::TrainError;
use crate::task::TrainingTask;
use crate::trainer::{Trainer, TrainerState, with_autodiff};

/// The number of checkpoints that are kept: the newest, and the one before it in case a disk error damages the newest.
const CHECKPOINTS_KEPT: usize = 2;

/// The files of a checkpoint that hold networks: the weights, their average, and their two moments.
const NETWORK_FILES: [&str; 4] = ["network.bpk", "average.bpk", "moment_1.bpk", "moment_2.bpk"];

/// The contents of a checkpoint's `state.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct CheckpointState {
    /// The number of steps that were made.
    pub(crate) step: u64,
    /// The number of all steps of the run, once it is known.
    pub(crate) steps: Option<u64>,
    /// The lowest validation loss so far.
    pub(crate) best: Option<f32>,
}

/// The folder of a run's checkpoints.
pub(crate) struct CheckpointFolder {
    folder: PathBuf,
}

impl CheckpointFolder {
    /// Returns the folder of checkpoints in the folder of a run.
    pub(crate) fn of(run: &Path) -> Self {
        CheckpointFolder {
            folder: run.join("checkpoints"),
        }
    }

    /// Returns the path of the newest complete checkpoint.
    pub(crate) fn newest(&self) -> Result<Option<PathBuf>, TrainError> {
        Ok(self.paths_with_prefix("step-")?.pop())
    }

    /// Returns the sorted paths whose names begin with a prefix. The names of unfinished checkpoints begin with a dot.
    fn paths_with_prefix(&self, prefix: &str) -> Result<Vec<PathBuf>, TrainError> {
        let io = |reason| TrainError::io(&self.folder, reason);
        let entries = match fs::read_dir(&self.folder) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
            entries => entries.map_err(io)?,
        };
        let mut found = Vec::new();
        for entry in entries {
            let path = entry.map_err(io)?.path();
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            if name.starts_with(prefix) {
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
        state: &CheckpointState,
    ) -> Result<(), TrainError> {
        let name = format!("step-{:08}", state.step);
        let path = self.folder.join(&name);
        if path.exists() {
            return Ok(());
        }
        let temporary = self.folder.join(format!(".{name}"));
        let io = |reason| TrainError::io(&temporary, reason);
        // Unfinished checkpoints of a process that was killed.
        remove(&self.paths_with_prefix(".step-")?)?;
        fs::create_dir_all(&temporary).map_err(io)?;
        let TrainerState {
            network,
            average,
            moments: [first, second],
            ..
        } = &trainer.state;
        for (name, network) in NETWORK_FILES
            .into_iter()
            .zip([network, average, first, second])
        {
            let saved = network.valid().save_file(temporary.join(name));
            saved.map_err(|reason| TrainError::record(&temporary, reason))?;
        }
        let json = serde_json::to_vec_pretty(state).expect("numbers are JSON");
        let mut file = fs::File::create(temporary.join("state.json")).map_err(io)?;
        file.write_all(&json).map_err(io)?;
        file.sync_all().map_err(io)?;
        fs::rename(&temporary, &path).map_err(io)?;
        // The new checkpoint must be safely on the disk before old ones are removed.
        #[cfg(unix)]
        fs::File::open(&self.folder)
            .and_then(|folder| folder.sync_all())
            .map_err(io)?;
        let all = self.paths_with_prefix("step-")?;
        remove(&all[..all.len().saturating_sub(CHECKPOINTS_KEPT)])
    }
}

/// Removes folders with their contents.
fn remove(folders: &[PathBuf]) -> Result<(), TrainError> {
    for folder in folders {
        fs::remove_dir_all(folder).map_err(|reason| TrainError::io(folder, reason))?;
    }
    Ok(())
}

/// Reads the `state.json` of a checkpoint.
pub(crate) fn read_state(checkpoint: &Path) -> Result<CheckpointState, TrainError> {
    let path = checkpoint.join("state.json");
    let bytes = fs::read(&path).map_err(|reason| TrainError::io(&path, reason))?;
    serde_json::from_slice(&bytes).map_err(|reason| TrainError::Checkpoint {
        problem: reason.to_string(),
        path,
    })
}

impl<T: TrainingTask> Trainer<'_, T> {
    /// Loads the networks of a checkpoint that was written after `step` steps.
    pub(crate) fn restore(&mut self, checkpoint: &Path, step: u64) -> Result<(), TrainError> {
        let mut networks = NETWORK_FILES.into_iter().map(|name| {
            let path = checkpoint.join(name);
            let network = self.state.average.clone().try_load_file(&path);
            network.map_err(|reason| TrainError::record(&path, reason))
        });
        let mut next = || networks.next().expect("as many as there are names");
        // The parameter ids are those of the saved networks, and equal in all four of them: they match weights, averages and
        // moments.
        self.state = TrainerState {
            step,
            network: with_autodiff(next()?),
            average: next()?,
            moments: [next()?, next()?],
        };
        Ok(())
    }
}
