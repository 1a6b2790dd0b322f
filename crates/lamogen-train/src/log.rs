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

    /// Reads all whole lines of a file. A last line that was cut off while it was written is left out.
    ///
    /// # Errors
    ///
    /// If the file cannot be read, or a line is no line of losses.
    pub fn read(path: impl AsRef<Path>) -> Result<Vec<LogLine>, TrainError> {
        let path = path.as_ref();
        let file = File::open(path).map_err(|reason| TrainError::io(path, reason))?;
        Ok(parse(file, path)?
            .into_iter()
            .map(|(line, _)| line)
            .collect())
    }
}

/// Whole lines, and where each ends in the file.
fn parse(file: File, path: &Path) -> Result<Vec<(LogLine, u64)>, TrainError> {
    let io = |reason| TrainError::io(path, reason);
    let mut reader = BufReader::new(file);
    let (mut lines, mut end) = (Vec::new(), 0);
    let mut text = String::new();
    while reader.read_line(&mut text).map_err(io)? > 0 {
        if !text.ends_with('\n') {
            break;
        }
        end += text.len() as u64;
        let line = serde_json::from_str(&text).map_err(|reason| TrainError::Checkpoint {
            path: path.to_owned(),
            problem: format!("line {}: {reason}", lines.len() + 1),
        })?;
        lines.push((line, end));
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
        let end = keep.map_or(0, |(_, end)| *end);
        let mut file = file;
        file.set_len(end).map_err(io)?;
        file.seek(SeekFrom::End(0)).map_err(io)?;
        Ok(Log { path, file })
    }

    pub(crate) fn write(&mut self, line: &LogLine) -> Result<(), TrainError> {
        let mut text = serde_json::to_string(line).expect("numbers are JSON");
        text.push('\n');
        let written: io::Result<()> = self.file.write_all(text.as_bytes());
        written.map_err(|reason| TrainError::io(&self.path, reason))
    }
}
