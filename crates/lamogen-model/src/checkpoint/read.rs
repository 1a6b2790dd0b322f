//! Reading of checkpoints, tensor by tensor.

use std::collections::{HashMap, HashSet};
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use burn::tensor::{DType, Device, TensorData};
use lamogen_io::describe_placeholder_at;
use pytorch_reader::{PytorchError, PytorchReader};
use safetensors::tensor::{Dtype, Metadata};

use super::CheckpointError;
use super::keys::{NamedParameters, ParameterList, TensorVisitor};
use super::precision::{dequantize, scale_key, scaled_key};
use super::torchscript::{describe_torchscript, is_torchscript};
use crate::config::ModelConfig;
use crate::network::MotionDiffuse;

/// The key of the network's weights in MotionDiffuse's `latest.tar`.
const ENCODER_KEY: &str = "encoder";

/// Returns whether a key belongs to a part of CLIP that text-to-motion networks store but do not use: the image tower and
/// the weights that compare images with texts.
pub(super) fn is_unused_clip_key(key: &str) -> bool {
    ["clip.visual.", "clip.text_projection", "clip.logit_scale"]
        .iter()
        .any(|unused| key.starts_with(unused))
}

/// An open checkpoint with the keys and shapes of its tensors.
///
/// Opening a checkpoint reads only keys and shapes. The numbers are read one tensor at a time when a network is loaded.
/// CLIP's image tower and the state of an optimiser are never read.
pub struct Checkpoint {
    path: PathBuf,
    container: Container,
    metadata: HashMap<String, String>,
    /// The keys of tensors that are not part of the network.
    dropped: HashSet<String>,
}

/// The file format of a checkpoint, with the tensors that it lists.
enum Container {
    Pytorch(HashMap<String, pytorch_reader::Tensor>),
    Safetensors {
        index: Metadata,
        /// The offset in the file of the first number.
        start: u64,
        bytes: ByteSource,
    },
}

/// The source of the bytes of a safetensors file.
enum ByteSource {
    File(Mutex<File>),
    Embedded(&'static [u8]),
}

impl Checkpoint {
    /// Opens a checkpoint.
    ///
    /// A file with the extension `.safetensors` is read as safetensors. Any other file must be written by `torch.save`,
    /// with the weights under the key `encoder`, as in MotionDiffuse.
    ///
    /// # Errors
    ///
    /// If the file cannot be read, is truncated, or is not such a checkpoint.
    pub fn open(path: impl AsRef<Path>) -> Result<Checkpoint, CheckpointError> {
        let path = path.as_ref();
        refuse_placeholder(path)?;
        match path.extension() {
            Some(extension) if extension.eq_ignore_ascii_case("safetensors") => {
                Self::open_safetensors(path)
            }
            _ => Self::open_pytorch(path, Some(ENCODER_KEY)),
        }
    }

    /// Opens a checkpoint of several networks, each under a key of its own.
    ///
    /// For example, `text.linear.weight` is the tensor `linear.weight` of the part `text`. Other parts of a file that
    /// `torch.save` wrote, such as the states of optimisers, are ignored.
    ///
    /// # Errors
    ///
    /// In the same cases as [`open`](Self::open), or if a part is missing or has no tensors.
    pub fn open_parts(
        path: impl AsRef<Path>,
        parts: &[&str],
    ) -> Result<Checkpoint, CheckpointError> {
        let path = path.as_ref();
        refuse_placeholder(path)?;
        let is_in_part = |key: &str, part: &str| {
            key.strip_prefix(part)
                .is_some_and(|rest| rest.starts_with('.'))
        };
        let mut checkpoint = match path.extension() {
            Some(extension) if extension.eq_ignore_ascii_case("safetensors") => {
                Self::open_safetensors(path)?
            }
            _ => Self::open_pytorch(path, None)?,
        };
        let keys = checkpoint.keys();
        if let Some(part) = parts
            .iter()
            .find(|part| !keys.iter().any(|key| is_in_part(key, part)))
        {
            return Err(format_error(
                path,
                format!("expected weights under the key `{part}`, which is not there"),
            ));
        }
        if let Container::Pytorch(tensors) = &mut checkpoint.container {
            tensors.retain(|key, _| parts.iter().any(|part| is_in_part(key, part)));
        }
        Ok(checkpoint)
    }

