//! A golden case of MDM. The tests of `lamogen-model` and of `lamogen-guide` share it.

use std::path::{Path, PathBuf};

use burn::tensor::{Device, Tensor, TensorData};
use lamogen_model::{Mdm, MdmConfig, MdmText, TextEncoderKind};
use safetensors::SafeTensors;

/// Returns the path of a file of the golden cases.
pub fn golden(name: &str) -> PathBuf {
    // The folder stands beside the crate of either test.
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../lamogen-model/tests/golden/mdm")
        .join(name)
}

/// A network of the golden cases, with PyTorch's inputs and outputs.
pub struct GoldenCase {
    pub network: Mdm,
    file: Vec<u8>,
}

impl GoldenCase {
    /// Opens a case. `clip` is the file with the text tower of CLIP, for networks that read with CLIP.
    pub fn open(name: &str, clip: &str) -> GoldenCase {
        let (folder, device) = (golden(name), Device::flex());
        let config = MdmConfig::from_file(folder.join("args.json")).unwrap();
        let text = match config.text_encoder_type {
            TextEncoderKind::Clip => MdmText::clip(golden(clip), &device),
            TextEncoderKind::Bert => MdmText::distilbert(golden("distilbert.safetensors"), &device),
        };
        let weights = config
            .open_weights(folder.join("model000000010.pt"))
            .unwrap();
        let config = config.with_sizes_of(&weights).unwrap();
        GoldenCase {
            network: Mdm::load(&weights, &config, text.unwrap(), &device).unwrap(),
            file: std::fs::read(folder.join("case.safetensors")).unwrap(),
        }
    }

    pub fn data(&self, name: &str) -> TensorData {
        let file = SafeTensors::deserialize(&self.file).unwrap();
        let tensor = file.tensor(name).unwrap();
        let numbers = tensor.data().chunks_exact(4).map(|bytes| {
            let bytes = bytes.try_into().unwrap();
            match tensor.dtype() {
                safetensors::Dtype::I32 => i32::from_le_bytes(bytes) as f32,
                _ => f32::from_le_bytes(bytes),
            }
        });
        TensorData::new(numbers.collect::<Vec<f32>>(), tensor.shape().to_vec())
    }

    pub fn tensor<const D: usize>(&self, name: &str) -> Tensor<D> {
        Tensor::from_data(self.data(name), &Device::flex())
    }

    pub fn counts(&self, name: &str) -> Vec<usize> {
        self.data(name).iter::<f32>().map(|x| x as usize).collect()
    }
}
