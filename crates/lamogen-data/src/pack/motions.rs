//! Reading a folder of motion files as a data set.

use std::collections::{BTreeSet, HashMap, HashSet};
use std::ops::Range;
use std::path::{Path, PathBuf};

use half::f16;
use lamogen_files::ReadOptions;
use lamogen_motion::{
    FRAMES_PER_SECOND, JOINTS, Motion, POSE_FEATURES, RestPose, Rotations, encode_canonical,
};
use rayon::prelude::*;

use super::listing::{self, ListedMotion};
use super::{PackOptions, WINDOW, mirror_images};
use crate::dataset::Dataset;
use crate::entry::{Caption, Entry};
use crate::error::DataError;
use crate::mirror::Mirror;
use crate::options::{LoadOptions, Progress};
use crate::problems::{Problem, ProblemKind, Problems, check_length};
use crate::rows::{Rows, to_half};
use crate::split::Split;

/// The number of files that are read in parallel before the observer is called.
const FILES_PER_BATCH: usize = 16;

// A file begins with a pose that does not belong to the movement if the joints move far in the first step, and much
// farther than in any of the next steps. In 45 of CMU's recordings, the joints move 0.1 to 0.35 m in the first step,
// and at least 3.3 times as far as in any of the next ones.

/// The least mean distance that the joints move in the first step, in metres.
const JUMP: f32 = 0.08;
/// The least ratio of that distance to the largest mean distance in the next steps.
const JUMP_RATIO: f32 = 2.5;
/// The number of next steps that are compared.
const AFTER_JUMP: usize = 5;

/// Reads motion files and their captions file: see [`pack`](super::pack()).
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
    let motions = listing::read(captions)?;
    let mut problems = Problems::default();
    let listed: HashSet<&str> = motions.iter().map(|motion| &*motion.file).collect();
    for file in motion_files(folder)? {
        if !listed.contains(&*file) {
            let reason = format!("{}: no line about it", captions.display());
            problems.add(file, ProblemKind::NoCaption, reason);
        }
    }

    // A file is read once, even if several parts of it are listed. Each file has the indices of its listed motions.
    let mut files: Vec<(&str, Vec<usize>)> = Vec::new();
    let mut file_indices = HashMap::new();
    for (index, motion) in motions.iter().enumerate() {
        let file_index = *file_indices.entry(&*motion.file).or_insert_with(|| {
            files.push((&motion.file, Vec::new()));
            files.len() - 1
        });
        files[file_index].1.push(index);
    }
    let names = entry_names(&motions);
    let mut builder = DatasetBuilder {
        rows: Rows::new(),
        entries: Vec::new(),
        names: HashSet::new(),
        problems,
    };
    let mut done = 0;
    for batch in files.chunks(FILES_PER_BATCH) {
        let results: Vec<Result<LoadedMotion, Problem>> = { batch.par_iter() }
            .map(|(file, _)| LoadedMotion::read(folder, file, &options.reading))
            .collect();
        for ((file, indices), result) in batch.iter().zip(results) {
            let loaded = match result {
                Ok(loaded) => loaded,
                Err(problem) => {
                    builder.problems.extend([problem]);
                    continue;
                }
            };
            let hashed_split = Split::by_hash(file, options.seed);
            for &index in indices {
                let (motion, name) = (&motions[index], &names[index]);
                let split = motion.description.split.unwrap_or(hashed_split);
                builder.add(&loaded, (motion, name, split), &limits);
            }
        }
        done += batch.len();
        observer(Progress {
            done,
            all: files.len(),
        });
    }
    let DatasetBuilder {
        rows,
        mut entries,
        problems,
        ..
    } = builder;
    if options.mirror {
        let images = mirror_images(&entries);
        entries.extend(images);
    }
    Dataset::new(folder, (entries, rows), Mirror::new(), None, problems)
}

/// The motion of a file.
enum LoadedMotion {
    /// Joint positions on HumanML3D's body, in metres.
    Joints(Vec<[[f32; 3]; JOINTS]>),
    /// The pose features of a file that holds such features, without change.
    Features(Vec<[f32; POSE_FEATURES]>),
}

