//! A data set in memory.

use std::collections::HashSet;
use std::ops::Range;
use std::path::{Path, PathBuf};

use burn::tensor::Device;
use lamogen_motion::{FeatureGroup, Motion, MotionError, Normalization, POSE_FEATURES};

use crate::entry::Entry;
use crate::error::DataError;
use crate::form::Form;
use crate::mirror::Mirror;
use crate::options::{LoadOptions, Progress};
use crate::problems::Problems;
use crate::rows::Rows;
use crate::split::Split;
use crate::statistics::Statistics;
use crate::{humanml3d, packed};

/// Motions with captions, their rows of pose features, and the statistics that networks are trained with.
///
/// All rows are in memory, 16 bits a number: 0.5 kB a frame, about 2 GB for HumanML3D.
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
    /// Opens a folder of either form: the packed one, or HumanML3D's. `observer` is told how far reading is.
    ///
    /// Motions that cannot be used are left out and listed in [`problems`](Self::problems).
    ///
    /// # Errors
    ///
    /// If the options allow no length, the folder has neither form, a file that stands for all motions is damaged, no motion is left, or there
    /// are no statistics and none can be computed.
    pub fn open(
        folder: impl AsRef<Path>,
        options: &LoadOptions,
        observer: &mut dyn FnMut(Progress),
    ) -> Result<Dataset, DataError> {
        let folder = folder.as_ref();
        options.check()?;
        match Form::of(folder)? {
            Form::Packed => packed::open(folder, options, observer),
            Form::HumanMl3d => humanml3d::open(folder, options, observer),
        }
    }

    /// A data set of what was read.
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

    /// All motions of several data sets as one, with statistics over all of them. A motion whose name another data set before has gets the name of
    /// its data set's folder in front.
    ///
    /// # Errors
    ///
    /// If there is no data set, their mirror images are made in different ways, or statistics cannot be computed.
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
            for mut entry in other.entries {
                if names.contains(&entry.name) {
                    // Mirror images keep their M in front.
                    entry.name = match entry.name.strip_prefix('M').filter(|_| entry.mirror) {
                        Some(name) => format!("M{folder}_{name}"),
                        None => format!("{folder}_{}", entry.name),
                    };
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

    /// Writes it in the packed form: `motions.safetensors` and `captions.jsonl`. The folder appears whole or not at
    /// all. Rows that no entry uses are left out.
    ///
    /// # Errors
    ///
    /// If there is anything in the folder but, with `force`, a packed data set; or it cannot be written.
    pub fn save(&self, folder: impl AsRef<Path>, force: bool) -> Result<(), DataError> {
        packed::write(self, folder.as_ref(), force)
    }

    /// Whether [`save`](Self::save) may write a folder, to be asked before long work.
    ///
    /// # Errors
    ///
    /// If there is anything in it but, with `force`, a packed data set.
    pub fn check_free(folder: impl AsRef<Path>, force: bool) -> Result<(), DataError> {
        packed::check_free(folder.as_ref(), force)
    }

    /// The folder that it was read from.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Every entry, in the order of the files.
    pub fn entries(&self) -> &[Entry] {
        &self.entries
    }

    /// The entries of a split.
    pub fn split(&self, split: Split) -> impl Iterator<Item = &Entry> {
        let entries = self.entries.iter();
        entries.filter(move |entry| entry.split == split)
    }

    /// Where the entries of a split are among [`entries`](Self::entries).
    pub fn indices(&self, split: Split) -> impl Iterator<Item = usize> + '_ {
        let entries = self.entries.iter().enumerate();
        entries.filter_map(move |(index, entry)| (entry.split == split).then_some(index))
    }

    /// The mean of every feature over the training split, `[263]`, unless others were [given](Self::with_normalization).
    pub fn mean(&self) -> &[f32] {
        &self.statistics.mean
    }

    /// The standard deviation of every feature over the training split, `[263]`, above 0. Where it was computed it is one
    /// number within each [`FeatureGroup`], the mean of its features' own, and 1 for a group that never changes.
    pub fn std(&self) -> &[f32] {
        &self.statistics.std
    }

    /// Groups of features whose deviation is 1 because they never change in the frames for training. Usually none.
    pub fn unchanging(&self) -> impl Iterator<Item = FeatureGroup> + '_ {
        let groups = FeatureGroup::ALL.into_iter();
        groups.filter(|group| self.std()[group.range()].iter().all(|std| *std == 1.0))
    }

    /// The same motions, normalised by other statistics: those of a network that was trained on other data.
    ///
    /// # Panics
    ///
    /// If they are not of 263 features.
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

    /// Mean and standard deviation as tensors.
    pub fn normalization(&self, device: &Device) -> Normalization {
        let checked = "statistics are finite and above 0 since the data set was opened";
        Normalization::from_slices(self.mean(), self.std(), device).expect(checked)
    }

    /// Appends frames of an entry to `out`, 263 numbers each, as they are: metres, radians, 20 frames a second.
    ///
    /// # Panics
    ///
    /// If the frames are not within the entry, or it is of another data set.
    pub fn features(&self, entry: &Entry, frames: Range<usize>, out: &mut Vec<f32>) {
        self.append(entry, frames, out, |row| row);
    }

    /// An entry as a motion.
    ///
    /// # Errors
    ///
    /// If its rows give positions that are not finite.
    ///
    /// # Panics
    ///
    /// If it is of another data set.
    pub fn motion(&self, entry: &Entry) -> Result<Motion, MotionError> {
        let mut rows = Vec::new();
        self.features(entry, 0..entry.frames, &mut rows);
        Motion::from_pose_features(rows.as_chunks().0.to_vec())
    }

    /// As [`features`](Self::features), normalised: `(x - mean) / std`.
    ///
    /// # Panics
    ///
    /// As [`features`](Self::features).
    pub fn normalized(&self, entry: &Entry, frames: Range<usize>, out: &mut Vec<f32>) {
        let (mean, std) = (self.mean(), self.std());
        self.append(entry, frames, out, |mut row| {
            for ((value, mean), std) in row.iter_mut().zip(mean).zip(std) {
                *value = (*value - mean) / std;
            }
            row
        });
    }

    fn append(
        &self,
        entry: &Entry,
        frames: Range<usize>,
        out: &mut Vec<f32>,
        of: impl Fn([f32; POSE_FEATURES]) -> [f32; POSE_FEATURES],
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
            out.extend(of(row));
        }
    }

    /// How a mirrored entry comes from its rows.
    pub fn mirror(&self) -> &Mirror {
        &self.mirror
    }

    /// What was left out, and why.
    pub fn problems(&self) -> &Problems {
        &self.problems
    }
}
