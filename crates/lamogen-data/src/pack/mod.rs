//! From what there is to the packed form.

mod listing;
mod motions;

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use lamogen_files::ReadOptions;

use crate::dataset::Dataset;
use crate::entry::{Caption, Entry};
use crate::error::DataError;
use crate::form::Form;
use crate::options::{LoadOptions, Progress};
use crate::packed;
use crate::problems::ProblemKind;
use crate::sides::{swap, swap_tokens};
use crate::split::Split;

/// How a data set is packed.
#[derive(Clone, Debug, PartialEq)]
pub struct PackOptions {
    /// What is said of motion files, one a line: JSON such as
    /// `{"file": "walk.bvh", "captions": ["a person walks"]}`, or file, tab, caption. Data sets have their own.
    pub captions: Option<PathBuf>,
    /// Further captions of motions that have some, known by their names (see [`Dataset::add_captions`]).
    pub more_captions: Option<PathBuf>,
    /// Speeds at which motions for training are added, beside their own (see [`Dataset::with_speeds`]).
    pub speeds: Vec<f32>,
    /// Whether training entries get mirror images, where they have none.
    pub mirror: bool,
    /// The shortest motion, in frames.
    pub min_frames: usize,
    /// The longest motion, in frames. Motion files that are longer are cut into equal windows, 196 frames if nothing is
    /// said; longer motions of a data set are left out, from 200 frames on if nothing is said.
    pub max_frames: Option<usize>,
    /// By what motion files are dealt out to splits, where no split is said.
    pub seed: u64,
    /// What is known of the motion files.
    pub reading: ReadOptions,
    /// Whether a packed data set that is already there is replaced.
    pub force: bool,
}

impl Default for PackOptions {
    fn default() -> Self {
        PackOptions {
            captions: None,
            more_captions: None,
            speeds: Vec::new(),
            mirror: true,
            min_frames: 40,
            max_frames: None,
            seed: 0,
            reading: ReadOptions::default(),
            force: false,
        }
    }
}

impl PackOptions {
    /// Which lengths motions of a data set may have.
    fn limits(&self) -> LoadOptions {
        let usual = LoadOptions::default();
        LoadOptions {
            min_frames: self.min_frames,
            max_frames: self.max_frames.unwrap_or(usual.max_frames),
        }
    }
}

/// The longest window that motion files are cut into, in frames.
const WINDOW: usize = 196;

/// Packs a folder into another: a data set of any form that [`Dataset::open`] knows, or motion files with captions.
/// Gives the data set that was written, with what was left out in its [`problems`](Dataset::problems).
///
/// Motion files are whatever [`lamogen_files::read`] reads, in subfolders too. They are resampled to 20 frames a second,
/// [put on HumanML3D's body](lamogen_motion::Rotations::on), cut, and encoded as
/// [canonical](lamogen_motion::encode_canonical) features; arrays of pose features are taken as they are. A pose before the
/// movement, as conversions of CMU's recordings have it, is left out unless the captions say where to start. Without a
/// split in the captions, files are dealt out by a hash of their names: 80 % training, 5 % validation, 15 % test.
///
/// Mirror images share the rows of their originals, are named with an M in front, and have left and right exchanged in
/// what is said of them. An entry whose name with an M in front is there already has one.
///
/// # Errors
///
/// If the folder to write is not free, the source cannot be opened, captions are missing or make no sense, no motion
/// is left, or statistics cannot be computed.
pub fn pack(
    source: impl AsRef<Path>,
    out: impl AsRef<Path>,
    options: &PackOptions,
    observer: &mut dyn FnMut(Progress),
) -> Result<Dataset, DataError> {
    let (source, out) = (source.as_ref(), out.as_ref());
    packed::check_free(out, options.force)?;
    let dataset = match Form::recognise(source)? {
        Some(_) => opened(source, options, observer)?,
        None => motions::read(source, options, observer)?,
    };
    finish(dataset, out, options)
}

/// Adds what else is said of the motions, and writes them.
fn finish(mut dataset: Dataset, out: &Path, options: &PackOptions) -> Result<Dataset, DataError> {
    if let Some(path) = &options.more_captions {
        for name in dataset.add_captions(path)? {
            // One that was left out is listed already.
            if !dataset.problems.iter().any(|problem| problem.name == name) {
                let reason = format!("{} has captions of it", path.display());
                dataset.problems.add(name, ProblemKind::Missing, reason);
            }
        }
    }
    if !options.speeds.is_empty() {
        dataset = dataset.with_speeds(&options.speeds, &options.limits());
    }
    dataset.save(out, options.force)?;
    Ok(dataset)
}

/// Packs several data sets into one folder (see [`Dataset::join`]); each may be of any form that [`Dataset::open`] knows.
///
/// # Errors
///
/// As [`pack`], and if one of several is no data set.
pub fn pack_all(
    sources: &[impl AsRef<Path>],
    out: impl AsRef<Path>,
    options: &PackOptions,
    observer: &mut dyn FnMut(Progress),
) -> Result<Dataset, DataError> {
    if let [source] = sources {
        return pack(source, out, options, observer);
    }
    let out = out.as_ref();
    packed::check_free(out, options.force)?;
    let mut datasets = Vec::with_capacity(sources.len());
    for source in sources.iter().map(AsRef::as_ref) {
        if Form::recognise(source)?.is_none() {
            return Err(DataError::NotADataset {
                folder: source.to_owned(),
            });
        }
        datasets.push(opened(source, options, observer)?);
    }
    finish(Dataset::join(datasets)?, out, options)
}

/// A data set that is one already.
fn opened(
    source: &Path,
    options: &PackOptions,
    observer: &mut dyn FnMut(Progress),
) -> Result<Dataset, DataError> {
    if options.captions.is_some() {
        return Err(DataError::Superfluous {
            folder: source.to_owned(),
        });
    }
    let mut dataset = Dataset::open(source, &options.limits(), observer)?;
    if options.mirror {
        let mirrored = mirrored(&dataset.entries);
        dataset.entries.extend(mirrored);
    }
    Ok(dataset)
}

/// The mirror images of training entries that have none.
fn mirrored(entries: &[Entry]) -> Vec<Entry> {
    let names: HashSet<&str> = entries.iter().map(|entry| &*entry.name).collect();
    let image = |name: &str| format!("M{name}");
    let alone = |entry: &&Entry| {
        // The original of an image may have been left out; the image's recording then still tells.
        let trial = entry.trial.as_deref();
        let is_image = entry.name.strip_prefix('M').is_some_and(|original| {
            names.contains(original) || trial.is_some_and(|trial| original.ends_with(trial))
        });
        let has_image = names.contains(&*image(&entry.name));
        entry.split == Split::Train && !entry.mirror && !is_image && !has_image
    };
    let mirror = |entry: &Entry| Entry {
        name: image(&entry.name),
        mirror: true,
        content: entry.content.as_deref().map(swap),
        captions: { entry.captions.iter() }
            .map(|caption| Caption {
                text: swap(&caption.text),
                tokens: caption.tokens.as_deref().map(swap_tokens),
            })
            .collect(),
        ..entry.clone()
    };
    entries.iter().filter(alone).map(mirror).collect()
}
