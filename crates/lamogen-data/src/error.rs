//! Errors that concern a whole data set. Problems with single motions are in [`Problems`](crate::Problems).

use std::io;
use std::path::{Path, PathBuf};

use lamogen_motion::npy::NpyError;

/// An error when a data set is opened, packed or written.
#[derive(Debug, thiserror::Error)]
pub enum DataError {
    /// A file or folder cannot be read.
    #[error("{path}: {reason}")]
    #[allow(missing_docs)]
    Read { path: PathBuf, reason: io::Error },
    /// A file or folder cannot be written.
    #[error("{path}: {reason}")]
    #[allow(missing_docs)]
    Write { path: PathBuf, reason: io::Error },
    /// The folder is in none of the known forms.
    #[error(
        "{folder}: expected motions.safetensors and captions.jsonl (the packed form), or new_joint_vecs, texts \
         and train.txt, val.txt or test.txt (HumanML3D's); found {found}"
    )]
    #[allow(missing_docs)]
    Form { folder: PathBuf, found: String },
    /// The file of the motions is not a safetensors file, or is cut short.
    #[error("{path}: not a readable safetensors file: {problem}")]
    #[allow(missing_docs)]
    Format { path: PathBuf, problem: String },
    /// A tensor is missing or cannot be used.
    #[error("{path}: tensor `{tensor}`: expected {expected}, found {found}")]
    #[allow(missing_docs)]
    Tensor {
        path: PathBuf,
        tensor: &'static str,
        expected: String,
        found: String,
    },
    /// A `.npy` file of the statistics cannot be read.
    #[error(transparent)]
    Npy(#[from] NpyError),
    /// An array has an unexpected shape.
    #[error("{path}: expected the shape {expected}, found {found:?}")]
    #[allow(missing_docs)]
    Shape {
        path: PathBuf,
        expected: String,
        found: Vec<usize>,
    },
    /// A value cannot be a mean or a standard deviation.
    #[error("{path}: expected {expected} for feature {feature} ({group}), found {found}")]
    #[allow(missing_docs)]
    Statistic {
        path: PathBuf,
        expected: &'static str,
        feature: usize,
        group: &'static str,
        found: f32,
    },
    /// Statistics cannot be computed.
    #[error("{folder}: mean and standard deviation cannot be computed: {problem}")]
    #[allow(missing_docs)]
    Statistics { folder: PathBuf, problem: String },
    /// There is no folder to pack.
    #[error("expected at least one folder to read")]
    NoSource,
    /// Data sets cannot be joined because they define mirror images differently.
    #[error("{other}: expected features that are mirrored as in {folder}, found others")]
    #[allow(missing_docs)]
    Mirrors { folder: PathBuf, other: PathBuf },
    /// One of several sources is not a data set.
    #[error(
        "{folder}: expected a data set (the packed form, or HumanML3D's), since several are packed into one; found motion files or others. Pack them first"
    )]
    #[allow(missing_docs)]
    NotADataset { folder: PathBuf },
    /// The options allow no length of a motion.
    #[error(
        "expected a shortest length from 1 frame to the longest, found {min_frames} and {max_frames}"
    )]
    #[allow(missing_docs)]
    Limits {
        min_frames: usize,
        max_frames: usize,
    },
    /// A line of a captions file is invalid.
    #[error("{path}, line {line}: {problem}")]
    #[allow(missing_docs)]
    Captions {
        path: PathBuf,
        line: usize,
        problem: String,
    },
    /// A recipe of compositions is invalid, or does not fit the data set.
    #[error("{path}: {problem}")]
    #[allow(missing_docs)]
    Recipe { path: PathBuf, problem: String },
    /// A file of further captions names no motion of the data set.
    #[error("{path}: expected captions of motions in {folder}, found none of these")]
    #[allow(missing_docs)]
    NoneNamed { path: PathBuf, folder: PathBuf },
    /// Motion files are to be packed without a captions file.
    #[error("{folder}: expected a data set, or a file of captions for motion files; found neither")]
    #[allow(missing_docs)]
    Uncaptioned { folder: PathBuf },
    /// A captions file is given for a data set that has captions of its own.
    #[error(
        "{folder}: a data set with captions of its own; expected no file of captions beside it"
    )]
    #[allow(missing_docs)]
    Superfluous { folder: PathBuf },
    /// The output folder is not empty.
    #[error("{folder}: expected an empty folder or none, found {found}")]
    #[allow(missing_docs)]
    Occupied { folder: PathBuf, found: String },
    /// No usable motion is left.
    #[error("{folder}: expected at least one motion that can be used: {problems}")]
    #[allow(missing_docs)]
    Nothing { folder: PathBuf, problems: String },
}

impl DataError {
    /// Returns a function for `map_err` that turns an I/O error of reading `path` into a [`DataError`].
    pub(crate) fn read(path: &Path) -> impl FnOnce(io::Error) -> DataError + use<> {
        let path = path.to_owned();
        move |reason| DataError::Read { path, reason }
    }

    /// Returns a function for `map_err` that turns an I/O error of writing `path` into a [`DataError`].
    pub(crate) fn write(path: &Path) -> impl FnOnce(io::Error) -> DataError + use<> {
        let path = path.to_owned();
        move |reason| DataError::Write { path, reason }
    }
}