    /// Opens a checkpoint whose weights lie under the first of `parts` that is there, or under no key of their own.
    ///
    /// MDM's checkpoints, for example, have the average of the weights under `model_avg` and the weights themselves under
    /// `model`, or consist of the weights alone.
    ///
    /// # Errors
    ///
    /// If the file cannot be read, is truncated, or is not a checkpoint.
    pub fn open_first_part(
        path: impl AsRef<Path>,
        parts: &[&str],
    ) -> Result<Checkpoint, CheckpointError> {
        let mut checkpoint = Self::open_any(path)?;
        let Container::Pytorch(tensors) = &mut checkpoint.container else {
            return Ok(checkpoint);
        };
        for part in parts {
            let prefix = format!("{part}.");
            if !tensors.keys().any(|key| key.starts_with(&prefix)) {
                continue;
            }
            let all = std::mem::take(tensors).into_iter();
            let of_part =
                |(key, tensor): (String, _)| Some((key.strip_prefix(&prefix)?.to_owned(), tensor));
            *tensors = all.filter_map(of_part).collect();
            break;
        }
        Ok(checkpoint)
    }

    /// Opens a checkpoint with all of its tensors, under whatever keys.
    pub(crate) fn open_any(path: impl AsRef<Path>) -> Result<Checkpoint, CheckpointError> {
        let path = path.as_ref();
        refuse_placeholder(path)?;
        match path.extension() {
            Some(extension) if extension.eq_ignore_ascii_case("safetensors") => {
                Self::open_safetensors(path)
            }
            _ => Self::open_pytorch(path, None),
        }
    }

    /// Forgets the tensors whose keys a function does not keep.
    pub(crate) fn retain(&mut self, keep: impl Fn(&str) -> bool) {
        let dropped = self.keys().into_iter().filter(|key| !keep(key));
        self.dropped.extend(dropped.collect::<Vec<_>>());
    }

    /// Opens a safetensors file that is embedded in the program. `name` is used in error messages.
    ///
    /// # Errors
    ///
    /// If the bytes are not a safetensors file.
    pub fn embedded(bytes: &'static [u8], name: &str) -> Result<Checkpoint, CheckpointError> {
        let path = Path::new(name);
        let (index, start) = safetensors_index(&mut &bytes[..], bytes.len() as u64, path)?;
        Ok(Self::safetensors(
            path,
            index,
            start,
            ByteSource::Embedded(bytes),
        ))
    }

    /// Returns a text that is stored with the weights, such as `license` (safetensors only).
    pub fn metadata(&self, key: &str) -> Option<&str> {
        self.metadata.get(key).map(String::as_str)
    }

    pub(super) fn metadata_map(&self) -> &HashMap<String, String> {
        &self.metadata
    }

    /// Returns the path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the sorted keys of all tensors. The scales of a tensor of 8 bits have no key of their own in this list.
    pub fn keys(&self) -> Vec<String> {
        let mut keys: Vec<String> = match &self.container {
            Container::Pytorch(tensors) => tensors.keys().cloned().collect(),
            Container::Safetensors { index, .. } => index.tensors().into_keys().collect(),
        };
        keys.retain(|key| {
            !self.dropped.contains(key)
                && !scaled_key(key).is_some_and(|scaled| self.is_quantized(scaled))
        });
        keys.sort_unstable();
        keys
    }

    /// Creates the network of the given sizes with this checkpoint's weights.
    ///
    /// # Errors
    ///
    /// If a tensor is missing, has another shape, does not contain floats, contains infinities or NaN, or cannot be read;
    /// or if the checkpoint has a tensor that a network of these sizes does not have. CLIP's image tower, `clip.visual.*`,
    /// is allowed.
    ///
    /// # Panics
    ///
    /// If the sizes do not form a valid network (see [`ModelConfig::problem`]).
    pub fn load(
        &self,
        config: &ModelConfig,
        device: &Device,
    ) -> Result<MotionDiffuse, CheckpointError> {
        let mut network = MotionDiffuse::new(config, device);
        self.fill(&mut network, device)?;
        Ok(network)
    }

