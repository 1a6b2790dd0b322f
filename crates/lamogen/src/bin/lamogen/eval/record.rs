//! What is kept of every motion: a line of JSON each, so that a run can stop anywhere and go on.

use std::collections::HashMap;
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{BufRead, BufReader, ErrorKind, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use lamogen::COMPONENTS;
use serde::{Deserialize, Serialize};

use crate::failure::{Code, Failure};

/// Which motion a record is of.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Key {
    /// Which cell of the plan.
    pub id: String,
    /// A sum of all options that it is generated with: what is called the same may be generated otherwise.
    pub options: String,
}

/// One motion of a run, measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Record {
    #[serde(flatten)]
    pub key: Key,
    pub result: Outcome,
}

/// A motion, or why there is none.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Outcome {
    Motion(Box<Measured>),
    Failed(String),
}

/// What is known of a motion.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// Laban features by their maximum over time.
    pub maximum: [f64; COMPONENTS],
    /// By their mean.
    pub mean: [f64; COMPONENTS],
    /// Those of the motion that the sentence alone gives, from the same noise.
    pub baseline_maximum: [f64; COMPONENTS],
    pub baseline_mean: [f64; COMPONENTS],
    /// Mean distance of the joints from that motion, both as they are measured, in metres.
    pub distance: f64,
    #[serde(flatten)]
    pub body: Body,
    /// Where the evaluator sees it.
    pub point: Vec<f32>,
}

/// What is known of a motion by its joints alone.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Body {
    /// The share of steps in which a standing foot slides.
    pub sliding: f64,
    /// How fast a standing foot moves along the ground on average, m/s.
    pub sliding_speed: f64,
    /// Mean second difference of the ankles, mm a frame².
    pub ankles: f64,
    /// Mean jerk of all joints, m/s³.
    pub jerk: f64,
    /// How far the worst bone is from its median length, m.
    pub drift: f64,
    /// How deep the deepest joint is below the floor, m, but for one frame in a hundred.
    pub below_floor: f64,
    pub turning: Turning,
}

/// How far joints turn from one frame to the next, in degrees.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Turning {
    /// All joints but the pelvis on average.
    pub mean: f64,
    /// Any joint but the pelvis at most.
    pub largest: f64,
    /// The pelvis at most.
    pub pelvis: f64,
    /// How often the pelvis turns by more than 60°.
    pub pelvis_snaps: usize,
    pub spine3: JointTurn,
    pub neck: JointTurn,
    pub left_shoulder: JointTurn,
    pub right_shoulder: JointTurn,
}

/// How far one joint does, in degrees.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct JointTurn {
    pub mean: f64,
    pub largest: f64,
}

/// The file that a run, or a shard of it, writes; locked as long as it is open.
pub struct Store {
    path: PathBuf,
    file: File,
}

impl Store {
    /// Opens a file, or begins it. What was cut off while it was written is removed. One process writes at a time.
    pub fn open(path: &Path) -> Result<Store, Failure> {
        let failed = |error| Failure::output(path, error);
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
                return Err(Failure::new(Code::Usage, message));
            }
            // Some file systems have no locks.
            Err(TryLockError::Error(error)) if error.kind() == ErrorKind::Unsupported => {}
            Err(TryLockError::Error(error)) => return Err(failed(error)),
        }
        let (_, end) = parse(&file, path)?;
        file.set_len(end).map_err(failed)?;
        file.seek(SeekFrom::End(0)).map_err(failed)?;
        Ok(Store {
            path: path.to_owned(),
            file,
        })
    }

    /// Adds a record.
    pub fn add(&mut self, record: &Record) -> Result<(), Failure> {
        let mut line =
            serde_json::to_string(record).map_err(|error| Failure::new(Code::Run, error))?;
        line.push('\n');
        { self.file.write_all(line.as_bytes()) }.map_err(|error| Failure::output(&self.path, error))
    }
}

/// All records of some files.
pub fn read(paths: &[PathBuf]) -> Result<HashMap<Key, Outcome>, Failure> {
    let mut all = HashMap::new();
    for path in paths {
        let file = File::open(path)
            .map_err(|error| Failure::new(Code::Input, format!("{}: {error}", path.display())))?;
        let (records, _) = parse(&file, path)?;
        all.extend(
            records
                .into_iter()
                .map(|record| (record.key, record.result)),
        );
    }
    Ok(all)
}

/// The records of a file, and where the last whole one ends.
fn parse(file: &File, path: &Path) -> Result<(Vec<Record>, u64), Failure> {
    let failed = |error| Failure::new(Code::Input, format!("{}: {error}", path.display()));
    let mut reader = BufReader::new(file);
    let (mut records, mut end, mut line) = (Vec::new(), 0, Vec::new());
    while reader.read_until(b'\n', &mut line).map_err(failed)? > 0 {
        match serde_json::from_slice(&line) {
            Ok(record) if line.ends_with(b"\n") => records.push(record),
            // The last line may have been cut off; before it there is no reason to be.
            _ if reader.fill_buf().map_err(failed)?.is_empty() => break,
            _ => {
                let line = records.len() + 1;
                let message = format!("{}: line {line} is no record", path.display());
                return Err(Failure::new(Code::Input, message)
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

    fn key(id: &str) -> Key {
        Key {
            id: id.into(),
            options: "1f".into(),
        }
    }

    fn failed(id: &str) -> Record {
        Record {
            key: key(id),
            result: Outcome::Failed("too wild".into()),
        }
    }

    #[test]
    fn a_cut_line_is_forgotten_and_a_broken_one_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("records.jsonl");
        let mut store = Store::open(&path).unwrap();
        store.add(&failed("a")).unwrap();
        store.add(&failed("b")).unwrap();
        let Err(busy) = Store::open(&path) else {
            panic!("two write at once");
        };
        assert!(busy.message.contains("another process"), "{}", busy.message);
        drop(store);
        let whole = std::fs::read(&path).unwrap();
        std::fs::write(&path, &whole[..whole.len() - 5]).unwrap();
        let mut store = Store::open(&path).unwrap();
        let found = read(std::slice::from_ref(&path)).unwrap();
        assert!(found.contains_key(&key("a")) && !found.contains_key(&key("b")));
        store.add(&failed("b")).unwrap();
        drop(store);
        assert_eq!(std::fs::read(&path).unwrap(), whole);
        assert_eq!(read(std::slice::from_ref(&path)).unwrap().len(), 2);
        std::fs::write(&path, [b"{}\n", &whole[..]].concat()).unwrap();
        let Err(failure) = Store::open(&path) else {
            panic!("a broken line was read");
        };
        assert!(failure.message.contains("line 1"), "{}", failure.message);
    }
}
