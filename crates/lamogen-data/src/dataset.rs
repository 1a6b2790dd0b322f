//! A data set in memory.

use std::collections::{HashMap, HashSet};
use std::ops::Range;
use std::path::{Path, PathBuf};

use burn::tensor::Device;
use lamogen_motion::{FeatureGroup, Motion, MotionError, Normalization, POSE_FEATURES};

use crate::entry::Entry;
use crate::error::DataError;
use crate::form::FolderFormat;
use crate::mirror::Mirror;
use crate::options::{LoadOptions, Progress};
use crate::problems::Problems;
use crate::rows::Rows;
use crate::split::Split;
use crate::statistics::Statistics;
use crate::{humanml3d, packed};

/// A data set in memory: motions with captions, their rows of pose features, and mean and standard deviation of the
/// features, which networks are trained with.
///
/// All rows are in memory, 16 bits per number: 0.5 kB per frame, about 2 GB for HumanML3D.
#[derive(Clone, Debug)]
pub struct Dataset {
    pub(crate) folder: PathBuf,
    pub(crate) entries: Vec<Entry>,
    pub(crate) rows: Rows,
    pub(crate) statistics: Statistics,
    pub(crate) mirror: Mirror,
    pub(crate) problems: Problems,
}

impl Dataset {
    /// Opens a folder in the packed form or in HumanML3D's form. `observer` gets the progress of reading.
    ///
    /// Motions that cannot be used are left out and listed in [`problems`](Self::problems).
    ///
    /// # Errors
    ///
    /// If the options allow no length, the folder has neither form, a file that all motions depend on is damaged, no
    /// usable motion is left, or the folder has no statistics and they cannot be computed.
    pub fn open(
        folder: impl AsRef<Path>,
        options: &LoadOptions,
        observer: &mut dyn FnMut(Progress),
    ) -> Result<Dataset, DataError> {
        let folder = folder.as_ref();
        options.check()?;
        match FolderFormat::of(folder)? {
            FolderFormat::Packed => packed::open(folder, options, observer),
            FolderFormat::HumanMl3d => humanml3d::open(folder, options, observer),
        }
    }

    /// Returns a data set of entries and their rows. Without `statistics` it computes them.
    ///
    /// # Errors
    ///
    /// If there is no entry, or statistics are not given and cannot be computed.
    pub(crate) fn new(
        folder: &Path,
        (entries, rows): (Vec<Entry>, Rows),
        mirror: Mirror,
        statistics: Option<Statistics>,
        problems: Problems,
    ) -> Result<Dataset, DataError> {
        if entries.is_empty() {
            return Err(DataError::Nothing {
                folder: folder.to_owned(),
                problems: problems.summary(),
            });
        }
        let statistics = match statistics {
            Some(statistics) => statistics,
            None => Statistics::of(&entries, &rows, &mirror).map_err(|problem| {
                DataError::Statistics {
                    folder: folder.to_owned(),
                    problem,
                }
            })?,
        };
        Ok(Dataset {
            folder: folder.to_owned(),
            entries,
            rows,
            statistics,
            mirror,
            problems,
        })
    }

