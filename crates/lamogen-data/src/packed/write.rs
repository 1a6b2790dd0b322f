//! Writing the packed form.

use std::borrow::Cow;
use std::collections::HashMap;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};

use lamogen_motion::{POSE_FEATURES, TEMPORARY_PREFIX, TemporaryPath, replace_atomically};
use safetensors::Dtype;
use safetensors::tensor::View;

use super::line::EntryLine;
use super::{CAPTIONS, MOTIONS};
use crate::dataset::Dataset;
use crate::entry::Entry;
use crate::error::DataError;
use crate::rows::Rows;

/// Writes a data set into a folder that is empty, does not exist, or (with `force`) holds a packed data set. The folder
/// appears with both files or not at all.
///
/// # Errors
///
/// If the folder holds anything else, or cannot be written.
pub(crate) fn write(dataset: &Dataset, out: &Path, force: bool) -> Result<(), DataError> {
    check_free(out, force)?;
    // If `out` is a link, the folder that it points to is replaced.
    let out = match out.exists() {
        true => out.canonicalize().map_err(DataError::write(out))?,
        false => out.to_owned(),
    };
    let parent = match out.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent.to_owned(),
        _ => PathBuf::from("."),
    };
    std::fs::create_dir_all(&parent).map_err(DataError::write(&parent))?;
    let temporary = || {
        let mut builder = tempfile::Builder::new();
        builder.prefix(TEMPORARY_PREFIX);
        #[cfg(unix)]
        {
            // Temporary folders are private, but the finished folder should be as readable as any other.
            use std::os::unix::fs::PermissionsExt;
            builder.permissions(std::fs::Permissions::from_mode(0o755));
        }
        builder
            .tempdir_in(&parent)
            .map_err(DataError::write(&parent))
    };
    let new = temporary()?;
    let new_folder = TemporaryPath::lock_folder(new.path()).map_err(DataError::write(&parent))?;
    let layout = ClipLayout::of(dataset);
    let path = new.path().join(MOTIONS);
    write_motions(dataset, &layout, &path).map_err(DataError::write(&out.join(MOTIONS)))?;
    let path = new.path().join(CAPTIONS);
    write_captions(dataset, &layout, &path).map_err(DataError::write(&out.join(CAPTIONS)))?;
    new_folder
        .unlock_folder()
        .map_err(DataError::write(&parent))?;

    // This folder is not removed automatically: the previous data set must survive every failure.
    let old = temporary()?.keep();
    let backup = old.join("old");
    let replaced = out.exists();
    if replaced {
        std::fs::rename(&out, &backup).map_err(DataError::write(&out))?;
    }
    std::fs::rename(new.path(), &out).map_err(|reason| {
        if replaced {
            // If even this fails, nothing more can be done; the previous data set then stays in `backup`.
            if std::fs::rename(&backup, &out).is_ok() {
                let _ = std::fs::remove_dir(&old);
            }
        }
        DataError::write(&out)(reason)
    })?;
    // The folder was renamed, so it must not be removed as a temporary folder.
    let _ = new.keep();
    std::fs::remove_dir_all(&old).map_err(DataError::write(&old))
}

/// Checks that [`write`] may write to a folder.
///
/// # Errors
///
/// If the folder is not empty, unless `force` is set and it holds only a packed data set.
pub(crate) fn check_free(out: &Path, force: bool) -> Result<(), DataError> {
    let entries = match std::fs::read_dir(out) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
        entries => entries.map_err(DataError::write(out))?,
    };
    let mut packed = 0;
    let mut others = Vec::new();
    for entry in entries {
        let name = entry.map_err(DataError::write(out))?.file_name();
        match name == MOTIONS || name == CAPTIONS {
            true => packed += 1,
            false => others.push(name.to_string_lossy().into_owned()),
        }
    }
    others.sort();
    match (others.first(), packed) {
        (None, 0) => Ok(()),
        (None, _) if force => Ok(()),
        (None, _) => Err(DataError::Occupied {
            folder: out.to_owned(),
            found: "a packed data set, which only force replaces".into(),
        }),
        (Some(first), _) => Err(DataError::Occupied {
            folder: out.to_owned(),
            found: match others.len() {
                1 => first.clone(),
                n => format!("{first} and {} more", n - 1),
            },
        }),
    }
}

/// The clips that entries use, with their places in the written file.
struct ClipLayout {
    /// The rows of each written clip, counted over the data set in memory.
    clips: Vec<Range<usize>>,
    /// The index and the first row of a clip in the file, by its index in memory.
    places: HashMap<usize, (usize, usize)>,
}

