//! The file of a golden case, with inputs and expected values.

use std::path::PathBuf;

use burn::tensor::{Device, Int, Tensor, TensorData};
use lamogen_laban::Scale;
use lamogen_model::ModelConfig;
use lamogen_motion::JOINTS;
use safetensors::SafeTensors;
use safetensors::tensor::{Dtype, TensorView};

use super::ParityError;

/// A file of inputs and expected values.
pub(super) struct Case<'a> {
    path: PathBuf,
    tensors: SafeTensors<'a>,
    pub(super) device: Device,
}

impl<'a> Case<'a> {
    /// Parses the bytes of a file. Error messages show `path`.
    pub(super) fn new(
        path: PathBuf,
        bytes: &'a [u8],
        device: &Device,
    ) -> Result<Self, ParityError> {
        match SafeTensors::deserialize(bytes) {
            Ok(tensors) => Ok(Case {
                path,
                tensors,
                device: device.clone(),
            }),
            Err(error) => Err(ParityError::Case {
                path,
                problem: error.to_string(),
            }),
        }
    }

    /// Returns the sorted names of the expected values.
    pub(super) fn expected_names(&self) -> Vec<&str> {
        let mut names = self.tensors.names();
        names.retain(|name| name.starts_with("out."));
        names.sort_unstable();
        names
    }

    /// Creates an error with the path of this file.
    fn problem(&self, problem: String) -> ParityError {
        ParityError::Case {
            path: self.path.clone(),
            problem,
        }
    }