    /// Joins several data sets into one, with statistics over all motions. Where an earlier data set already has a
    /// motion of the same name, the later motion's name gets its folder's name as a prefix.
    ///
    /// # Errors
    ///
    /// If there is no data set, the data sets define mirror images differently, or statistics cannot be computed.
    pub fn join(datasets: Vec<Dataset>) -> Result<Dataset, DataError> {
        let mut datasets = datasets.into_iter();
        let mut joined = datasets.next().ok_or(DataError::NoSource)?;
        let mut names: HashSet<String> = { joined.entries.iter() }
            .map(|entry| entry.name.clone())
            .collect();
        for other in datasets {
            if other.mirror != joined.mirror {
                return Err(DataError::Mirrors {
                    folder: joined.folder,
                    other: other.folder,
                });
            }
            let (clips, rows) = (joined.rows.clips(), joined.rows.len());
            let folder = other.folder.file_name().map_or_else(
                || "other".into(),
                |name| name.to_string_lossy().into_owned(),
            );
            let trials: HashSet<String> = { joined.entries.iter() }
                .filter_map(|entry| entry.trial.clone())
                .collect();
            // All names of the data set that are taken get the same prefix, so that variations find their originals.
            let renamed = |entry: &Entry, prefix: &str| {
                // The names of mirror images still begin with M.
                match entry.name.strip_prefix('M').filter(|_| entry.mirror) {
                    Some(name) => format!("M{prefix}_{name}"),
                    None => format!("{prefix}_{}", entry.name),
                }
            };
            let prefixes = (1..).map(|count| match count {
                1 => folder.clone(),
                count => format!("{folder}{count}"),
            });
            let is_free = |prefix: &String| {
                let mut all = other.entries.iter();
                all.all(|entry| !names.contains(&renamed(entry, prefix)))
            };
            let prefix = prefixes.into_iter().find(is_free).expect("a free prefix");
            let new_names: HashMap<String, String> = { other.entries.iter() }
                .filter(|entry| names.contains(&entry.name))
                .map(|entry| (entry.name.clone(), renamed(entry, &prefix)))
                .collect();
            for mut entry in other.entries {
                if let Some(name) = new_names.get(&entry.name) {
                    entry.name.clone_from(name);
                }
                if let Some(name) = { entry.variation_of.as_ref() }.and_then(|of| new_names.get(of))
                {
                    entry.variation_of = Some(name.clone());
                }
                if let Some(trial) = entry.trial.as_mut().filter(|trial| trials.contains(*trial)) {
                    *trial = format!("{prefix}_{trial}");
                }
                names.insert(entry.name.clone());
                entry.clip += clips;
                entry.start += rows;
                joined.entries.push(entry);
            }
            joined.rows.append(&other.rows);
            joined.problems.extend(other.problems.iter().cloned());
        }
        Dataset::new(
            &joined.folder,
            (joined.entries, joined.rows),
            joined.mirror,
            None,
            joined.problems,
        )
    }

    /// Writes the data set in the packed form: `motions.safetensors` and `captions.jsonl`. The folder appears with
    /// both files or not at all. Rows that no entry uses are left out.
    ///
    /// # Errors
    ///
    /// If the folder is not empty, unless `force` is set and it holds only a packed data set; or if it cannot be
    /// written.
    pub fn save(&self, folder: impl AsRef<Path>, force: bool) -> Result<(), DataError> {
        packed::write(self, folder.as_ref(), force)
    }

    /// Checks that [`save`](Self::save) may write to a folder. Call it before long work.
    ///
    /// # Errors
    ///
    /// If the folder is not empty, unless `force` is set and it holds only a packed data set.
    pub fn check_free(folder: impl AsRef<Path>, force: bool) -> Result<(), DataError> {
        packed::check_free(folder.as_ref(), force)
    }

    /// Returns the folder that the data set was read from.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Returns all entries, in the order of the files.
    pub fn entries(&self) -> &[Entry] {
        &self.entries
    }

    /// Returns the entries of a split.
    pub fn split(&self, split: Split) -> impl Iterator<Item = &Entry> {
        let entries = self.entries.iter();
        entries.filter(move |entry| entry.split == split)
    }