impl ClipLayout {
    fn of(dataset: &Dataset) -> ClipLayout {
        let mut indices: Vec<usize> = dataset.entries.iter().map(|entry| entry.clip).collect();
        indices.sort_unstable();
        indices.dedup();
        let mut layout = ClipLayout {
            clips: Vec::new(),
            places: HashMap::new(),
        };
        let mut start = 0;
        for clip in indices {
            let rows = dataset.rows.clip(clip);
            layout.places.insert(clip, (layout.clips.len(), start));
            start += rows.len();
            layout.clips.push(rows);
        }
        layout
    }

    /// Returns an entry with its clip and first row in the written file.
    fn relocate(&self, entry: &Entry) -> Entry {
        let (clip, start) = self.places[&entry.clip];
        Entry {
            clip,
            start: start + entry.start - self.clips[clip].start,
            ..entry.clone()
        }
    }
}

fn write_motions(dataset: &Dataset, layout: &ClipLayout, path: &Path) -> io::Result<()> {
    let mut offsets = vec![0];
    for clip in &layout.clips {
        offsets.push(offsets[offsets.len() - 1] + clip.len());
    }
    let rows = offsets[offsets.len() - 1];
    let to_i32 = |n: &usize| i32::try_from(*n).expect("fewer than 2^31 rows are in memory");
    let offsets: Vec<i32> = offsets.iter().map(to_i32).collect();
    let source: Vec<i32> = dataset.mirror.source().iter().map(to_i32).collect();
    let per_feature = vec![POSE_FEATURES];
    let tensors = [
        (
            "features",
            Tensor::Rows(vec![rows, POSE_FEATURES], &dataset.rows, &layout.clips),
        ),
        ("offsets", Tensor::Integers(vec![offsets.len()], &offsets)),
        ("mean", Tensor::Floats(per_feature.clone(), dataset.mean())),
        ("std", Tensor::Floats(per_feature.clone(), dataset.std())),
        (
            "mirror_perm",
            Tensor::Integers(per_feature.clone(), &source),
        ),
        (
            "mirror_sign",
            Tensor::Floats(per_feature, dataset.mirror.sign()),
        ),
    ];
    let metadata = [
        ("format", "lamogen motions"),
        ("features", "HumanML3D, 20 frames a second"),
    ];
    let metadata = metadata.map(|(key, value)| (key.to_owned(), value.to_owned()));
    // The safetensors library writes files that only their owner can read; this file is as readable as any other.
    replace_atomically(path, |path| {
        safetensors::serialize_to_file(tensors, Some(metadata.into()), path)
            .map_err(io::Error::other)
    })
}

fn write_captions(dataset: &Dataset, layout: &ClipLayout, path: &Path) -> io::Result<()> {
    let mut file = BufWriter::new(File::create(path)?);
    for entry in &dataset.entries {
        serde_json::to_writer(&mut file, &EntryLine::from(&layout.relocate(entry)))?;
        file.write_all(b"\n")?;
    }
    file.flush()
}

/// A tensor to be written, with its shape. Its bytes are computed only when it is written.
enum Tensor<'a> {
    Rows(Vec<usize>, &'a Rows, &'a [Range<usize>]),
    Integers(Vec<usize>, &'a [i32]),
    Floats(Vec<usize>, &'a [f32]),
}

impl View for Tensor<'_> {
    fn dtype(&self) -> Dtype {
        match self {
            Tensor::Rows(..) => Dtype::F16,
            Tensor::Integers(..) => Dtype::I32,
            Tensor::Floats(..) => Dtype::F32,
        }
    }

    fn shape(&self) -> &[usize] {
        match self {
            Tensor::Rows(shape, ..) | Tensor::Integers(shape, _) | Tensor::Floats(shape, _) => {
                shape
            }
        }
    }

    fn data(&self) -> Cow<'_, [u8]> {
        let mut bytes = Vec::with_capacity(self.data_len());
        match self {
            Tensor::Rows(_, rows, clips) => {
                for clip in *clips {
                    bytes.extend(
                        rows.values(clip.clone())
                            .iter()
                            .flat_map(|x| x.to_le_bytes()),
                    );
                }
            }
            Tensor::Integers(_, values) => {
                bytes.extend(values.iter().flat_map(|x| x.to_le_bytes()))
            }
            Tensor::Floats(_, values) => bytes.extend(values.iter().flat_map(|x| x.to_le_bytes())),
        }
        bytes.into()
    }

    fn data_len(&self) -> usize {
        let width = match self {
            Tensor::Rows(..) => 2,
            _ => 4,
        };
        self.shape().iter().product::<usize>() * width
    }
}
