//! HumanML3D's folder, as its users have it.
//!
//! ```text
//! train.txt, val.txt, test.txt    names, one a line
//! new_joint_vecs/NAME.npy         pose features, [frames, 263]
//! texts/NAME.txt                  captions
//! Mean.npy, Std.npy               statistics, [263]; computed where they are not there
//! ```

mod text;

use std::collections::{HashMap, HashSet};
use std::io;
use std::ops::Range;
use std::path::Path;

use half::f16;
use lamogen_motion::npy::{self, NpyError};
use lamogen_motion::{FeatureGroup, POSE_FEATURES};
use rayon::prelude::*;

use crate::dataset::Dataset;
use crate::entry::{Caption, Entry};
use crate::error::DataError;
use crate::mirror::Mirror;
use crate::options::{LoadOptions, Progress};
use crate::problems::{Problem, ProblemKind, Problems, check_length};
use crate::rows::{Rows, to_half};
use crate::split::Split;
use crate::statistics::Statistics;

pub(crate) const VECTORS: &str = "new_joint_vecs";
pub(crate) const TEXTS: &str = "texts";

/// Clips that are read in parallel before the observer is told.
const TOGETHER: usize = 256;

/// The file that lists a split.
pub(crate) fn list(split: Split) -> &'static str {
    match split {
        Split::Train => "train.txt",
        Split::Validation => "val.txt",
        Split::Test => "test.txt",
    }
}

/// Opens a folder of HumanML3D's form.
///
/// # Errors
///
/// As [`Dataset::open`].
pub(crate) fn open(
    folder: &Path,
    options: &LoadOptions,
    observer: &mut dyn FnMut(Progress),
) -> Result<Dataset, DataError> {
    let statistics = statistics(folder)?;
    let mut problems = Problems::default();
    let names = names(folder, &mut problems)?;
    // The mirror image of 012345 is M012345, and of the same recording.
    let listed: HashSet<&str> = names.iter().map(|(name, _)| name.as_str()).collect();
    let mut rows = Rows::new();
    let mut entries = Vec::new();
    for (index, some) in names.chunks(TOGETHER).enumerate() {
        let read: Vec<Result<Clip, Problem>> = { some.par_iter() }
            .map(|(name, _)| clip(folder, name, options))
            .collect();
        for ((name, split), clip) in some.iter().zip(read) {
            match clip {
                Err(problem) => problems.extend([problem]),
                Ok(clip) => {
                    problems.extend(clip.left_out.iter().cloned());
                    let original = name.strip_prefix('M').filter(|name| listed.contains(name));
                    clip.add((name, original), *split, &mut rows, &mut entries);
                }
            }
        }
        if index == 0 {
            // The rest is about as long as the first clips are.
            rows.reserve(rows.len() * names.len().div_ceil(TOGETHER));
        }
        observer(Progress {
            done: index * TOGETHER + some.len(),
            all: names.len(),
        });
    }
    Dataset::new(folder, (entries, rows), Mirror::new(), statistics, problems)
}

/// All names that are listed, once each.
fn names(folder: &Path, problems: &mut Problems) -> Result<Vec<(String, Split)>, DataError> {
    let mut names = Vec::new();
    let mut seen: HashMap<String, Split> = HashMap::new();
    for split in Split::ALL {
        let path = folder.join(list(split));
        let text = match std::fs::read_to_string(&path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => continue,
            text => text.map_err(DataError::read(&path))?,
        };
        let listed = text.trim_start_matches('\u{feff}').lines().map(str::trim);
        for name in listed.filter(|name| !name.is_empty()) {
            match seen.insert(name.to_owned(), split) {
                None => names.push((name.to_owned(), split)),
                Some(first) => {
                    seen.insert(name.to_owned(), first);
                    let (first, again) = (list(first), list(split));
                    let reason = format!("listed in {first} already, again in {again}");
                    problems.add(name, ProblemKind::Twice, reason);
                }
            }
        }
    }
    Ok(names)
}

fn statistics(folder: &Path) -> Result<Option<Statistics>, DataError> {
    let paths = [folder.join("Mean.npy"), folder.join("Std.npy")];
    if !paths.iter().any(|path| path.exists()) {
        return Ok(None);
    }
    let [mean, std] = paths.each_ref().map(|path| {
        let array = npy::read(path)?;
        match array.shape.as_slice() {
            [POSE_FEATURES] | [1, POSE_FEATURES] => Ok(array.values),
            shape => Err(DataError::Shape {
                path: path.clone(),
                expected: format!("[{POSE_FEATURES}]"),
                found: shape.to_vec(),
            }),
        }
    });
    let statistics = Statistics {
        mean: mean?,
        std: std?,
    };
    match statistics.first_wrong() {
        None => Ok(Some(statistics)),
        Some((which, expected, feature, found)) => Err(DataError::Statistic {
            path: paths[usize::from(which == "std")].clone(),
            expected,
            feature,
            group: FeatureGroup::of(feature).map_or("", FeatureGroup::name),
            found,
        }),
    }
}

