//! Writing of safetensors files.

use std::collections::HashMap;
use std::path::Path;

use burn::module::Module;
use burn::tensor::TensorData;
use lamogen_motion::replace_atomically;
use safetensors::tensor::{Dtype, TensorView};

use super::keys::{NamedParameters, ParameterList, TensorVisitor};
use super::{Checkpoint, CheckpointError, Precision};
use crate::network::MotionDiffuse;

impl MotionDiffuse {
    /// Writes the weights as safetensors, under the keys of the public checkpoint.
    ///
    /// `metadata` is free text that is stored with the weights, such as `license`. The file is written whole or not at all.
    ///
    /// # Errors
    ///
    /// If the file cannot be written, or if a weight is beyond the range of 16 bits and `precision` requires 16 bits.
    pub fn save(
        &self,
        path: impl AsRef<Path>,
        precision: Precision,
        metadata: HashMap<String, String>,
    ) -> Result<(), CheckpointError> {
        Checkpoint::write(self, path, precision, metadata)
    }
}

impl Checkpoint {
    /// Writes the weights of a network of any kind as safetensors, under its keys.
    ///
    /// `metadata` is free text that is stored with the weights, such as `license`. The file is written whole or not at all.
    ///
    /// # Errors
    ///
    /// If the file cannot be written, or if a weight is beyond the range of 16 bits and `precision` requires 16 bits.
    pub fn write(
        network: &(impl NamedParameters + Module),
        path: impl AsRef<Path>,
        precision: Precision,
        metadata: HashMap<String, String>,
    ) -> Result<(), CheckpointError> {
        let path = path.as_ref();
        let mut writer = WeightWriter {
            precision,
            tensors: Vec::new(),
            problem: None,
        };
        let device = network.devices().into_iter().next().unwrap_or_default();
        network
            .clone()
            .keys(&mut ParameterList::new(device, &mut writer));
        if let Some(key) = writer.problem {
            return Err(CheckpointError::Range {
                path: path.to_owned(),
                key,
            });
        }
        let views = writer.tensors.iter().map(|(key, dtype, data)| {
            let view = TensorView::new(*dtype, data.shape().to_vec(), data.as_bytes());
            (key, view.expect("as many bytes as the shape asks for"))
        });
        replace_atomically(path, |temporary| {
            safetensors::serialize_to_file(views, Some(metadata), temporary)
                .map_err(std::io::Error::other)
        })
        .map_err(|reason| CheckpointError::Io {
            path: path.to_owned(),
            reason,
        })
    }
}

/// Collects the tensors of a network in the precision in which they are written.
struct WeightWriter {
    precision: Precision,
    tensors: Vec<(String, Dtype, TensorData)>,
    /// The first tensor that does not fit the precision.
    problem: Option<String>,
}

impl TensorVisitor for WeightWriter {
    fn visit(
        &mut self,
        key: &str,
        shape: &[usize],
        current: &dyn Fn() -> TensorData,
    ) -> Option<TensorData> {
        let data = current();
        for &part in self.precision.parts(shape.len()) {
            let dtype = self.precision.dtype(part, shape.len());
            match self.precision.convert(data.clone(), part) {
                Some(data) => self.tensors.push((part.key(key), dtype, data)),
                None => self.problem = self.problem.take().or_else(|| Some(key.to_owned())),
            }
        }
        None
    }
}
