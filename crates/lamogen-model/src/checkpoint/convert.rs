//! From any checkpoint to safetensors, tensor by tensor.

use std::borrow::Cow;
use std::cell::RefCell;
use std::collections::HashMap;
use std::path::Path;

use lamogen_motion::replace_atomically;
use safetensors::View;
use safetensors::tensor::Dtype;

use super::precision::Part;
use super::read::is_clips_own;
use super::{Checkpoint, CheckpointError, Precision};

/// A tensor that has been converted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Converted<'a> {
    /// Its key.
    pub key: &'a str,
    /// How many have been converted, this one included.
    pub done: usize,
    /// How many there are.
    pub all: usize,
}

impl Checkpoint {
    /// Writes the tensors as safetensors, under the same keys, without CLIP's image tower and an
    /// optimiser's state. `metadata` is free text that travels with them, such as `license`; what the
    /// source has under other names is kept. One tensor at a time is in memory. The file appears whole
    /// or not at all.
    ///
    /// # Errors
    ///
    /// If there is no tensor, one cannot be read, is not of floats, holds infinities or NaN, or holds numbers beyond the
    /// range of 16 bits where these are asked for; or if the file cannot be written.
    pub fn convert(
        &self,
        to: impl AsRef<Path>,
        precision: Precision,
        metadata: HashMap<String, String>,
        progress: &mut dyn FnMut(Converted<'_>),
    ) -> Result<(), CheckpointError> {
        let to = to.as_ref();
        let mut keys = self.keys();
        keys.retain(|key| !is_clips_own(key));
        if keys.is_empty() {
            return Err(CheckpointError::Format {
                path: self.path().to_owned(),
                problem: "expected tensors of a network, found none".to_owned(),
            });
        }
        let conversion = RefCell::new(Conversion {
            progress,
            done: 0,
            all: keys.len(),
            problem: None,
        });
        let tensors = keys.iter().flat_map(|key| {
            let shape = self.shape(key).unwrap_or_default();
            let (checkpoint, conversion) = (self, &conversion);
            precision.parts(shape.len()).iter().map(move |&part| {
                let tensor = Tensor {
                    checkpoint,
                    key,
                    part,
                    dtype: precision.dtype(part, shape.len()),
                    shape: match part {
                        Part::Numbers => shape,
                        Part::Scale => &shape[..1],
                    },
                    precision,
                    conversion,
                };
                (part.key(key), tensor)
            })
        });
        let mut all = self.all_metadata().clone();
        all.extend(metadata);
        let written = replace_atomically(to, |temporary| {
            safetensors::serialize_to_file(tensors, Some(all), temporary)
                .map_err(std::io::Error::other)?;
            match &conversion.borrow().problem {
                None => Ok(()),
                // The file is discarded; the problem itself is answered below.
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

/// How far a conversion is.
struct Conversion<'p> {
    progress: &'p mut dyn FnMut(Converted<'_>),
    done: usize,
    all: usize,
    /// The first tensor that could not be converted.
    problem: Option<CheckpointError>,
}

/// A tensor that is read when it is written.
struct Tensor<'a, 'p> {
    checkpoint: &'a Checkpoint,
    key: &'a str,
    part: Part,
    dtype: Dtype,
    shape: &'a [usize],
    precision: Precision,
    conversion: &'a RefCell<Conversion<'p>>,
}

impl Tensor<'_, '_> {
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

impl View for Tensor<'_, '_> {
    fn dtype(&self) -> Dtype {
        self.dtype
    }

    fn shape(&self) -> &[usize] {
        self.shape
    }

    fn data(&self) -> Cow<'_, [u8]> {
        let mut conversion = self.conversion.borrow_mut();
        // After a problem nothing more is read; the file will not be kept.
        if conversion.problem.is_some() {
            return Cow::Owned(Vec::new());
        }
        match self.bytes() {
            Ok(bytes) => {
                if self.part == Part::Scale {
                    return Cow::Owned(bytes);
                }
                conversion.done += 1;
                let (done, all) = (conversion.done, conversion.all);
                (conversion.progress)(Converted {
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