/// One motion's file with what is said of it.
struct Clip {
    rows: Vec<f16>,
    whole: Vec<Caption>,
    /// Captions of a part only, with its frames.
    parts: Vec<(Range<usize>, Caption)>,
    left_out: Vec<Problem>,
}

fn clip(folder: &Path, name: &str, options: &LoadOptions) -> Result<Clip, Problem> {
    let problem = |kind: ProblemKind, reason: String| Problem {
        name: name.to_owned(),
        kind,
        reason,
    };
    let vectors = folder.join(VECTORS).join(format!("{name}.npy"));
    let array = read(&vectors).map_err(|(kind, reason)| problem(kind, reason))?;
    let [frames, POSE_FEATURES] = array.shape[..] else {
        let found = array.shape;
        let reason = format!("expected the shape [frames, {POSE_FEATURES}], found {found:?}");
        return Err(problem(ProblemKind::Shape, reason));
    };
    check_length(frames, options).map_err(|(kind, reason)| problem(kind, reason))?;
    let rows = to_half(&array.values).map_err(|place| {
        let (frame, feature) = (place / POSE_FEATURES, place % POSE_FEATURES);
        let found = array.values[place];
        let reason = format!(
            "frame {frame}, feature {feature}: expected a number up to 65504, found {found}"
        );
        problem(ProblemKind::NotFinite, reason)
    })?;

    let path = folder.join(TEXTS).join(format!("{name}.txt"));
    let text = std::fs::read_to_string(&path).map_err(|error| {
        let kind = match error.kind() {
            io::ErrorKind::NotFound => ProblemKind::NoCaption,
            _ => ProblemKind::Unreadable,
        };
        problem(kind, format!("{}: {error}", path.display()))
    })?;
    let lines = text::parse(&text)
        .map_err(|reason| problem(ProblemKind::Line, format!("{}, {reason}", path.display())))?;
    if lines.is_empty() {
        let reason = format!("{}: expected a caption, found none", path.display());
        return Err(problem(ProblemKind::NoCaption, reason));
    }
    let mut clip = Clip {
        rows,
        whole: Vec::new(),
        parts: Vec::new(),
        left_out: Vec::new(),
    };
    for line in lines {
        let Some(part) = line.part else {
            clip.whole.push(line.caption);
            continue;
        };
        let part = part.start.min(frames)..part.end.min(frames);
        match check_length(part.len(), options) {
            Ok(()) => clip.parts.push((part, line.caption)),
            Err((kind, reason)) => {
                let text = &line.caption.text;
                let reason = format!("the part {part:?} of {text:?}: {reason}");
                clip.left_out.push(problem(kind, reason));
            }
        }
    }
    Ok(clip)
}

fn read(path: &Path) -> Result<npy::Array, (ProblemKind, String)> {
    // Whole, because so many small files are read faster so.
    let bytes = std::fs::read(path).map_err(|error| {
        let kind = match error.kind() {
            io::ErrorKind::NotFound => ProblemKind::Missing,
            _ => ProblemKind::Unreadable,
        };
        (kind, format!("{}: {error}", path.display()))
    })?;
    let unreadable = |error: NpyError| (ProblemKind::Unreadable, error.to_string());
    npy::read_bytes(&bytes, path).map_err(unreadable)
}

impl Clip {
    /// Adds it to a data set: an entry for all captions of the whole motion, and one for every caption of a part.
    fn add(
        self,
        (name, original): (&str, Option<&str>),
        split: Split,
        rows: &mut Rows,
        entries: &mut Vec<Entry>,
    ) {
        if self.whole.is_empty() && self.parts.is_empty() {
            return;
        }
        let trial = original.unwrap_or(name);
        let (clip, start) = (rows.clips(), rows.len());
        rows.push(&self.rows);
        let frames = self.rows.len() / POSE_FEATURES;
        let entry = |name: String, part: Range<usize>, captions: Vec<Caption>| Entry {
            name,
            split,
            frames: part.len(),
            mirror: false,
            variation_of: None,
            content: None,
            style: None,
            source: None,
            trial: Some(trial.to_owned()),
            note: None,
            captions,
            clip,
            start: start + part.start,
        };
        if !self.whole.is_empty() {
            entries.push(entry(name.to_owned(), 0..frames, self.whole));
        }
        // HumanML3D's users name parts A_012345 and so on, by a letter drawn by chance. That of the mirror image
        // is named as mirror images are, with an M in front.
        let (image, name) = match original {
            Some(original) => ("M", original),
            None => ("", name),
        };
        for (index, (part, caption)) in self.parts.into_iter().enumerate() {
            let letter = char::from(b'A' + (index % 26) as u8);
            let round = match index / 26 {
                0 => String::new(),
                round => round.to_string(),
            };
            entries.push(entry(
                format!("{image}{letter}{round}_{name}"),
                part,
                vec![caption],
            ));
        }
    }
}