    /// Loads the weights of this checkpoint into a network of any kind, on `device`.
    ///
    /// # Errors
    ///
    /// In the same cases as [`load`](Self::load). The network may then have some of the weights.
    pub fn fill(
        &self,
        network: &mut impl NamedParameters,
        device: &Device,
    ) -> Result<(), CheckpointError> {
        let requested_keys = self.fill_requested(network, device)?;
        self.unknown_tensors(&requested_keys).map_or(Ok(()), Err)
    }

    /// Loads the weights of a part of what the checkpoint holds, such as the text tower of a CLIP. Other tensors are left
    /// alone.
    pub(crate) fn fill_part(
        &self,
        network: &mut impl NamedParameters,
        device: &Device,
    ) -> Result<(), CheckpointError> {
        self.fill_requested(network, device).map(drop)
    }

    /// Loads the tensors that a network asks for. Returns their keys.
    fn fill_requested(
        &self,
        network: &mut impl NamedParameters,
        device: &Device,
    ) -> Result<HashSet<String>, CheckpointError> {
        let mut reader = WeightReader {
            checkpoint: self,
            requested_keys: HashSet::new(),
            problem: None,
        };
        network.keys(&mut ParameterList::new(device.clone(), &mut reader));
        match reader.problem {
            None => Ok(reader.requested_keys),
            Some(problem) => Err(problem),
        }
    }

    /// Returns an error if the checkpoint has tensors that the network did not request, except those of CLIP's image tower.
    fn unknown_tensors(&self, requested_keys: &HashSet<String>) -> Option<CheckpointError> {
        let mut keys = self.keys();
        keys.retain(|key| !requested_keys.contains(key) && !is_unused_clip_key(key));
        Some(CheckpointError::Unknown {
            path: self.path.clone(),
            key: keys.first()?.clone(),
            others: keys.len() - 1,
        })
    }

    /// Opens a PyTorch file with the tensors under a key of the file's dictionary, or with all tensors.
    fn open_pytorch(path: &Path, key: Option<&str>) -> Result<Checkpoint, CheckpointError> {
        // The reader does not distinguish a missing file from other problems, so the file is opened here first.
        if is_torchscript(path).map_err(|reason| io_error(path, reason))? {
            return Err(format_error(path, describe_torchscript(path)));
        }
        let reader = match key {
            Some(key) => PytorchReader::with_top_level_key(path, key),
            None => PytorchReader::new(path),
        };
        let reader = reader.map_err(|error| match error {
            PytorchError::KeyNotFound(_) => {
                let key = key.unwrap_or_default();
                let problem =
                    format!("expected the weights under the key `{key}`, which is not there");
                format_error(path, problem)
            }
            error => format_error(path, error.to_string()),
        })?;
        Ok(Checkpoint {
            path: path.to_owned(),
            container: Container::Pytorch(reader.into_tensors()),
            metadata: HashMap::new(),
            dropped: HashSet::new(),
        })
    }

    fn open_safetensors(path: &Path) -> Result<Checkpoint, CheckpointError> {
        let io = |reason| io_error(path, reason);
        let mut file = File::open(path).map_err(io)?;
        let length = file.metadata().map_err(io)?.len();
        let (index, start) = safetensors_index(&mut file, length, path)?;
        let bytes = ByteSource::File(Mutex::new(file));
        Ok(Self::safetensors(path, index, start, bytes))
    }

    fn safetensors(path: &Path, index: Metadata, start: u64, bytes: ByteSource) -> Checkpoint {
        Checkpoint {
            path: path.to_owned(),
            metadata: index.metadata().clone().unwrap_or_default(),
            dropped: HashSet::new(),
            container: Container::Safetensors {
                index,
                start,
                bytes,
            },
        }
    }

    /// Returns the shape of a tensor, or `None` if it does not exist.
    pub(crate) fn shape(&self, key: &str) -> Option<&[usize]> {
        match &self.container {
            Container::Pytorch(tensors) => tensors.get(key).map(pytorch_reader::Tensor::shape),
            Container::Safetensors { index, .. } => index.info(key).map(|info| &*info.shape),
        }
    }

