//! A folder of motion files as a data set.

use std::collections::{BTreeSet, HashMap, HashSet};
use std::ops::Range;
use std::path::{Path, PathBuf};

use half::f16;
use lamogen_files::ReadOptions;
use lamogen_motion::{
    FRAMES_PER_SECOND, JOINTS, Motion, POSE_FEATURES, RestPose, Rotations, encode_canonical,
};
use rayon::prelude::*;

use super::listing::{self, Take};
use super::{PackOptions, WINDOW, mirrored};
use crate::dataset::Dataset;
use crate::entry::{Caption, Entry};
use crate::error::DataError;
use crate::mirror::Mirror;
use crate::options::{LoadOptions, Progress};
use crate::problems::{Problem, ProblemKind, Problems, check_length};
use crate::rows::{Rows, to_half};
use crate::split::Split;

/// Files that are read in parallel before the observer is told.
const TOGETHER: usize = 16;

/// A pose before the movement is left by a step in which joints move so far on average, in metres, and so many
/// times as far as in any of the steps after it. Measured on 45 of CMU's recordings: 0.1 to 0.35 m, and 3.3 times
/// or more.
const JUMP: f32 = 0.08;
const JUMP_RATIO: f32 = 2.5;
const AFTER_JUMP: usize = 5;

/// Reads motion files and what is said of them: see [`pack`](super::pack()).
pub(super) fn read(
    folder: &Path,
    options: &PackOptions,
    observer: &mut dyn FnMut(Progress),
) -> Result<Dataset, DataError> {
    let captions = options
        .captions
        .as_ref()
        .ok_or_else(|| DataError::Uncaptioned {
            folder: folder.to_owned(),
        })?;
    let limits = LoadOptions {
        min_frames: options.min_frames,
        max_frames: options.max_frames.unwrap_or(WINDOW),
    };
    limits.check()?;
    let takes = listing::read(captions)?;
    let mut problems = Problems::default();
    let listed: HashSet<&str> = takes.iter().map(|take| &*take.file).collect();
    for file in motion_files(folder)? {
        if !listed.contains(&*file) {
            let reason = format!("{}: no line about it", captions.display());
            problems.add(file, ProblemKind::NoCaption, reason);
        }
    }

    // A file is read once, whatever number of its parts are listed.
    let mut files: Vec<(&str, Vec<usize>)> = Vec::new();
    let mut places = HashMap::new();
    for (index, take) in takes.iter().enumerate() {
        let place = *places.entry(&*take.file).or_insert_with(|| {
            files.push((&take.file, Vec::new()));
            files.len() - 1
        });
        files[place].1.push(index);
    }
    let names = names(&takes);
    let mut packed = Packed {
        rows: Rows::new(),
        entries: Vec::new(),
        names: HashSet::new(),
        problems,
    };
    let mut done = 0;
    for some in files.chunks(TOGETHER) {
        let read: Vec<Result<Body, Problem>> = { some.par_iter() }
            .map(|(file, _)| Body::read(folder, file, &options.reading))
            .collect();
        for ((file, indices), body) in some.iter().zip(read) {
            let body = match body {
                Ok(body) => body,
                Err(problem) => {
                    packed.problems.extend([problem]);
                    continue;
                }
            };
            let split = Split::by_hash(file, options.seed);
            for &index in indices {
                let (take, name) = (&takes[index], &names[index]);
                let split = take.said.split.unwrap_or(split);
                packed.add(&body, (take, name, split), &limits);
            }
        }
        done += some.len();
        observer(Progress {
            done,
            all: files.len(),
        });
    }
    let Packed {
        rows,
        mut entries,
        problems,
        ..
    } = packed;
    if options.mirror {
        let mirrored = mirrored(&entries);
        entries.extend(mirrored);
    }
    Dataset::new(folder, (entries, rows), Mirror::new(), None, problems)
}

/// A file's movement on HumanML3D's body.
enum Body {
    Joints(Vec<[[f32; 3]; JOINTS]>),
    /// Features that a file has are taken as they are.
    Features(Vec<[f32; POSE_FEATURES]>),
}

impl Body {
    fn read(folder: &Path, file: &str, options: &ReadOptions) -> Result<Body, Problem> {
        let problem = |kind: ProblemKind, reason: String| Problem {
            name: file.to_owned(),
            kind,
            reason,
        };
        let path = folder.join(file);
        if !path.exists() {
            let reason = format!("{}: listed, but not there", path.display());
            return Err(problem(ProblemKind::Missing, reason));
        }
        let motion: Motion = lamogen_files::read(&path, options)
            .map_err(|error| problem(ProblemKind::Unreadable, error.to_string()))?
            .motion;
        if let Some(features) = motion.features() {
            return Ok(Body::Features(features.to_vec()));
        }
        let rotations = Rotations::of(&motion);
        if rotations.rest().leg() <= 0.0 {
            let reason = format!("{}: expected a body with legs", path.display());
            return Err(problem(ProblemKind::Unreadable, reason));
        }
        Ok(Body::Joints(rotations.on(&RestPose::humanml3d()).joints()))
    }

    /// Whether it begins with a pose that is none of the movement, such as the T-pose that conversions of CMU's
    /// recordings have before their first frame: then the whole body jumps once, and goes on slowly.
    fn begins_with_calibration(&self) -> bool {
        let Body::Joints(poses) = self else {
            return false;
        };
        let steps = poses.windows(2).map(|pair| {
            let distances = pair[0].iter().zip(&pair[1]).map(|(from, to)| {
                let squares = from.iter().zip(to).map(|(from, to)| (to - from).powi(2));
                squares.sum::<f32>().sqrt()
            });
            distances.sum::<f32>() / JOINTS as f32
        });
        let steps: Vec<f32> = steps.take(1 + AFTER_JUMP).collect();
        match steps.split_first() {
            Some((first, after)) if after.len() == AFTER_JUMP => {
                let fastest = after.iter().fold(0.0f32, |a, b| a.max(*b));
                *first > JUMP && *first > JUMP_RATIO * fastest
            }
            _ => false,
        }
    }

