//! Reading the packed form.

use std::collections::HashSet;
use std::fs::File;
use std::io::{BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use half::f16;
use lamogen_motion::{FeatureGroup, POSE_FEATURES};
use rayon::prelude::*;
use safetensors::Dtype;
use safetensors::tensor::{Metadata, TensorInfo};

use super::{CAPTIONS, MOTIONS};
use crate::dataset::Dataset;
use crate::entry::Entry;
use crate::error::DataError;
use crate::mirror::Mirror;
use crate::options::{LoadOptions, Progress};
use crate::problems::{ProblemKind, Problems, check_length};
use crate::rows::{Rows, first_not_finite};
use crate::statistics::Statistics;

/// Opens a folder that has both files of the packed form.
///
/// # Errors
///
/// As [`Dataset::open`].
pub(crate) fn open(
    folder: &Path,
    options: &LoadOptions,
    observer: &mut dyn FnMut(Progress),
) -> Result<Dataset, DataError> {
    let mut motions = MotionsFile::open(folder.join(MOTIONS))?;
    let mirror = motions.mirror()?;
    let statistics = motions.statistics()?;
    let rows = motions.rows(observer)?;
    let mut problems = Problems::default();
    let entries = read_entries(&folder.join(CAPTIONS), &rows, options, &mut problems)?;
    Dataset::new(folder, (entries, rows), mirror, statistics, problems)
}

/// Reads the entries. Those that cannot be used are added to `problems` instead.
fn read_entries(
    path: &Path,
    rows: &Rows,
    options: &LoadOptions,
    problems: &mut Problems,
) -> Result<Vec<Entry>, DataError> {
    // For each clip, the first of its rows that holds a number that is not finite.
    let broken_rows: Vec<Option<usize>> = (0..rows.clips())
        .into_par_iter()
        .map(|clip| first_not_finite(rows.values(rows.clip(clip))).map(|i| i / POSE_FEATURES))
        .collect();
    let mut entries: Vec<Entry> = Vec::new();
    let mut names = HashSet::new();
    let file = BufReader::new(File::open(path).map_err(DataError::read(path))?);
    for (index, line) in file.lines().enumerate() {
        let line = line.map_err(DataError::read(path))?;
        if line.trim().is_empty() {
            continue;
        }
        let line_name = || format!("{CAPTIONS}, line {}", index + 1);
        let entry = match Entry::from_json(&line) {
            Ok(entry) => entry,
            Err(reason) => {
                problems.add(line_name(), ProblemKind::Line, reason);
                continue;
            }
        };
        match check_entry(&entry, rows, &broken_rows, options) {
            Err((kind, reason)) => problems.add(entry.name, kind, reason),
            Ok(()) if !names.insert(entry.name.clone()) => {
                let reason = format!("{}: another line has the same name", line_name());
                problems.add(entry.name, ProblemKind::Twice, reason);
            }
            Ok(()) => entries.push(entry),
        }
    }
    Ok(entries)
}

/// Checks that an entry has captions, a length within the limits, and finite rows within its clip.
fn check_entry(
    entry: &Entry,
    rows: &Rows,
    broken_rows: &[Option<usize>],
    options: &LoadOptions,
) -> Result<(), (ProblemKind, String)> {
    let Entry {
        clip,
        start,
        frames,
        ..
    } = *entry;
    if clip >= rows.clips() {
        let clips = rows.clips();
        let reason = format!("expected one of {clips} clips, found clip {clip}");
        return Err((ProblemKind::Line, reason));
    }
    let clip = rows.clip(clip);
    let is_within =
        start >= clip.start && start.checked_add(frames).is_some_and(|end| end <= clip.end);
    if !is_within {
        let reason = format!(
            "expected rows within {clip:?}, those of its clip, found {frames} rows from {start}"
        );
        return Err((ProblemKind::Line, reason));
    }
    check_length(frames, options)?;
    if entry.captions.is_empty() {
        return Err((
            ProblemKind::NoCaption,
            "expected a caption, found none".into(),
        ));
    }
    // The first broken_rows row of the clip may lie before the entry.
    if broken_rows[entry.clip].is_some()
        && let Some(place) = first_not_finite(rows.values(entry.rows()))
    {
        let (frame, feature) = (place / POSE_FEATURES, place % POSE_FEATURES);
        let reason = format!("frame {frame}, feature {feature}: expected a finite number");
        return Err((ProblemKind::NotFinite, reason));
    }
    Ok(())
}

/// The open file `motions.safetensors`, with its header.
struct MotionsFile {
    path: PathBuf,
    file: File,
    /// The header: type, shape and place of every tensor.
    header: Metadata,
    /// The offset of the tensors' bytes in the file.
    start: u64,
}

/// The count of numbers that are read at once.
const BLOCK: usize = POSE_FEATURES * 4096;

impl MotionsFile {
    fn open(path: PathBuf) -> Result<MotionsFile, DataError> {
        let format = |problem: String| DataError::Format {
            path: path.clone(),
            problem,
        };
        let truncated = |what: &str| format(format!("the file ends within {what}"));
        let mut file = File::open(&path).map_err(DataError::read(&path))?;
        let length = file.metadata().map_err(DataError::read(&path))?.len();
        let mut size = [0; 8];
        if length < 8 {
            return Err(truncated("the header"));
        }
        file.read_exact(&mut size).map_err(DataError::read(&path))?;
        let size = u64::from_le_bytes(size);
        if size > length - 8 {
            return Err(truncated("the header"));
        }
        let mut header = vec![0; size as usize];
        file.read_exact(&mut header)
            .map_err(DataError::read(&path))?;
        let header: Metadata = serde_json::from_slice(&header)
            .map_err(|error| format(format!("the header is no safetensors: {error}")))?;
        let start = 8 + size;
        if start + header.data_len() as u64 > length {
            return Err(truncated("its tensors"));
        }
        Ok(MotionsFile {
            path,
            file,
            header,
            start,
        })
    }

    /// Reads the mirror mapping; that of HumanML3D's features if the file has none.
    fn mirror(&mut self) -> Result<Mirror, DataError> {
        let (Some(source), Some(sign)) = (self.info("mirror_perm"), self.info("mirror_sign"))
        else {
            return Ok(Mirror::new());
        };
        self.check_tensor("mirror_perm", &source, &[Dtype::I32], &[POSE_FEATURES])?;
        self.check_tensor("mirror_sign", &sign, &[Dtype::F32], &[POSE_FEATURES])?;
        let source = self.read_numbers(&source, i32::from_le_bytes)?;
        let sign = self.read_numbers(&sign, f32::from_le_bytes)?;
        Mirror::from_arrays(&source, &sign).ok_or_else(|| {
            let expected = "every feature once, and 1 or -1 for each in `mirror_sign`";
            self.tensor_error("mirror_perm", expected.into(), "something else".into())
        })
    }

    /// Reads mean and standard deviation; `None` if the file has neither.
    fn statistics(&mut self) -> Result<Option<Statistics>, DataError> {
        let (mean, std) = (self.info("mean"), self.info("std"));
        let (mean, std) = match (mean, std) {
            (None, None) => return Ok(None),
            (Some(mean), Some(std)) => (mean, std),
            (mean, _) => {
                let missing = if mean.is_some() { "std" } else { "mean" };
                let expected = "both `mean` and `std`, or neither".into();
                return Err(self.tensor_error(missing, expected, "one of them".into()));
            }
        };
        self.check_tensor("mean", &mean, &[Dtype::F32], &[POSE_FEATURES])?;
        self.check_tensor("std", &std, &[Dtype::F32], &[POSE_FEATURES])?;
        let mean = self.read_numbers(&mean, f32::from_le_bytes)?;
        let std = self.read_numbers(&std, f32::from_le_bytes)?;
        let statistics = Statistics { mean, std };
        match statistics.first_invalid() {
            None => Ok(Some(statistics)),
            Some((tensor, expected, feature, found)) => {
                let group = FeatureGroup::of(feature).map_or("", FeatureGroup::name);
                let expected = format!("{expected} for feature {feature} ({group})");
                Err(self.tensor_error(tensor, expected, found.to_string()))
            }
        }
    }

    /// Reads the rows of all clips.
    fn rows(&mut self, observer: &mut dyn FnMut(Progress)) -> Result<Rows, DataError> {
        let missing = |motions: &MotionsFile, tensor| {
            motions.tensor_error(tensor, "it to be there".into(), "none".into())
        };
        let features = self
            .info("features")
            .ok_or_else(|| missing(self, "features"))?;
        let offsets = self
            .info("offsets")
            .ok_or_else(|| missing(self, "offsets"))?;
        let count = features.shape.first().copied().unwrap_or(0);
        self.check_tensor(
            "features",
            &features,
            &[Dtype::F16, Dtype::F32],
            &[count, POSE_FEATURES],
        )?;
        let clips = offsets.shape.first().copied().unwrap_or(0);
        self.check_tensor("offsets", &offsets, &[Dtype::I32], &[clips])?;
        let offsets: Vec<i64> = self
            .read_numbers(&offsets, i32::from_le_bytes)?
            .into_iter()
            .map(i64::from)
            .collect();
        let spans_rows = offsets.first() == Some(&0) && offsets.last() == Some(&(count as i64));
        if !spans_rows || !offsets.is_sorted() {
            let expected = format!("numbers that grow from 0 to {count}, the number of rows");
            let found = match offsets.windows(2).position(|pair| pair[0] > pair[1]) {
                Some(index) => format!("{} before {}", offsets[index], offsets[index + 1]),
                None => format!("{:?} to {:?}", offsets.first(), offsets.last()),
            };
            return Err(self.tensor_error("offsets", expected, found));
        }
        let values = match features.dtype {
            Dtype::F16 => self.read_halves(
                &features,
                |bytes: [u8; 2]| f16::from_le_bytes(bytes),
                observer,
            ),
            _ => self.read_halves(
                &features,
                |bytes| f16::from_f32(f32::from_le_bytes(bytes)),
                observer,
            ),
        }?;
        Ok(Rows::from_parts(
            values,
            offsets.into_iter().map(|offset| offset as usize).collect(),
        ))
    }

    /// Reads the numbers of a tensor as 16-bit numbers, in blocks, so that memory never holds a second copy of them.
    fn read_halves<const N: usize>(
        &mut self,
        info: &TensorInfo,
        decode: impl Fn([u8; N]) -> f16,
        observer: &mut dyn FnMut(Progress),
    ) -> Result<Vec<f16>, DataError> {
        let all = info.shape.iter().product::<usize>();
        let mut values = Vec::with_capacity(all);
        let mut bytes = vec![0; BLOCK.min(all) * N];
        let io = DataError::read(&self.path);
        let from = self.start + info.data_offsets.0 as u64;
        let mut read = || {
            self.file.seek(SeekFrom::Start(from))?;
            while values.len() < all {
                let block = &mut bytes[..BLOCK.min(all - values.len()) * N];
                self.file.read_exact(block)?;
                values.extend(
                    block
                        .as_chunks::<N>()
                        .0
                        .iter()
                        .map(|number| decode(*number)),
                );
                observer(Progress {
                    done: values.len() / POSE_FEATURES,
                    all: all / POSE_FEATURES,
                });
            }
            Ok(())
        };
        read().map_err(io)?;
        Ok(values)
    }

    /// Reads the numbers of a tensor of 32-bit numbers.
    fn read_numbers<T>(
        &mut self,
        info: &TensorInfo,
        decode: fn([u8; 4]) -> T,
    ) -> Result<Vec<T>, DataError> {
        let (from, to) = info.data_offsets;
        let mut bytes = vec![0; to - from];
        let start = SeekFrom::Start(self.start + from as u64);
        { self.file.seek(start) }
            .and_then(|_| self.file.read_exact(&mut bytes))
            .map_err(DataError::read(&self.path))?;
        Ok(bytes
            .as_chunks::<4>()
            .0
            .iter()
            .map(|number| decode(*number))
            .collect())
    }

    fn info(&self, tensor: &str) -> Option<TensorInfo> {
        self.header.info(tensor).cloned()
    }

    /// Checks that a tensor has one of the types and the shape.
    fn check_tensor(
        &self,
        tensor: &'static str,
        info: &TensorInfo,
        types: &[Dtype],
        shape: &[usize],
    ) -> Result<(), DataError> {
        if types.contains(&info.dtype) && info.shape == shape {
            return Ok(());
        }
        let types: Vec<String> = types.iter().map(|dtype| format!("{dtype:?}")).collect();
        let expected = format!("{} {shape:?}", types.join(" or "));
        Err(self.tensor_error(
            tensor,
            expected,
            format!("{:?} {:?}", info.dtype, info.shape),
        ))
    }

    fn tensor_error(&self, tensor: &'static str, expected: String, found: String) -> DataError {
        DataError::Tensor {
            path: self.path.clone(),
            tensor,
            expected,
            found,
        }
    }
}
