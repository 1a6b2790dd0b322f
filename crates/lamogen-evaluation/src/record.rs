//! The records of motions: one line of JSON each, so that a run can stop at any time and go on later.

use std::collections::HashMap;
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{BufRead, BufReader, ErrorKind, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use lamogen::COMPONENTS;
use serde::{Deserialize, Serialize};

use super::error::{EvaluationError, EvaluationErrorKind};

/// The key of a motion's record.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct RecordKey {
    /// The setting, the condition, the prompt and the repeat of the motion in words and numbers.
    pub id: String,
    /// A checksum of all options that the motion is generated with, since settings of one name may have other options
    /// in another run.
    pub options: String,
}

/// The record of one motion.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MotionRecord {
    #[serde(flatten)]
    pub key: RecordKey,
    pub result: MotionOutcome,
}

/// The measurements of a motion, or the reason why there is no motion.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum MotionOutcome {
    Motion(Box<MotionMeasurements>),
    Failed(String),
}

/// The measurements of a motion.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MotionMeasurements {
    /// The maxima over time of the Laban features.
    pub maximum: [f64; COMPONENTS],
    /// The means over time of the Laban features.
    pub mean: [f64; COMPONENTS],
    /// The maxima of the baseline: the motion of the sentence alone, from the same noise.
    pub baseline_maximum: [f64; COMPONENTS],
    /// The means of the baseline.
    pub baseline_mean: [f64; COMPONENTS],
    /// The mean distance of the joints from those of the baseline, both in the form that is measured, in metres.
    pub distance: f64,
    #[serde(flatten)]
    pub body: BodyMeasurements,
    /// The embedding by the evaluator.
    pub point: Vec<f32>,
}

/// The measurements of a motion's joints.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct BodyMeasurements {
    /// The share of steps in which a standing foot slides.
    pub sliding: f64,
    /// The mean speed at which a standing foot moves along the ground, in m/s.
    pub sliding_speed: f64,
    /// The mean second difference of the ankles, in mm a frame².
    pub ankles: f64,
    /// The mean jerk of all joints, in m/s³.
    pub jerk: f64,
    /// The largest deviation of a bone from its median length, in m.
    pub drift: f64,
    /// How deep the deepest joint is below the floor, in m: the 99th percentile over frames.
    pub below_floor: f64,
    pub turning: TurnMeasurements,
}

/// How far joints turn from one frame to the next, in degrees.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TurnMeasurements {
    /// The mean of all joints but the pelvis.
    pub mean: f64,
    /// The largest turn of all joints but the pelvis.
    pub largest: f64,
    /// The largest turn of the pelvis.
    pub pelvis: f64,
    /// How often the pelvis turns by more than 60° between two frames.
    pub pelvis_snaps: usize,
    pub spine3: JointTurnMeasurements,
    pub neck: JointTurnMeasurements,
    pub left_shoulder: JointTurnMeasurements,
    pub right_shoulder: JointTurnMeasurements,
}

/// How far one joint turns from one frame to the next, in degrees.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct JointTurnMeasurements {
    pub mean: f64,
    pub largest: f64,
}

/// The record file that a run or a shard writes. It is locked while it is open.
pub struct RecordFile {
    path: PathBuf,
    file: File,
}

impl RecordFile {
    /// Opens a record file, or makes one. An incomplete last line is removed. Only one process can open a file at a
    /// time.
    pub fn open(path: &Path) -> Result<RecordFile, EvaluationError> {
        let failed = |error| EvaluationError::output(path, error);
        let mut file = OpenOptions::new()
            .create(true)
            .truncate(false)
            .read(true)
            .write(true)
            .open(path)
            .map_err(failed)?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                let message = format!("{}: another process generates into it", path.display());
                return Err(EvaluationError::new(EvaluationErrorKind::Options, message));
            }
            // Some file systems do not support locks.
            Err(TryLockError::Error(error)) if error.kind() == ErrorKind::Unsupported => {}
            Err(TryLockError::Error(error)) => return Err(failed(error)),
        }
        let (_, end) = parse_records(&file, path)?;
        file.set_len(end).map_err(failed)?;
        file.seek(SeekFrom::End(0)).map_err(failed)?;
        Ok(RecordFile {
            path: path.to_owned(),
            file,
        })
    }

    /// Adds a record.
    pub fn add(&mut self, record: &MotionRecord) -> Result<(), EvaluationError> {
        let mut line = serde_json::to_string(record)
            .map_err(|error| EvaluationError::new(EvaluationErrorKind::Generation, error))?;
        line.push('\n');
        { self.file.write_all(line.as_bytes()) }
            .map_err(|error| EvaluationError::output(&self.path, error))
    }
}

