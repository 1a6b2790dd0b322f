//! The file of a run's losses, one JSON line for each step or validation.

use std::fs::{File, OpenOptions};
use std::io::{self, BufRead, BufReader, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::error::TrainError;
use crate::trainer::StepReport;

/// A line of `losses.jsonl`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum LogLine {
    /// A validation loss.
    Validation {
        /// The number of steps before the measurement.
        step: u64,
        /// The loss of the averaged weights on the validation split.
        validation_loss: f64,
    },
    /// The report of a step.
    Step(StepReport),
}

impl LogLine {
    /// Returns the step to which the line belongs.
    pub fn step(&self) -> u64 {
        match self {
            LogLine::Validation { step, .. } => *step,
            LogLine::Step(report) => report.step,
        }
    }

    /// Reads a file up to the first invalid line, such as one that was cut off while it was written.
    ///
    /// # Errors
    ///
    /// If the file cannot be read.
    pub fn read(path: impl AsRef<Path>) -> Result<Vec<LogLine>, TrainError> {
        let path = path.as_ref();
        let file = File::open(path).map_err(|reason| TrainError::io(path, reason))?;
        Ok(parse(file, path)?
            .into_iter()
            .map(|(line, _)| line)
            .collect())
    }
}

/// Returns the lines before the first invalid one, each with the position of its end in the file.
fn parse(file: File, path: &Path) -> Result<Vec<(LogLine, u64)>, TrainError> {
    let io = |reason| TrainError::io(path, reason);
    let mut reader = BufReader::new(file);
    let (mut lines, mut end) = (Vec::new(), 0);
    let mut text = Vec::new();
    while reader.read_until(b'\n', &mut text).map_err(io)? > 0 {
        end += text.len() as u64;
        match serde_json::from_slice(&text) {
            Ok(line) if text.ends_with(b"\n") => lines.push((line, end)),
            _ => break,
        }
        text.clear();
    }
    Ok(lines)
}

/// The open `losses.jsonl` of a run, to which lines are appended.
pub(crate) struct LossLog {
    path: PathBuf,
    file: File,
}

impl LossLog {
    /// Opens the file of a run that has made `step` steps. Removes the lines of later steps, since these steps are made again.
    pub(crate) fn open(run: &Path, step: u64) -> Result<LossLog, TrainError> {
        let path = run.join("losses.jsonl");
        let io = |reason| TrainError::io(&path, reason);
        let file = OpenOptions::new()
            .create(true)
            .truncate(false)
            .read(true)
            .write(true)
            .open(&path)
            .map_err(io)?;
        let lines = parse(file.try_clone().map_err(io)?, &path)?;
        let last_kept = lines.iter().rfind(|(line, _)| line.step() <= step);
        let (last, end) = last_kept.map_or((0, 0), |(line, end)| (line.step(), *end));
        if last < step {
            return Err(TrainError::Checkpoint {
                problem: format!("expected the losses of {step} steps, found those of {last}"),
                path,
            });
        }
        let mut file = file;
        file.set_len(end).map_err(io)?;
        file.seek(SeekFrom::End(0)).map_err(io)?;
        Ok(LossLog { path, file })
    }

    /// Writes all lines through to the disk.
    pub(crate) fn sync(&self) -> Result<(), TrainError> {
        let synced = self.file.sync_data();
        synced.map_err(|reason| TrainError::io(&self.path, reason))
    }

    /// Appends a line.
    pub(crate) fn write(&mut self, line: &LogLine) -> Result<(), TrainError> {
        let mut text = serde_json::to_string(line).expect("numbers are JSON");
        text.push('\n');
        let written: io::Result<()> = self.file.write_all(text.as_bytes());
        written.map_err(|reason| TrainError::io(&self.path, reason))
    }
}
