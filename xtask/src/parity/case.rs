//! The file of a golden case.

use std::path::PathBuf;

use burn::tensor::{Device, Int, Tensor, TensorData};
use lamogen_laban::Scale;
use safetensors::SafeTensors;
use safetensors::tensor::{Dtype, TensorView};

use super::ParityError;

/// The file of inputs and expected values.
pub(super) struct Case<'a> {
    path: PathBuf,
    tensors: SafeTensors<'a>,
    pub(super) device: Device,
}

impl<'a> Case<'a> {
    /// `path` stands in error messages.
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

    /// Names of the expected values, sorted.
    pub(super) fn expected(&self) -> Vec<&str> {
        let mut names = self.tensors.names();
        names.retain(|name| name.starts_with("out."));
        names.sort_unstable();
        names
    }

    fn problem(&self, problem: String) -> ParityError {
        ParityError::Case {
            path: self.path.clone(),
            problem,
        }
    }

    pub(super) fn view(&self, name: &str) -> Result<TensorView<'_>, ParityError> {
        self.tensors
            .tensor(name)
            .map_err(|_| self.problem(format!("{name} is missing")))
    }

    pub(super) fn tensor<const D: usize>(&self, name: &str) -> Result<Tensor<D>, ParityError> {
        let view = self.view(name)?;
        if view.shape().len() != D {
            let shape = view.shape();
            return Err(self.problem(format!("expected {D} axes of {name}, found {shape:?}")));
        }
        let values: Vec<f32> = numbers(&view).map(|x| x as f32).collect();
        let data = TensorData::new(values, view.shape().to_vec());
        Ok(Tensor::from_data(data, &self.device))
    }

    pub(super) fn integers(&self, name: &str) -> Result<Vec<usize>, ParityError> {
        Ok(numbers(&self.view(name)?).map(|x| x as usize).collect())
    }

    pub(super) fn tokens(&self) -> Result<Tensor<2, Int>, ParityError> {
        let view = self.view("in.tokens")?;
        let ids: Vec<i32> = numbers(&view).map(|x| x as i32).collect();
        let data = TensorData::new(ids, view.shape().to_vec());
        Ok(Tensor::from_data(data, &self.device))
    }

    pub(super) fn lengths(&self) -> Result<Vec<usize>, ParityError> {
        self.integers("in.lengths")
    }

    pub(super) fn steps(&self) -> Result<usize, ParityError> {
        Ok(self.integers("out.timesteps")?.len())
    }

    pub(super) fn scale(&self) -> Result<Scale, ParityError> {
        let factors: Vec<f32> = numbers(&self.view("in.scale")?).map(|x| x as f32).collect();
        let factors = factors.try_into().map_err(|found| {
            self.problem(format!("expected 4 values of in.scale, found {found:?}"))
        })?;
        Ok(Scale::new(factors)?)
    }
}

/// The numbers of a stored tensor, whichever of the case's types they are.
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
        // Comparing with nothing fails on its shape.
        _ => Box::new(std::iter::empty()),
    }
}
