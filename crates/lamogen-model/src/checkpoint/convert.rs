//! Conversion of any checkpoint to safetensors, tensor by tensor.

use std::borrow::Cow;
use std::cell::RefCell;
use std::collections::HashMap;
use std::path::Path;

use lamogen_motion::replace_atomically;
use safetensors::View;
use safetensors::tensor::Dtype;

use super::precision::TensorPart;
use super::read::is_unused_clip_key;
use super::{Checkpoint, CheckpointError, Precision};

/// The progress of a conversion after one more tensor has been converted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ConversionProgress<'a> {
    /// The key of the tensor.
    pub key: &'a str,
    /// The number of tensors that have been converted, including this one.
    pub done: usize,
    /// The number of all tensors.
    pub all: usize,
}

impl Checkpoint {
    /// Writes the tensors as safetensors, under the same keys.
    ///
    /// CLIP's image tower and the state of an optimiser are left out. `metadata` is free text that is stored with the
    /// tensors, such as `license`; the metadata of the source under other names is kept. Only one tensor at a time is in
    /// memory. The file is written whole or not at all.
    ///
    /// # Errors
    ///
    /// If there are no tensors; if a tensor cannot be read, does not contain floats, contains infinities or NaN, or, with
    /// a precision of 16 bits, contains numbers beyond the range of 16 bits; or if the file cannot be written.
    pub fn convert(
        &self,
        to: impl AsRef<Path>,
        precision: Precision,
        metadata: HashMap<String, String>,
        progress: &mut dyn FnMut(ConversionProgress<'_>),
    ) -> Result<(), CheckpointError> {
        let to = to.as_ref();
        let mut keys = self.keys();
        keys.retain(|key| !is_unused_clip_key(key));
        if keys.is_empty() {
            return Err(CheckpointError::Format {
                path: self.path().to_owned(),
                problem: "expected tensors of a network, found none".to_owned(),
            });
        }
        let conversion = RefCell::new(ConversionState {
            progress,
            done: 0,
            all: keys.len(),
            problem: None,
        });
        let tensors = keys.iter().flat_map(|key| {
            let shape = self.shape(key).unwrap_or_default();
            let (checkpoint, conversion) = (self, &conversion);
            precision.parts(shape.len()).iter().map(move |&part| {
                let tensor = LazyTensor {
                    checkpoint,
                    key,
                    part,
                    dtype: precision.dtype(part, shape.len()),
                    shape: match part {
                        TensorPart::Numbers => shape,
                        TensorPart::Scale => &shape[..1],
                    },
                    precision,
                    conversion,
                };
                (part.key(key), tensor)
            })
        });
        let mut all_metadata = self.metadata_map().clone();
        all_metadata.extend(metadata);
        let written = replace_atomically(to, |temporary| {
            safetensors::serialize_to_file(tensors, Some(all_metadata), temporary)
                .map_err(std::io::Error::other)?;
            match &conversion.borrow().problem {
                None => Ok(()),
                // The file is discarded, and the problem itself is returned below.
                Some(_) => Err(std::io::ErrorKind::InvalidData.into()),
            }
        });
        match (conversion.into_inner().problem, written) {
            (Some(problem), _) => Err(problem),
            (None, Ok(())) => Ok(()),
            (None, Err(reason)) => Err(CheckpointError::Io {
                path: to.to_owned(),
                reason,
            }),
        }
    }
}

/// The state of a running conversion.
struct ConversionState<'p> {
    progress: &'p mut dyn FnMut(ConversionProgress<'_>),
    done: usize,
    all: usize,
    /// The first tensor that could not be converted.
    problem: Option<CheckpointError>,
}

/// A tensor that is read only when it is written.
struct LazyTensor<'a, 'p> {
    checkpoint: &'a Checkpoint,
    key: &'a str,
    part: TensorPart,
    dtype: Dtype,
    shape: &'a [usize],
    precision: Precision,
    conversion: &'a RefCell<ConversionState<'p>>,
}

impl LazyTensor<'_, '_> {
    /// Reads the tensor and converts the requested part to bytes.
    fn bytes(&self) -> Result<Vec<u8>, CheckpointError> {
        match self
            .precision
            .convert(self.checkpoint.read(self.key)?, self.part)
        {
            Some(data) => Ok(data.as_bytes().to_vec()),
            None => Err(CheckpointError::Range {
                path: self.checkpoint.path().to_owned(),
                key: self.key.to_owned(),
            }),
        }
    }
}

impl View for LazyTensor<'_, '_> {
    fn dtype(&self) -> Dtype {
        self.dtype
    }

    fn shape(&self) -> &[usize] {
        self.shape
    }

    fn data(&self) -> Cow<'_, [u8]> {
        let mut conversion = self.conversion.borrow_mut();
        // After a problem no more tensors are read, because the file will not be kept.
        if conversion.problem.is_some() {
            return Cow::Owned(Vec::new());
        }
        match self.bytes() {
            Ok(bytes) => {
                if self.part == TensorPart::Scale {
                    return Cow::Owned(bytes);
                }
                conversion.done += 1;
                let (done, all) = (conversion.done, conversion.all);
                (conversion.progress)(ConversionProgress {
                    key: self.key,
                    done,
                    all,
                });
                Cow::Owned(bytes)
            }
            Err(problem) => {
                conversion.problem = Some(problem);
                Cow::Owned(Vec::new())
            }
        }
    }

    fn data_len(&self) -> usize {
        let numbers: usize = self.shape.iter().product();
        numbers * self.dtype.bitsize() / 8
    }
}
