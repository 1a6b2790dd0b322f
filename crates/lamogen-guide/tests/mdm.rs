//! Whole passes of MDM against PyTorch (`lamogen-model/tests/golden/mdm/make.py`), and its guidance.

use std::path::{Path, PathBuf};

use burn::tensor::{Device, Int, Tensor, TensorData, Tolerance};
use lamogen_guide::{Batch, ClassifierFree, ClassifierFreeContext, Sampler, StepNoise};
use lamogen_model::{
    Denoiser, FrameMask, Mdm, MdmConfig, MdmContext, MdmText, TextEncoderKind, TokenBatch, Tokens,
};
use lamogen_motion::{Normalization, POSE_FEATURES};
use safetensors::SafeTensors;

fn golden(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../lamogen-model/tests/golden/mdm")
        .join(name)
}

/// A network of the golden cases, with PyTorch's inputs and outputs.
struct GoldenCase {
    network: Mdm,
    file: Vec<u8>,
}

impl GoldenCase {
    fn open(name: &str) -> GoldenCase {
        let (folder, device) = (golden(name), Device::flex());
        let config = MdmConfig::from_file(folder.join("args.json")).unwrap();
        let text = match config.text_encoder_type {
            TextEncoderKind::Clip => MdmText::clip(golden("clip.pt"), &device),
            TextEncoderKind::Bert => MdmText::distilbert(golden("distilbert.safetensors"), &device),
        };
        let weights = config.open_weights(folder.join("model000000010.pt"));
        let weights = weights.unwrap();
        let config = config.with_sizes_of(&weights).unwrap();
        GoldenCase {
            network: Mdm::load(&weights, &config, text.unwrap(), &device).unwrap(),
            file: std::fs::read(folder.join("case.safetensors")).unwrap(),
        }
    }

    fn data(&self, name: &str) -> TensorData {
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

    fn tensor<const D: usize>(&self, name: &str) -> Tensor<D> {
        Tensor::from_data(self.data(name), &Device::flex())
    }

    fn counts(&self, name: &str) -> Vec<usize> {
        self.data(name).iter::<f32>().map(|x| x as usize).collect()
    }

    fn network(&self) -> ClassifierFree<'_, Mdm> {
        let scale = f64::from(self.data("scale").iter::<f32>().next().unwrap());
        ClassifierFree::new(&self.network, scale, &wordless()).unwrap()
    }

    fn batch(
        &self,
        network: &ClassifierFree<'_, Mdm>,
        step_noise: Option<StepNoise>,
    ) -> Batch<ClassifierFreeContext<MdmContext>> {
        let data = self.data("ids");
        let ids = TensorData::new(data.iter::<i32>().collect(), data.shape().to_vec());
        let mut prompt = network.encode(&TokenBatch {
            ids: Tensor::<2, Int>::from_data(ids, &Device::flex()),
            lengths: self.counts("lengths"),
        });
        if network.window().is_some() {
            prompt.context = network.with_prefix(prompt.context, self.tensor("prefix"));
        }
        Batch {
            prompt,
            noise: self.tensor("x"),
            lengths: self.counts("frames"),
            step_noise,
        }
    }

    /// Runs all timesteps and compares the motions with PyTorch's.
    fn assert_pass(&self, step_noise: Option<StepNoise>, expected: &str) {
        let network = self.network();
        let batch = self.batch(&network, step_noise);
        let normalization = normalization();
        let timesteps = self.network.noise_schedule().timesteps();
        let sampler = Sampler::new(&network, &normalization, timesteps).unwrap();
        let motions = sampler.baseline(&batch, &mut ()).unwrap();
        let frames = batch.noise.dims()[1];
        let mask = FrameMask::new(&batch.lengths, frames, &Device::flex());
        let motions = mask.keep().map_or(motions.clone(), |keep| motions * keep);
        let expected = self.data(expected);
        let largest = expected.iter::<f32>().map(f32::abs).fold(0.0, f32::max);
        let tolerance = Tolerance::<f32>::rel_abs(1e-5, 1e-5 * largest);
        motions
            .into_data()
            .assert_approx_eq::<f32>(&expected, tolerance);
    }

    /// Returns the noise that PyTorch added at each step.
    fn step_noise(&self) -> StepNoise {
        let all = self.tensor::<4>("step_noise");
        let [steps, ..] = all.dims();
        let step = |step| all.clone().narrow(0, step, 1).squeeze_dim(0);
        StepNoise::Given((0..steps).map(step).collect())
    }
}

fn wordless() -> Tokens {
    Tokens {
        ids: vec![0],
        length: 1,
        cut: 0,
        own: 0,
    }
}

fn normalization() -> Normalization {
    let (mean, std) = ([0.0; POSE_FEATURES], [1.0; POSE_FEATURES]);
    Normalization::from_slices(&mean, &std, &Device::flex()).unwrap()
}

#[test]
fn a_pass_of_fifty_deterministic_steps_is_pytorchs() {
    GoldenCase::open("trans_enc").assert_pass(None, "pass");
}

#[test]
fn passes_of_the_network_s_own_sampler_are_pytorchs() {
    for name in ["trans_dec", "dip"] {
        let case = GoldenCase::open(name);
        case.assert_pass(Some(case.step_noise()), "pass");
        case.assert_pass(None, "pass.ddim");
    }
}

#[test]
fn more_steps_than_the_network_has_timesteps_are_refused() {
    let case = GoldenCase::open("dip");
    let (network, normalization) = (case.network(), normalization());
    let error = Sampler::new(&network, &normalization, 5).err().unwrap();
    let message = error.to_string();
    assert!(
        message.contains("1 to 4") && message.contains("found 5"),
        "{message}"
    );
}