    /// Returns the indices of a split's entries in [`entries`](Self::entries).
    pub fn indices(&self, split: Split) -> impl Iterator<Item = usize> + '_ {
        let entries = self.entries.iter().enumerate();
        entries.filter_map(move |(index, entry)| (entry.split == split).then_some(index))
    }

    /// Returns the mean of every feature, `[263]`: over the training split, unless other statistics were
    /// [given](Self::with_normalization).
    pub fn mean(&self) -> &[f32] {
        &self.statistics.mean
    }

    /// Returns the standard deviation of every feature over the training split, `[263]`, above 0.
    ///
    /// A computed deviation is the same for all features of a [`FeatureGroup`]: the mean of their own deviations, or 1
    /// for a group that never changes.
    pub fn std(&self) -> &[f32] {
        &self.statistics.std
    }

    /// Returns the groups of features that never change in the training frames, so that their deviation is 1. There are
    /// usually none.
    pub fn unchanging(&self) -> impl Iterator<Item = FeatureGroup> + '_ {
        let groups = FeatureGroup::ALL.into_iter();
        groups.filter(|group| self.std()[group.range()].iter().all(|std| *std == 1.0))
    }

    /// Replaces the statistics that motions are normalised with, for example by those of a network that was trained on
    /// other data.
    ///
    /// # Panics
    ///
    /// If the statistics are not of 263 features.
    pub fn with_normalization(self, normalization: &Normalization) -> Self {
        assert_eq!(
            normalization.features(),
            POSE_FEATURES,
            "statistics of the features of a pose"
        );
        let [mean, std] = normalization.values();
        let statistics = Statistics { mean, std };
        Dataset { statistics, ..self }
    }

    /// Returns mean and standard deviation as tensors on a device.
    pub fn normalization(&self, device: &Device) -> Normalization {
        let checked = "statistics are finite and above 0 since the data set was opened";
        Normalization::from_slices(self.mean(), self.std(), device).expect(checked)
    }

    /// Appends the pose features of an entry's frames to `out`, 263 numbers per frame. They are not normalised: metres,
    /// radians, 20 frames per second.
    ///
    /// # Panics
    ///
    /// If the frames are not within the entry, or the entry belongs to another data set.
    pub fn features(&self, entry: &Entry, frames: Range<usize>, out: &mut Vec<f32>) {
        self.append_rows(entry, frames, out, |row| row);
    }

    /// Converts an entry to a motion.
    ///
    /// # Errors
    ///
    /// If the entry's rows give positions that are not finite.
    ///
    /// # Panics
    ///
    /// If the entry belongs to another data set.
    pub fn motion(&self, entry: &Entry) -> Result<Motion, MotionError> {
        let mut rows = Vec::new();
        self.features(entry, 0..entry.frames, &mut rows);
        Motion::from_pose_features(rows.as_chunks().0.to_vec())
    }

    /// Appends the normalised pose features of an entry's frames to `out`: `(x - mean) / std` of each number that
    /// [`features`](Self::features) appends.
    ///
    /// # Panics
    ///
    /// As [`features`](Self::features).
    pub fn normalized(&self, entry: &Entry, frames: Range<usize>, out: &mut Vec<f32>) {
        let (mean, std) = (self.mean(), self.std());
        self.append_rows(entry, frames, out, |mut row| {
            for ((value, mean), std) in row.iter_mut().zip(mean).zip(std) {
                *value = (*value - mean) / std;
            }
            row
        });
    }

    /// Appends an entry's rows to `out`, mirrored if the entry is a mirror image, each changed by `transform`.
    fn append_rows(
        &self,
        entry: &Entry,
        frames: Range<usize>,
        out: &mut Vec<f32>,
        transform: impl Fn([f32; POSE_FEATURES]) -> [f32; POSE_FEATURES],
    ) {
        assert!(
            frames.start <= frames.end && frames.end <= entry.frames,
            "frames {frames:?} of `{}`, which has {}",
            entry.name,
            entry.frames
        );
        out.reserve(frames.len() * POSE_FEATURES);
        for frame in frames {
            let row = self.rows.row(entry.start + frame);
            let row = match entry.mirror {
                true => self.mirror.apply(&row),
                false => row,
            };
            out.extend(transform(row));
        }
    }

    /// Returns the mapping from the stored rows of a mirrored entry to its features.
    pub fn mirror(&self) -> &Mirror {
        &self.mirror
    }

    /// Returns the motions that were left out, with the reasons.
    pub fn problems(&self) -> &Problems {
        &self.problems
    }
}