    /// Number of rows.
    fn len(&self) -> usize {
        match self {
            // A row is a step from a frame to the next.
            Body::Joints(poses) => poses.len() - 1,
            Body::Features(rows) => rows.len(),
        }
    }

    /// Some rows, as a motion of their own.
    fn rows(&self, range: Range<usize>) -> Result<Vec<f16>, String> {
        let rows = match self {
            Body::Joints(poses) => encode_canonical(&poses[range.start..=range.end]),
            Body::Features(rows) => rows[range].to_vec(),
        };
        to_half(rows.as_flattened()).map_err(|place| {
            let (frame, feature) = (place / POSE_FEATURES, place % POSE_FEATURES);
            format!("frame {frame}, feature {feature}: expected a number up to 65504")
        })
    }
}

/// What is packed so far.
struct Packed {
    rows: Rows,
    entries: Vec<Entry>,
    /// Those of the entries.
    names: HashSet<String>,
    problems: Problems,
}

impl Packed {
    /// Adds a take, in windows if it is long.
    fn add(
        &mut self,
        body: &Body,
        (take, name, split): (&Take, &str, Split),
        limits: &LoadOptions,
    ) {
        let frame = |seconds: f64| (seconds * f64::from(FRAMES_PER_SECOND)).round() as usize;
        let end = take
            .end
            .map_or(body.len(), |end| frame(end).min(body.len()));
        let calibrated = take.start.is_none() && body.begins_with_calibration();
        let start = take.start.map_or(usize::from(calibrated), frame).min(end);
        let frames = end - start;
        let windows = frames.div_ceil(limits.max_frames).max(1);
        for window in 0..windows {
            let name = match windows {
                1 => name.to_owned(),
                _ => format!("{name}_{}", window + 1),
            };
            if self.names.contains(&name) {
                let reason = format!("another file, or a part of one, is also named {name}");
                self.problems.add(name, ProblemKind::Twice, reason);
                continue;
            }
            let range = start + window * frames / windows..start + (window + 1) * frames / windows;
            if let Err((kind, reason)) = check_length(range.len(), limits) {
                self.problems.add(name, kind, reason);
                continue;
            }
            let values = match body.rows(range.clone()) {
                Ok(values) => values,
                Err(reason) => {
                    self.problems.add(name, ProblemKind::NotFinite, reason);
                    continue;
                }
            };
            self.names.insert(name.clone());
            self.entries.push(Entry {
                name,
                split,
                frames: range.len(),
                mirror: false,
                variation_of: None,
                content: take.said.content.clone(),
                style: take.said.style.clone(),
                source: take.said.source.clone(),
                trial: Some(take.file.clone()),
                note: note(calibrated, windows, window),
                captions: { take.said.captions.iter() }
                    .map(|text| Caption {
                        text: text.clone(),
                        tokens: None,
                    })
                    .collect(),
                clip: self.rows.clips(),
                start: self.rows.len(),
            });
            self.rows.push(&values);
        }
    }
}

/// What was done to a window.
fn note(calibrated: bool, windows: usize, window: usize) -> Option<String> {
    let left_out = calibrated.then(|| "the first pose of the file is left out".to_owned());
    let cut = (windows > 1).then(|| format!("window {} of {windows}", window + 1));
    let notes: Vec<String> = left_out.into_iter().chain(cut).collect();
    (!notes.is_empty()).then(|| notes.join("; "))
}

/// A name for every take: its file without the ending, and its part. Files that differ only in the ending keep it.
fn names(takes: &[Take]) -> Vec<String> {
    let stem = |file: &str| {
        Path::new(file)
            .with_extension("")
            .to_string_lossy()
            .into_owned()
    };
    let mut files: HashMap<String, BTreeSet<&str>> = HashMap::new();
    for take in takes {
        files
            .entry(stem(&take.file))
            .or_default()
            .insert(&take.file);
    }
    let name = |take: &Take| {
        let stem = stem(&take.file);
        let name = match files[&stem].len() {
            1 => stem,
            _ => take.file.clone(),
        };
        match (take.start, take.end) {
            (None, None) => name,
            (start, None) => format!("{name}@{}-", start.unwrap_or(0.0)),
            (start, Some(end)) => format!("{name}@{}-{end}", start.unwrap_or(0.0)),
        }
    };
    takes.iter().map(name).collect()
}

/// All motion files of a folder and its subfolders, as paths within it with slashes, in order.
fn motion_files(folder: &Path) -> Result<BTreeSet<String>, DataError> {
    let mut files = BTreeSet::new();
    let mut folders = vec![PathBuf::new()];
    while let Some(inner) = folders.pop() {
        let path = folder.join(&inner);
        for entry in std::fs::read_dir(&path).map_err(DataError::read(&path))? {
            let entry = entry.map_err(DataError::read(&path))?;
            let inner = inner.join(entry.file_name());
            // Links to folders are not followed: they may lead in circles.
            if entry.file_type().map_err(DataError::read(&path))?.is_dir() {
                folders.push(inner);
                continue;
            }
            let ending = inner
                .extension()
                .map(|ending| ending.to_string_lossy().to_lowercase());
            if ["bvh", "glb", "gltf", "npy"].contains(&ending.as_deref().unwrap_or("")) {
                let parts = inner.iter().map(|part| part.to_string_lossy());
                files.insert(parts.collect::<Vec<_>>().join("/"));
            }
        }
    }
    Ok(files)
}