    /// Returns a tensor of a supported number type; a missing tensor is an error.
    pub(super) fn view(&self, name: &str) -> Result<TensorView<'_>, ParityError> {
        let view = self
            .tensors
            .tensor(name)
            .map_err(|_| self.problem(format!("{name} is missing")))?;
        match view.dtype() {
            Dtype::F32 | Dtype::F64 | Dtype::I32 | Dtype::I64 => Ok(view),
            other => Err(self.problem(format!(
                "{name} holds {other:?}; expected F32, F64, I32 or I64"
            ))),
        }
    }

    /// Checks that the inputs have the same batch size, and sizes that the network accepts.
    pub(super) fn check(&self, config: &ModelConfig) -> Result<(), ParityError> {
        let [batch, frames, features] = self.dims("in.z")?;
        let [motions, tokens] = self.dims("in.tokens")?;
        let ids = self.integers("in.tokens")?;
        let problem = if features != config.input_feats {
            Some(format!(
                "in.z has {features} features, the network {}",
                config.input_feats
            ))
        } else if !(1..=config.num_frames).contains(&frames) {
            Some(format!(
                "in.z has {frames} frames, the network does 1 to {}",
                config.num_frames
            ))
        } else if tokens > config.clip.context_length {
            Some(format!(
                "in.tokens has {tokens} tokens a prompt, the network's context {}",
                config.clip.context_length
            ))
        } else if let Some(id) = ids.iter().find(|&&id| id >= config.clip.vocab_size) {
            Some(format!(
                "in.tokens has the id {id}, the vocabulary {} ids",
                config.clip.vocab_size
            ))
        } else if self.integers("in.lengths")?.contains(&0) {
            Some("in.lengths has a motion of 0 frames".into())
        } else {
            let counts = [
                ("in.tokens", motions),
                ("in.lengths", self.dims::<1>("in.lengths")?[0]),
                ("in.t", self.dims::<1>("in.t")?[0]),
            ];
            let wrong = counts.iter().find(|(_, count)| *count != batch);
            wrong.map(|(name, count)| format!("{name} is of {count} motions, in.z of {batch}"))
        };
        for name in ["in.x_t", "out.baseline"] {
            let found = self.dims::<3>(name)?;
            if found != [batch, frames, features] {
                return Err(self.problem(format!(
                    "{name} is {found:?}, in.z {:?}",
                    [batch, frames, features]
                )));
            }
        }
        let [_, length, joints, axes] = self.dims("in.joints")?;
        if length == 0 || [joints, axes] != [JOINTS, 3] {
            return Err(self.problem(format!(
                "in.joints is of {length} frames, {joints} joints and {axes} axes"
            )));
        }
        problem.map_or(Ok(()), |problem| Err(self.problem(problem)))
    }

    /// Returns the shape of a tensor with `D` axes.
    fn dims<const D: usize>(&self, name: &str) -> Result<[usize; D], ParityError> {
        let view = self.view(name)?;
        let shape = view.shape();
        shape
            .try_into()
            .map_err(|_| self.problem(format!("expected {D} axes of {name}, found {shape:?}")))
    }

    /// Loads a tensor in 32 bits to the device.
    pub(super) fn tensor<const D: usize>(&self, name: &str) -> Result<Tensor<D>, ParityError> {
        self.dims::<D>(name)?;
        let view = self.view(name)?;
        let values: Vec<f32> = numbers(&view).map(|x| x as f32).collect();
        let data = TensorData::new(values, view.shape().to_vec());
        Ok(Tensor::from_data(data, &self.device))
    }

    /// Returns the numbers of a tensor as integers.
    pub(super) fn integers(&self, name: &str) -> Result<Vec<usize>, ParityError> {
        Ok(numbers(&self.view(name)?).map(|x| x as usize).collect())
    }

    /// Loads the token ids of the prompts, `[batch, tokens]`.
    pub(super) fn tokens(&self) -> Result<Tensor<2, Int>, ParityError> {
        let view = self.view("in.tokens")?;
        let ids: Vec<i32> = numbers(&view).map(|x| x as i32).collect();
        let data = TensorData::new(ids, view.shape().to_vec());
        Ok(Tensor::from_data(data, &self.device))
    }

    /// Returns the lengths of the motions in frames. Like the reference, takes a length beyond the frames of the batch as all frames.
    pub(super) fn lengths(&self) -> Result<Vec<usize>, ParityError> {
        let [_, frames, _] = self.dims("in.z")?;
        let lengths = self.integers("in.lengths")?.into_iter();
        Ok(lengths.map(|length| length.min(frames)).collect())
    }

    /// Returns the number of DDIM steps.
    pub(super) fn steps(&self) -> Result<usize, ParityError> {
        Ok(self.integers("out.timesteps")?.len())
    }

    /// Returns the factors on Weight, Time, Flow and Shape.
    pub(super) fn scale(&self) -> Result<Scale, ParityError> {
        let factors: Vec<f32> = numbers(&self.view("in.scale")?).map(|x| x as f32).collect();
        let factors = factors.try_into().map_err(|found| {
            self.problem(format!("expected 4 values of in.scale, found {found:?}"))
        })?;
        Ok(Scale::new(factors)?)
    }
}

/// Returns the numbers of a stored tensor of any supported type.
pub(super) fn numbers<'v>(view: &TensorView<'v>) -> Box<dyn Iterator<Item = f64> + 'v> {
    let data = view.data();
    match view.dtype() {
        Dtype::F32 => Box::new(
            data.as_chunks()
                .0
                .iter()
                .map(|&bytes| f64::from(f32::from_le_bytes(bytes))),
        ),
        Dtype::F64 => Box::new(
            data.as_chunks()
                .0
                .iter()
                .map(|&bytes| f64::from_le_bytes(bytes)),
        ),
        Dtype::I64 => Box::new(
            data.as_chunks()
                .0
                .iter()
                .map(|&bytes| i64::from_le_bytes(bytes) as f64),
        ),
        Dtype::I32 => Box::new(
            data.as_chunks()
                .0
                .iter()
                .map(|&bytes| f64::from(i32::from_le_bytes(bytes))),
        ),
        other => unreachable!("{other:?} is refused by Case::view"),
    }
}