impl LoadedMotion {
    fn read(folder: &Path, file: &str, options: &ReadOptions) -> Result<LoadedMotion, Problem> {
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
            return Ok(LoadedMotion::Features(features.to_vec()));
        }
        let rotations = Rotations::of(&motion);
        if rotations.rest().leg() <= 0.0 {
            let reason = format!("{}: expected a body with legs", path.display());
            return Err(problem(ProblemKind::Unreadable, reason));
        }
        Ok(LoadedMotion::Joints(
            rotations.on(&RestPose::humanml3d()).joints(),
        ))
    }

    /// Returns whether the motion begins with a pose that does not belong to the movement, such as the T-pose that
    /// conversions of CMU's recordings have before their first frame. The whole body then jumps in the first step and
    /// moves slowly in the next ones.
    fn begins_with_calibration(&self) -> bool {
        let LoadedMotion::Joints(poses) = self else {
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

    /// Returns the number of rows.
    fn len(&self) -> usize {
        match self {
            // A row describes the step from one frame to the next.
            LoadedMotion::Joints(poses) => poses.len() - 1,
            LoadedMotion::Features(rows) => rows.len(),
        }
    }

    /// Encodes a range of rows as a motion of its own.
    ///
    /// # Errors
    ///
    /// If 16 bits cannot hold a number.
    fn rows(&self, range: Range<usize>) -> Result<Vec<f16>, String> {
        let rows = match self {
            LoadedMotion::Joints(poses) => encode_canonical(&poses[range.start..=range.end]),
            LoadedMotion::Features(rows) => rows[range].to_vec(),
        };
        to_half(rows.as_flattened()).map_err(|place| {
            let (frame, feature) = (place / POSE_FEATURES, place % POSE_FEATURES);
            format!("frame {frame}, feature {feature}: expected a number up to 65504")
        })
    }
}

/// The rows, entries and problems of the files that were read so far.
struct DatasetBuilder {
    rows: Rows,
    entries: Vec<Entry>,
    /// The names of the entries.
    names: HashSet<String>,
    problems: Problems,
}

impl DatasetBuilder {
    /// Adds a listed motion, cut into windows if it is longer than `limits` allow.
    fn add(
        &mut self,
        loaded: &LoadedMotion,
        (motion, name, split): (&ListedMotion, &str, Split),
        limits: &LoadOptions,
    ) {
        let frame = |seconds: f64| (seconds * f64::from(FRAMES_PER_SECOND)).round() as usize;
        let end = motion
            .end
            .map_or(loaded.len(), |end| frame(end).min(loaded.len()));
        let skips_first = motion.start.is_none() && loaded.begins_with_calibration();
        let start = motion
            .start
            .map_or(usize::from(skips_first), frame)
            .min(end);
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
            let values = match loaded.rows(range.clone()) {
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
                content: motion.description.content.clone(),
                style: motion.description.style.clone(),
                source: motion.description.source.clone(),
                trial: Some(motion.file.clone()),
                note: window_note(skips_first, windows, window),
                captions: { motion.description.captions.iter() }
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

/// Returns a note on how a window was cut from its file; `None` if the whole file was used.
fn window_note(skips_first: bool, windows: usize, window: usize) -> Option<String> {
    let left_out = skips_first.then(|| "the first pose of the file is left out".to_owned());
    let cut = (windows > 1).then(|| format!("window {} of {windows}", window + 1));
    let notes: Vec<String> = left_out.into_iter().chain(cut).collect();
    (!notes.is_empty()).then(|| notes.join("; "))
}

/// Returns a name for every listed motion: its file without the extension, and its part. Files that differ only in the
/// extension keep it.
fn entry_names(motions: &[ListedMotion]) -> Vec<String> {
    let stem = |file: &str| {
        Path::new(file)
            .with_extension("")
            .to_string_lossy()
            .into_owned()
    };
    let mut files: HashMap<String, BTreeSet<&str>> = HashMap::new();
    for motion in motions {
        files
            .entry(stem(&motion.file))
            .or_default()
            .insert(&motion.file);
    }
    let name = |motion: &ListedMotion| {
        let stem = stem(&motion.file);
        let name = match files[&stem].len() {
            1 => stem,
            _ => motion.file.clone(),
        };
        match (motion.start, motion.end) {
            (None, None) => name,
            (start, None) => format!("{name}@{}-", start.unwrap_or(0.0)),
            (start, Some(end)) => format!("{name}@{}-{end}", start.unwrap_or(0.0)),
        }
    };
    motions.iter().map(name).collect()
}

/// Returns all motion files of a folder and its subfolders, as paths within the folder with slashes, sorted.
fn motion_files(folder: &Path) -> Result<BTreeSet<String>, DataError> {
    let mut files = BTreeSet::new();
    let mut folders = vec![PathBuf::new()];
    while let Some(inner) = folders.pop() {
        let path = folder.join(&inner);
        for entry in std::fs::read_dir(&path).map_err(DataError::read(&path))? {
            let entry = entry.map_err(DataError::read(&path))?;
            let inner = inner.join(entry.file_name());
            // Links to folders are not followed, because they may form cycles.
            if entry.file_type().map_err(DataError::read(&path))?.is_dir() {
                folders.push(inner);
                continue;
            }
            let extension = inner
                .extension()
                .map(|extension| extension.to_string_lossy().to_lowercase());
            if ["bvh", "glb", "gltf", "vrma", "npy"].contains(&extension.as_deref().unwrap_or("")) {
                let parts = inner.iter().map(|part| part.to_string_lossy());
                files.insert(parts.collect::<Vec<_>>().join("/"));
            }
        }
    }
    Ok(files)
}