    /// Returns whether a tensor consists of integers of 8 bits with a scale for each row.
    fn is_quantized(&self, key: &str) -> bool {
        let Container::Safetensors { index, .. } = &self.container else {
            return false;
        };
        let scale = scale_key(key);
        match (index.info(key), index.info(&scale)) {
            (Some(numbers), Some(scale)) => {
                let is_float = safetensors_type(scale.dtype).is_ok();
                numbers.dtype == Dtype::I8
                    && is_float
                    && numbers.shape.first() == scale.shape.first()
                    && scale.shape.len() == 1
            }
            _ => false,
        }
    }

    /// Reads the numbers of an existing tensor, in 32 bits.
    pub(super) fn read(&self, key: &str) -> Result<TensorData, CheckpointError> {
        match self.is_quantized(key) {
            true => Ok(dequantize(
                &self.read_stored(key, Some(DType::I8))?,
                &self.read_floats(&scale_key(key))?,
            )),
            false => self.read_floats(key),
        }
    }

    /// Reads the numbers of a stored tensor of floats, in 32 bits.
    fn read_floats(&self, key: &str) -> Result<TensorData, CheckpointError> {
        let data = self.read_stored(key, None)?.convert::<f32>();
        let numbers = data.as_slice::<f32>().expect("converted to f32");
        match numbers.iter().all(|number| number.is_finite()) {
            true => Ok(data),
            false => Err(CheckpointError::NotFinite {
                path: self.path.clone(),
                key: key.to_owned(),
            }),
        }
    }

    /// Reads the numbers of a stored tensor.
    ///
    /// `forced_dtype` is the type of a safetensors tensor that is not a type of weights by itself, such as integers of 8
    /// bits.
    fn read_stored(
        &self,
        key: &str,
        forced_dtype: Option<DType>,
    ) -> Result<TensorData, CheckpointError> {
        let (shape, dtype, bytes) = match &self.container {
            Container::Pytorch(tensors) => {
                let tensor = &tensors[key];
                (tensor.shape(), pytorch_type(tensor.dtype()), tensor.read())
            }
            Container::Safetensors {
                index,
                start,
                bytes,
            } => {
                let info = index.info(key).expect("the tensor is there");
                let (from, to) = info.data_offsets;
                let bytes = bytes.read(start + from as u64, to - from);
                let dtype = forced_dtype.map_or_else(|| safetensors_type(info.dtype), Ok);
                (&*info.shape, dtype, bytes)
            }
        };
        let dtype = dtype.map_err(|found| CheckpointError::Type {
            path: self.path.clone(),
            key: key.to_owned(),
            found,
        })?;
        let bytes = bytes.map_err(|error| match error.kind() {
            io::ErrorKind::InvalidData | io::ErrorKind::UnexpectedEof => {
                format_error(&self.path, error.to_string())
            }
            _ => io_error(&self.path, error),
        })?;
        TensorData::try_from_bytes(
            burn::tensor::Bytes::from_bytes_vec(bytes),
            shape.to_vec(),
            dtype,
        )
        .map_err(|error| format_error(&self.path, format!("tensor `{key}`: {error}")))
    }
}

impl ByteSource {
    /// Reads `length` bytes from the offset `from`.
    fn read(&self, from: u64, length: usize) -> io::Result<Vec<u8>> {
        match self {
            ByteSource::Embedded(bytes) => Ok(bytes[from as usize..][..length].to_vec()),
            ByteSource::File(file) => {
                let mut file = file
                    .lock()
                    .expect("no reader panics while it holds the file");
                file.seek(SeekFrom::Start(from))?;
                let mut bytes = vec![0; length];
                file.read_exact(&mut bytes)?;
                Ok(bytes)
            }
        }
    }
}

/// Reads the header of a safetensors file of a given length. Returns the header and the offset of the first number.
fn safetensors_index(
    reader: &mut impl Read,
    length: u64,
    path: &Path,
) -> Result<(Metadata, u64), CheckpointError> {
    let truncated = |what: &str| format_error(path, format!("the file ends within {what}"));
    let mut size = [0; 8];
    if length < 8 {
        return Err(truncated("the header"));
    }
    reader
        .read_exact(&mut size)
        .map_err(|reason| io_error(path, reason))?;
    let size = u64::from_le_bytes(size);
    if size > length - 8 {
        return Err(truncated("the header"));
    }
    let mut header = vec![0; size as usize];
    reader
        .read_exact(&mut header)
        .map_err(|reason| io_error(path, reason))?;
    let index: Metadata = serde_json::from_slice(&header)
        .map_err(|error| format_error(path, format!("the header is no safetensors: {error}")))?;
    let start = 8 + size;
    if start + index.data_len() as u64 > length {
        return Err(truncated("its tensors"));
    }
    Ok((index, start))
}

fn pytorch_type(dtype: pytorch_reader::DType) -> Result<DType, String> {
    use pytorch_reader::DType as PytorchDType;
    match dtype {
        PytorchDType::F64 => Ok(DType::F64),
        PytorchDType::F32 => Ok(DType::F32),
        PytorchDType::F16 => Ok(DType::F16),
        PytorchDType::BF16 => Ok(DType::BF16),
        other => Err(format!("{other:?}")),
    }
}

fn safetensors_type(dtype: Dtype) -> Result<DType, String> {
    match dtype {
        Dtype::F64 => Ok(DType::F64),
        Dtype::F32 => Ok(DType::F32),
        Dtype::F16 => Ok(DType::F16),
        Dtype::BF16 => Ok(DType::BF16),
        other => Err(format!("{other:?}")),
    }
}

/// Loads the tensors of a checkpoint into a network. Keeps the first problem and counts the others.
struct WeightReader<'a> {
    checkpoint: &'a Checkpoint,
    requested_keys: HashSet<String>,
    problem: Option<CheckpointError>,
}

