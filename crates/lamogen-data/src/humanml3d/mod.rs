//! HumanML3D's folder in its usual layout.
//!
//! ```text
//! train.txt, val.txt, test.txt    names, one per line
//! new_joint_vecs/NAME.npy         pose features, [frames, 263]
//! texts/NAME.txt                  captions
//! Mean.npy, Std.npy               statistics, [263]; computed if the files are missing
//! ```

pub(crate) mod benchmark;
pub(crate) mod text;

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

pub use benchmark::{BenchmarkClip, BenchmarkSplit};

/// The folder of the pose features.
pub(crate) const VECTORS: &str = "new_joint_vecs";
/// The folder of the captions.
pub(crate) const TEXTS: &str = "texts";

/// The number of clips that are read in parallel before the observer is called.
const CLIPS_PER_BATCH: usize = 256;

/// Returns the name of the file that lists a split.
pub(crate) fn list_file(split: Split) -> &'static str {
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
    let statistics = read_statistics(folder)?;
    let mut problems = Problems::default();
    let names = read_names(folder, &mut problems)?;
    // The mirror image of 012345 is M012345; both are of the same recording.
    let listed: HashSet<&str> = names.iter().map(|(name, _)| name.as_str()).collect();
    let mut rows = Rows::new();
    let mut entries = Vec::new();
    for (index, batch) in names.chunks(CLIPS_PER_BATCH).enumerate() {
        let clips: Vec<Result<CaptionedClip, Problem>> = { batch.par_iter() }
            .map(|(name, _)| read_clip(folder, name, options))
            .collect();
        for ((name, split), clip) in batch.iter().zip(clips) {
            match clip {
                Err(problem) => problems.extend([problem]),
                Ok(clip) => {
                    problems.extend(clip.problems.iter().cloned());
                    let original = name.strip_prefix('M').filter(|name| listed.contains(name));
                    clip.add_to((name, original), *split, &mut rows, &mut entries);
                }
            }
        }
        if index == 0 {
            // The other clips are about as long as those of the first batch.
            rows.reserve(rows.len() * names.len().div_ceil(CLIPS_PER_BATCH));
        }
        observer(Progress {
            done: index * CLIPS_PER_BATCH + batch.len(),
            all: names.len(),
        });
    }
    Dataset::new(folder, (entries, rows), Mirror::new(), statistics, problems)
}

/// Reads the names of all splits. A name that is listed again is kept once and added to `problems`.
fn read_names(folder: &Path, problems: &mut Problems) -> Result<Vec<(String, Split)>, DataError> {
    let mut names = Vec::new();
    let mut split_of: HashMap<String, Split> = HashMap::new();
    for split in Split::ALL {
        let path = folder.join(list_file(split));
        let text = match std::fs::read_to_string(&path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => continue,
            text => text.map_err(DataError::read(&path))?,
        };
        let listed = text.trim_start_matches('\u{feff}').lines().map(str::trim);
        for name in listed.filter(|name| !name.is_empty()) {
            match split_of.insert(name.to_owned(), split) {
                None => names.push((name.to_owned(), split)),
                Some(first) => {
                    split_of.insert(name.to_owned(), first);
                    let (first, again) = (list_file(first), list_file(split));
                    let reason = format!("listed in {first} already, again in {again}");
                    problems.add(name, ProblemKind::Twice, reason);
                }
            }
        }
    }
    Ok(names)
}

/// Reads `Mean.npy` and `Std.npy`; `None` if the folder has neither.
fn read_statistics(folder: &Path) -> Result<Option<Statistics>, DataError> {
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
    match statistics.first_invalid() {
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

/// The pose features of a clip with its captions.
struct CaptionedClip {
    /// The pose features, 263 per frame.
    rows: Vec<f16>,
    /// The captions of the whole motion.
    captions: Vec<Caption>,
    /// The captions of a part of the motion, each with the part's frames.
    part_captions: Vec<(Range<usize>, Caption)>,
    /// The parts that are left out, with the reasons.
    problems: Vec<Problem>,
}

/// Reads the pose features and the captions of a clip.
fn read_clip(folder: &Path, name: &str, options: &LoadOptions) -> Result<CaptionedClip, Problem> {
    let problem = |kind: ProblemKind, reason: String| Problem {
        name: name.to_owned(),
        kind,
        reason,
    };
    let vectors = folder.join(VECTORS).join(format!("{name}.npy"));
    let array = read_array(&vectors).map_err(|(kind, reason)| problem(kind, reason))?;
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
    let mut clip = CaptionedClip {
        rows,
        captions: Vec::new(),
        part_captions: Vec::new(),
        problems: Vec::new(),
    };
    for line in lines {
        let Some(part) = line.part else {
            clip.captions.push(line.caption);
            continue;
        };
        let part = part.start.min(frames)..part.end.min(frames);
        match check_length(part.len(), options) {
            Ok(()) => clip.part_captions.push((part, line.caption)),
            Err((kind, reason)) => {
                let text = &line.caption.text;
                let reason = format!("the part {part:?} of {text:?}: {reason}");
                clip.problems.push(problem(kind, reason));
            }
        }
    }
    Ok(clip)
}

fn read_array(path: &Path) -> Result<npy::Array, (ProblemKind, String)> {
    // Reading each of the many small files in one piece is faster.
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

impl CaptionedClip {
    /// Adds the clip's rows and entries to a data set: one entry with all captions of the whole motion, and one entry
    /// for every caption of a part. `original` is the name of the original if the clip is a mirror image.
    fn add_to(
        self,
        (name, original): (&str, Option<&str>),
        split: Split,
        rows: &mut Rows,
        entries: &mut Vec<Entry>,
    ) {
        if self.captions.is_empty() && self.part_captions.is_empty() {
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
        if !self.captions.is_empty() {
            entries.push(entry(name.to_owned(), 0..frames, self.captions));
        }
        // Public code for HumanML3D names parts A_012345 and so on, with a random letter. Here the letters are in
        // order; the part of a mirror image has an M in front, like the mirror image itself.
        let (image_prefix, name) = match original {
            Some(original) => ("M", original),
            None => ("", name),
        };
        for (index, (part, caption)) in self.part_captions.into_iter().enumerate() {
            let letter = char::from(b'A' + (index % 26) as u8);
            let round = match index / 26 {
                0 => String::new(),
                round => round.to_string(),
            };
            entries.push(entry(
                format!("{image_prefix}{letter}{round}_{name}"),
                part,
                vec![caption],
            ));
        }
    }
}