/// Reads all records of some files.
pub fn read_records(
    paths: &[PathBuf],
) -> Result<HashMap<RecordKey, MotionOutcome>, EvaluationError> {
    let mut all = HashMap::new();
    for path in paths {
        let file = File::open(path).map_err(|error| {
            EvaluationError::new(
                EvaluationErrorKind::Input,
                format!("{}: {error}", path.display()),
            )
        })?;
        let (records, _) = parse_records(&file, path)?;
        all.extend(
            records
                .into_iter()
                .map(|record| (record.key, record.result)),
        );
    }
    Ok(all)
}

/// Parses the records of a file. Returns them, and the place in bytes where the last complete one ends.
fn parse_records(file: &File, path: &Path) -> Result<(Vec<MotionRecord>, u64), EvaluationError> {
    let failed = |error| {
        EvaluationError::new(
            EvaluationErrorKind::Input,
            format!("{}: {error}", path.display()),
        )
    };
    let mut reader = BufReader::new(file);
    let (mut records, mut end, mut line) = (Vec::new(), 0, Vec::new());
    while reader.read_until(b'\n', &mut line).map_err(failed)? > 0 {
        match serde_json::from_slice(&line) {
            Ok(record) if line.ends_with(b"\n") => records.push(record),
            // Only the last line can be incomplete, after a stop while it was being written.
            _ if reader.fill_buf().map_err(failed)?.is_empty() => break,
            _ => {
                let line = records.len() + 1;
                let message = format!("{}: line {line} is no record", path.display());
                return Err(EvaluationError::new(EvaluationErrorKind::Input, message)
                    .hint("without that line its motion is generated again"));
            }
        }
        end += line.len() as u64;
        line.clear();
    }
    Ok((records, end))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(id: &str) -> RecordKey {
        RecordKey {
            id: id.into(),
            options: "1f".into(),
        }
    }

    fn failed(id: &str) -> MotionRecord {
        MotionRecord {
            key: key(id),
            result: MotionOutcome::Failed("too wild".into()),
        }
    }

    #[test]
    fn an_incomplete_last_line_is_removed_and_other_wrong_lines_are_errors() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("records.jsonl");
        let mut store = RecordFile::open(&path).unwrap();
        store.add(&failed("a")).unwrap();
        store.add(&failed("b")).unwrap();
        let Err(busy) = RecordFile::open(&path) else {
            panic!("two write at once");
        };
        assert!(busy.message.contains("another process"), "{}", busy.message);
        drop(store);
        let whole = std::fs::read(&path).unwrap();
        std::fs::write(&path, &whole[..whole.len() - 5]).unwrap();
        let mut store = RecordFile::open(&path).unwrap();
        let records = read_records(std::slice::from_ref(&path)).unwrap();
        assert!(records.contains_key(&key("a")) && !records.contains_key(&key("b")));
        store.add(&failed("b")).unwrap();
        drop(store);
        assert_eq!(std::fs::read(&path).unwrap(), whole);
        assert_eq!(read_records(std::slice::from_ref(&path)).unwrap().len(), 2);
        std::fs::write(&path, [b"{}\n", &whole[..]].concat()).unwrap();
        let Err(failure) = RecordFile::open(&path) else {
            panic!("a broken line was read");
        };
        assert!(failure.message.contains("line 1"), "{}", failure.message);
    }
}