impl WeightReader<'_> {
    /// Reads one tensor after checking its shape. Returns `None` without reading if there was a problem before.
    fn read_tensor(
        &self,
        key: &str,
        expected: &[usize],
    ) -> Result<Option<TensorData>, CheckpointError> {
        let (path, key_name) = (self.checkpoint.path.clone(), key.to_owned());
        let expected_shape = expected.to_vec();
        match self.checkpoint.shape(key) {
            None => Err(CheckpointError::Missing {
                path,
                key: key_name,
                expected: expected_shape,
                others: 0,
            }),
            Some(found) if found != expected => Err(CheckpointError::Shape {
                path,
                key: key_name,
                expected: expected_shape,
                found: found.to_vec(),
                others: 0,
            }),
            // After the first problem, no more tensors are read.
            Some(_) if self.problem.is_some() => Ok(None),
            Some(_) => self.checkpoint.read(key).map(Some),
        }
    }
}

impl TensorVisitor for WeightReader<'_> {
    fn visit(
        &mut self,
        key: &str,
        shape: &[usize],
        _current: &dyn Fn() -> TensorData,
    ) -> Option<TensorData> {
        self.requested_keys.insert(key.to_owned());
        match (self.read_tensor(key, shape), &mut self.problem) {
            (Ok(data), _) => data,
            (Err(error), problem @ None) => {
                *problem = Some(error);
                None
            }
            (Err(_), Some(first)) => {
                if let CheckpointError::Missing { others, .. }
                | CheckpointError::Shape { others, .. } = first
                {
                    *others += 1;
                }
                None
            }
        }
    }
}

/// Returns an error if a file is only a placeholder of a checkpoint, such as a Git LFS pointer.
fn refuse_placeholder(path: &Path) -> Result<(), CheckpointError> {
    match describe_placeholder_at(path) {
        Some(problem) => Err(format_error(path, problem.to_owned())),
        None => Ok(()),
    }
}

fn io_error(path: &Path, reason: io::Error) -> CheckpointError {
    CheckpointError::Io {
        path: path.to_owned(),
        reason,
    }
}

fn format_error(path: &Path, problem: String) -> CheckpointError {
    CheckpointError::Format {
        path: path.to_owned(),
        problem,
    }
}
