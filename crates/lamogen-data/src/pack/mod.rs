//! Packing data sets and motion files into the packed form.

pub(crate) mod listing;
mod motions;

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use lamogen_files::ReadOptions;

use crate::dataset::Dataset;
use crate::entry::{Caption, Entry};
use crate::error::DataError;
use crate::form::FolderFormat;
use crate::options::{LoadOptions, Progress};
use crate::packed;
use crate::problems::ProblemKind;
use crate::sides::{swap_sides, swap_sides_in_tokens};
use crate::split::Split;

/// Options of packing.
#[derive(Clone, Debug, PartialEq)]
pub struct PackOptions {
    /// The captions file of motion files. Every line is JSON such as
    /// `{"file": "walk.bvh", "captions": ["a person walks"]}`, or a file, a tab and a caption. Data sets have captions
    /// of their own and need no file.
    pub captions: Option<PathBuf>,
    /// A file of further captions for motions that already have some, by their names or kinds (see [`Dataset::add_captions`]).
    pub more_captions: Option<PathBuf>,
    /// A recipe of motions that are put together from training motions (see [`Dataset::add_compositions`]).
    pub compositions: Option<PathBuf>,
    /// The speeds at which copies of training motions are added (see [`Dataset::with_speeds`]).
    pub speeds: Vec<f32>,
    /// Whether mirror images of training entries are added, where an entry has none.
    pub mirror: bool,
    /// The least length of a motion in frames.
    pub min_frames: usize,
    /// The greatest length of a motion in frames. Longer motion files are cut into equal windows of at most so many
    /// frames, by default 196. Longer motions of a data set are left out; by default that is those of 200 frames and
    /// more.
    pub max_frames: Option<usize>,
    /// The seed of the hash that assigns motion files to splits, where the captions file has no split for them.
    pub seed: u64,
    /// The options of reading motion files.
    pub reading: ReadOptions,
    /// Whether a packed data set that is already in the output folder is replaced.
    pub force: bool,
}

impl Default for PackOptions {
    fn default() -> Self {
        PackOptions {
            captions: None,
            more_captions: None,
            compositions: None,
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
    /// Returns the limits on the lengths of a data set's motions.
    fn limits(&self) -> LoadOptions {
        let default = LoadOptions::default();
        LoadOptions {
            min_frames: self.min_frames,
            max_frames: self.max_frames.unwrap_or(default.max_frames),
        }
    }
}

/// The default length of the longest window that motion files are cut into, in frames.
const WINDOW: usize = 196;

/// Packs a folder into another folder and returns the data set that was written. The source is a data set in any form
/// that [`Dataset::open`] reads, or a folder of motion files with captions. Motions that were left out are listed in
/// the returned data set's [`problems`](Dataset::problems).
///
/// Motion files are those that [`lamogen_files::read`] reads; subfolders are searched, too. They are resampled to 20
/// frames per second, [put on HumanML3D's body](lamogen_motion::Rotations::on), cut, and encoded as
/// [canonical](lamogen_motion::encode_canonical) features. Arrays of pose features are used without change. If a file
/// begins with a pose that does not belong to the movement, as conversions of CMU's recordings do, this pose is left
/// out, unless the captions file gives a start. Files for which the captions file has no split are assigned to splits
/// by a hash of their names: 80 % training, 5 % validation, 15 % test.
///
/// Mirror images share the rows of their originals. Their names are those of the originals with an M in front, and left
/// and right are exchanged in their captions and contents. An entry `x` gets no mirror image if there is already an
/// entry named `Mx`.
///
/// # Errors
///
/// If the output folder is not free, the source cannot be opened, captions are missing or invalid, no usable motion is
/// left, or statistics cannot be computed.
pub fn pack(
    source: impl AsRef<Path>,
    out: impl AsRef<Path>,
    options: &PackOptions,
    observer: &mut dyn FnMut(Progress),
) -> Result<Dataset, DataError> {
    let (source, out) = (source.as_ref(), out.as_ref());
    packed::check_free(out, options.force)?;
    let dataset = match FolderFormat::recognise(source)? {
        Some(_) => open_dataset(source, options, observer)?,
        None => motions::read(source, options, observer)?,
    };
    finish(dataset, out, options)
}

/// Adds further captions and other speeds as the options say, and writes the data set.
fn finish(mut dataset: Dataset, out: &Path, options: &PackOptions) -> Result<Dataset, DataError> {
    if let Some(path) = &options.more_captions {
        for name in dataset.add_captions(path, options.seed)? {
            // A motion that was left out is already listed.
            if !dataset.problems.iter().any(|problem| problem.name == name) {
                let reason = format!("{} has captions of it", path.display());
                dataset.problems.add(name, ProblemKind::Missing, reason);
            }
        }
    }
    if let Some(path) = &options.compositions {
        let few = dataset.add_compositions(path, options.seed, &options.limits())?;
        for (content, count) in few {
            let reason = format!("only {count} motions could be put together from parts that fit");
            dataset.problems.add(content, ProblemKind::Missing, reason);
        }
    }
    if !options.speeds.is_empty() {
        dataset = dataset.with_speeds(&options.speeds, &options.limits());
    }
    dataset.save(out, options.force)?;
    Ok(dataset)
}

/// Packs several data sets into one folder (see [`Dataset::join`]). Each may be in any form that [`Dataset::open`]
/// reads. A single source may also be a folder of motion files, as for [`pack`].
///
/// # Errors
///
/// As [`pack`], and if one of several sources is not a data set.
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
        if FolderFormat::recognise(source)?.is_none() {
            return Err(DataError::NotADataset {
                folder: source.to_owned(),
            });
        }
        datasets.push(open_dataset(source, options, observer)?);
    }
    finish(Dataset::join(datasets)?, out, options)
}

/// Opens a source that is already a data set, and adds mirror images if the options ask for them.
///
/// # Errors
///
/// As [`Dataset::open`], and if the options have a captions file.
fn open_dataset(
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
        let images = mirror_images(&dataset.entries);
        dataset.entries.extend(images);
    }
    Ok(dataset)
}

/// Returns mirror images of the training entries that have none and are none.
fn mirror_images(entries: &[Entry]) -> Vec<Entry> {
    let names: HashSet<&str> = entries.iter().map(|entry| &*entry.name).collect();
    let lacks_image = |entry: &&Entry| {
        // If the original of an image was left out, the image is still recognised by its recording.
        let trial = entry.trial.as_deref();
        let is_image = entry.name.strip_prefix('M').is_some_and(|original| {
            names.contains(original) || trial.is_some_and(|trial| original.ends_with(trial))
        });
        let has_image = names.contains(&*image_name(&entry.name));
        entry.split == Split::Train && !entry.mirror && !is_image && !has_image
    };
    entries
        .iter()
        .filter(lacks_image)
        .map(mirror_image)
        .collect()
}

/// Returns the mirror image of an entry, which shares its rows.
pub(crate) fn mirror_image(entry: &Entry) -> Entry {
    Entry {
        name: image_name(&entry.name),
        mirror: true,
        content: entry.content.as_deref().map(swap_sides),
        captions: { entry.captions.iter() }
            .map(|caption| Caption {
                text: swap_sides(&caption.text),
                tokens: caption.tokens.as_deref().map(swap_sides_in_tokens),
            })
            .collect(),
        ..entry.clone()
    }
}

fn image_name(name: &str) -> String {
    format!("M{name}")
}
