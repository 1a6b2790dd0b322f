//! Tests of MDM: against PyTorch's layers (`tests/golden/mdm/make.py`), of its files, and of what guidance may move.

use std::path::{Path, PathBuf};

use burn::tensor::{Device, Int, Tensor, TensorData, Tolerance};
use lamogen_model::{
    Denoiser, DenoiserInput, FrameMask, Mdm, MdmConfig, MdmContext, MdmText, Prompt,
    TextEncoderKind, TokenBatch,
};
use safetensors::SafeTensors;

fn golden(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/golden/mdm")
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
            TextEncoderKind::Clip => MdmText::clip(golden("clip.safetensors"), &device),
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

    fn tokens(&self) -> TokenBatch {
        let data = self.data("ids");
        let ids: Vec<i32> = data.iter::<i32>().collect();
        let ids = TensorData::new(ids, data.shape().to_vec());
        TokenBatch {
            ids: Tensor::<2, Int>::from_data(ids, &Device::flex()),
            lengths: self.counts("lengths"),
        }
    }

    /// Returns the encoded texts, and what takes their place without a text.
    fn prompts(&self) -> [Prompt<MdmContext>; 2] {
        let mut prompt = self.network.encode(&self.tokens());
        if self.network.window().is_some() {
            prompt.context = self
                .network
                .with_prefix(prompt.context, self.tensor("prefix"));
        }
        let unconditional = self.network.unconditional(&prompt, &self.tokens());
        [prompt, unconditional]
    }

    fn input(&self, embedding: Tensor<2>) -> DenoiserInput {
        let frames = self.counts("frames");
        let longest = frames.iter().copied().max().unwrap();
        DenoiserInput {
            x_t: self.tensor("x"),
            time: self.network.embed_timesteps(&self.counts("timestep")),
            embedding,
            modulation: None,
            mask: FrameMask::new(&frames, longest, &Device::flex()),
        }
    }

    /// Sets the frames past the end of a motion to 0.
    fn keep(&self, motions: Tensor<3>) -> Tensor<3> {
        match self
            .input(Tensor::zeros([2, 1], &Device::flex()))
            .mask
            .keep()
        {
            Some(keep) => motions * keep,
            None => motions,
        }
    }

    fn scale(&self) -> f32 {
        self.data("scale").iter::<f32>().next().unwrap()
    }
}

const CASES: [&str; 3] = ["trans_enc", "trans_dec", "dip"];

fn assert_near<const D: usize>(found: Tensor<D>, expected: TensorData, relative: f32) {
    let largest = expected.iter::<f32>().map(f32::abs).fold(0.0, f32::max);
    assert!(largest > 0.0);
    let tolerance = Tolerance::<f32>::rel_abs(relative, relative * largest);
    found
        .into_data()
        .assert_approx_eq::<f32>(&expected, tolerance);
}

#[test]
fn texts_are_embedded_as_by_pytorch() {
    for name in CASES {
        let case = GoldenCase::open(name);
        let [prompt, _] = case.prompts();
        let (found, expected) = (prompt.embedding, case.data("embedding"));
        // The features of padding tokens have no meaning; nothing attends to them.
        let width = case.network.config().latent_dim;
        let lengths = match case.network.text().kind() {
            TextEncoderKind::Clip => vec![1; 2],
            TextEncoderKind::Bert => case.counts("lengths"),
        };
        let expected = Tensor::<2>::from_data(expected, &Device::flex());
        for (row, length) in lengths.into_iter().enumerate() {
            let part = |all: &Tensor<2>| all.clone().narrow(0, row, 1).narrow(1, 0, length * width);
            assert_near(part(&found), part(&expected).into_data(), 1e-5);
        }
    }
}

#[test]
fn an_evaluation_is_pytorchs() {
    for name in CASES {
        let case = GoldenCase::open(name);
        let [prompt, _] = case.prompts();
        let output = case
            .network
            .denoise(case.input(prompt.embedding), &prompt.context);
        assert_near(case.keep(output), case.data("conditional"), 1e-5);
    }
}

#[test]
fn a_guided_evaluation_and_its_gradient_are_pytorchs() {
    for name in CASES {
        let case = GoldenCase::open(name);
        let [prompt, unconditional] = case.prompts();
        let (input, scale) = (case.input(prompt.embedding.clone()), case.scale());
        let [with_text, without] =
            case.network
                .denoise_with_unconditional(input.clone(), &prompt.context, &unconditional);
        let guided = without.clone() + (with_text - without) * scale;
        assert_near(case.keep(guided), case.data("guided"), 1e-5);

        let linearized = case.network.linearize(input, &prompt.context);
        let pull = case.keep(case.tensor("x"));
        let gradient = linearized.pull(pull * scale);
        assert_near(gradient, case.data("gradient"), 1e-4);
    }
}
