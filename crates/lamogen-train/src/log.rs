//! The losses of a run, line by line.

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
    /// A measurement on the validation split.
    Validation {
        /// After how many steps.
        step: u64,
        /// Of the averaged weights.
        validation_loss: f64,
    },
    /// A step.
    Step(StepReport),
}

impl LogLine {
    /// The step that it is of.
    pub fn step(&self) -> u64 {
        match self {
            LogLine::Validation { step, .. } => *step,
            LogLine::Step(report) => report.step,
        }
    }

    /// Reads a file up to the first line that is none, such as one that was cut off while it was written.
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

/// Lines up to the first that is no line of losses, and where each ends in the file.
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

/// The file that grows with a run.
pub(crate) struct Log {
    path: PathBuf,
    file: File,
}

impl Log {
    /// Opens the file of a run that has come to some step; what stands in it of later steps is removed, as these will be made again.
    pub(crate) fn open(run: &Path, step: u64) -> Result<Log, TrainError> {
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
        let keep = lines.iter().rfind(|(line, _)| line.step() <= step);
        let (last, end) = keep.map_or((0, 0), |(line, end)| (line.step(), *end));
        if last < step {
            return Err(TrainError::Checkpoint {
                problem: format!("expected the losses of {step} steps, found those of {last}"),
                path,
            });
        }
        let mut file = file;
        file.set_len(end).map_err(io)?;
        file.seek(SeekFrom::End(0)).map_err(io)?;
        Ok(Log { path, file })
    }

    /// Returns once all lines are on the disk.
    pub(crate) fn sync(&self) -> Result<(), TrainError> {
        let synced = self.file.sync_data();
        synced.map_err(|reason| TrainError::io(&self.path, reason))
    }

    pub(crate) fn write(&mut self, line: &LogLine) -> Result<(), TrainError> {
        let mut text = serde_json::to_string(line).expect("numbers are JSON");
        text.push('\n');
        let written: io::Result<()> = self.file.write_all(text.as_bytes());
        written.map_err(|reason| TrainError::io(&self.path, reason))
    }
}
