//! Tests of MDM: against PyTorch's layers (`tests/golden/mdm/make.py`), of its files, and of what guidance may move.

#[path = "golden/mdm/case.rs"]
mod case;

use burn::tensor::{Device, Int, Tensor, TensorData, Tolerance};
use case::{GoldenCase, golden};
use lamogen_model::{
    Denoiser, DenoiserInput, FrameMask, LinearizedEvaluation, Mdm, MdmConfig, MdmContext, MdmText,
    Prompt, TextEncoderKind, TokenBatch,
};

impl GoldenCase {
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
            timesteps: self.counts("timestep"),
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
        let case = GoldenCase::open(name, "clip.safetensors");
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
        let case = GoldenCase::open(name, "clip.safetensors");
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
        let case = GoldenCase::open(name, "clip.safetensors");
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

/// Returns offsets of the norms and tokens of a network, in part random and in part 0.
fn offsets(network: &Mdm, scale: f32) -> Tensor<2> {
    let width = network.modulation_width() + network.token_offset_width();
    let values: Vec<f32> = (0..2 * width)
        .map(|i| scale * (i as f32 * 1.7).sin())
        .collect();
    Tensor::<1>::from_floats(&values[..], &Device::flex()).reshape([2, width])
}

#[test]
fn offsets_of_tokens_are_added_where_the_embedding_is() {
    for name in CASES {
        let case = GoldenCase::open(name, "clip.safetensors");
        let [prompt, _] = case.prompts();
        let network = &case.network;
        let (latent, layers) = (network.config().latent_dim, network.config().layers);
        let step: Vec<f32> = (0..2 * latent).map(|i| 0.1 * (i as f32).cos()).collect();
        let step = Tensor::<1>::from_floats(&step[..], &Device::flex()).reshape([2, latent]);
        let tokens = prompt.embedding.dims()[1] / latent;
        let moved = case.input(prompt.embedding.clone() + step.clone().repeat(&[1, tokens]));
        // The token of an encoder goes through the layers; those of a decoder are the same in all of them.
        let offsets = match name {
            "trans_enc" => vec![step.clone(), step.zeros_like()],
            _ => vec![step; layers],
        };
        let norms = Tensor::zeros([2, network.modulation_width()], &Device::flex());
        let mut offset = case.input(prompt.embedding);
        let unmoved = network.denoise(offset.clone(), &prompt.context);
        offset.modulation = Some(Tensor::cat([vec![norms], offsets].concat(), 1));
        let [moved, offset] = [moved, offset].map(|input| network.denoise(input, &prompt.context));
        let change: f32 = (moved.clone() - unmoved).abs().max().into_scalar();
        let difference: f32 = (moved - offset).abs().max().into_scalar();
        assert!(
            change > 1e-3 && difference < 1e-4 * change,
            "{name}: {change} {difference}"
        );
    }
}

#[test]
fn the_gradient_of_offsets_is_the_slope_of_the_output() {
    for name in CASES {
        let case = GoldenCase::open(name, "clip.safetensors");
        let [prompt, _] = case.prompts();
        let network = &case.network;
        let input = |scale: f32| DenoiserInput {
            modulation: Some(offsets(network, scale)),
            ..case.input(prompt.embedding.clone())
        };
        let pull = case.keep(case.tensor("x"));
        let value = |scale: f32| -> f32 {
            let output = network.denoise(input(scale), &prompt.context);
            (output * pull.clone()).sum().into_scalar()
        };
        let gradient = network
            .linearize(input(0.0), &prompt.context)
            .pull(pull.clone());
        let slope: f32 = (gradient * offsets(network, 1.0)).sum().into_scalar();
        const STEP: f32 = 2e-3;
        let expected = (value(STEP) - value(-STEP)) / (2.0 * STEP);
        let tolerance = 0.01 * expected.abs().max(1.0);
        assert!(
            (slope - expected).abs() < tolerance,
            "{name}: {slope} {expected}"
        );
    }
}

#[test]
fn zero_offsets_change_nothing() {
    for name in CASES {
        let case = GoldenCase::open(name, "clip.safetensors");
        let [prompt, _] = case.prompts();
        let plain = case.input(prompt.embedding.clone());
        let with = DenoiserInput {
            modulation: Some(offsets(&case.network, 0.0)),
            ..plain.clone()
        };
        let [plain, with] = [plain, with].map(|input| case.network.denoise(input, &prompt.context));
        assert_near(case.keep(with), case.keep(plain).into_data(), 1e-6);
    }
}

#[test]
fn openai_s_and_hugging_face_s_files_hold_the_same_tower() {
    let device = Device::flex();
    let (openai, hugging_face) = (golden("clip.pt"), golden("clip.safetensors"));
    let [openai, hugging_face] =
        [openai, hugging_face].map(|path| MdmText::clip(path, &device).unwrap());
    assert_eq!(openai.config(), hugging_face.config());
    let case = GoldenCase::open("trans_enc", "clip.safetensors");
    let (config, folder) = (case.network.config(), golden("trans_enc"));
    let weights = config
        .open_weights(folder.join("model000000010.pt"))
        .unwrap();
    let embed = |text| {
        let network = Mdm::load(&weights, config, text, &device).unwrap();
        network.encode(&case.tokens()).embedding
    };
    let (a, b) = (embed(openai), embed(hugging_face));
    assert_near(a, b.into_data(), 1e-6);
}

#[test]
fn the_average_of_the_weights_is_read_only_where_it_is_asked_for() {
    let folder = golden("trans_dec");
    let config = MdmConfig::from_file(folder.join("args.json")).unwrap();
    let text = || MdmText::distilbert(golden("distilbert.safetensors"), &Device::flex()).unwrap();
    let embedding = |use_ema| {
        let config = MdmConfig {
            use_ema,
            ..config.clone()
        };
        let weights = config
            .open_weights(folder.join("model000000010.pt"))
            .unwrap();
        let config = config.with_sizes_of(&weights).unwrap();
        let network = Mdm::load(&weights, &config, text(), &Device::flex()).unwrap();
        network.embed_timesteps(&[1])
    };
    let difference: f32 = (embedding(true) - embedding(false))
        .abs()
        .max()
        .into_scalar();
    assert!(difference > 0.1, "{difference}");
}

#[test]
fn files_of_another_kind_are_named() {
    let device = Device::flex();
    let message = |result: Result<MdmText, lamogen_model::CheckpointError>| {
        result.expect_err("another kind of file").to_string()
    };
    let clip = message(MdmText::clip(golden("distilbert.safetensors"), &device));
    assert!(
        clip.contains("distilbert.safetensors") && clip.contains("CLIP"),
        "{clip}"
    );
    let bert = message(MdmText::distilbert(golden("clip.safetensors"), &device));
    assert!(
        bert.contains("clip.safetensors") && bert.contains("word_embeddings"),
        "{bert}"
    );
    // The weights of another architecture.
    let config = MdmConfig::from_json(b"{}", "args.json").unwrap();
    let weights = config
        .open_weights(golden("dip/model000000010.pt"))
        .unwrap();
    let error = config.with_sizes_of(&weights).unwrap_err().to_string();
    assert!(
        error.contains("seqTransEncoder") && error.contains("dip"),
        "{error}"
    );
}

/// Returns an input of two motions of many frames, of which one is padded. A window has a length of its own.
fn long_input(case: &GoldenCase, prompt: &Prompt<MdmContext>) -> DenoiserInput {
    let (frames, lengths) = match case.network.window() {
        Some(window) => (window.frames, [window.frames; 2]),
        None => (120, [120, 37]),
    };
    let values: Vec<f32> = (0..2 * frames * 263)
        .map(|i| (i as f32 * 0.37).sin())
        .collect();
    DenoiserInput {
        x_t: Tensor::<1>::from_floats(&values[..], &Device::flex()).reshape([2, frames, 263]),
        mask: FrameMask::new(&lengths, frames, &Device::flex()),
        ..case.input(prompt.embedding.clone())
    }
}

fn masked(motions: Tensor<3>, mask: &FrameMask) -> Tensor<3> {
    match mask.keep() {
        Some(keep) => motions * keep,
        None => motions,
    }
}

#[test]
fn the_kernels_compute_what_the_tensor_operations_do() {
    for name in CASES {
        let case = GoldenCase::open(name, "clip.safetensors");
        let (network, [prompt, _]) = (&case.network, case.prompts());
        for modulation in [None, Some(offsets(network, 0.05))] {
            let input = DenoiserInput {
                modulation,
                ..long_input(&case, &prompt)
            };
            let mask = input.mask.clone();
            // The kernels know no tape, so what autodiff follows is computed by tensor operations.
            let evaluate = |input| network.denoise(input, &prompt.context);
            let expected = LinearizedEvaluation::by_autodiff(input.clone(), evaluate);
            let found = network.linearize(input.clone(), &prompt.context);
            let alone = network.denoise(input, &prompt.context);
            assert_near(alone, found.output.clone().into_data(), 1e-7);
            let expected_output = masked(expected.output.clone(), &mask).into_data();
            assert_near(masked(found.output.clone(), &mask), expected_output, 1e-5);
            let pull = masked(expected.output.clone().cos(), &mask);
            let [expected, found] =
                [expected, found].map(|evaluation| evaluation.pull(pull.clone()));
            assert_near(found, expected.into_data(), 1e-4);
        }
    }
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let case = GoldenCase::open("trans_enc", "clip.safetensors");
    let (network, [prompt, _]) = (&case.network, case.prompts());
    let input = DenoiserInput {
        modulation: Some(offsets(network, 0.05)),
        ..long_input(&case, &prompt)
    };
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        pool.build().unwrap().install(|| {
            let linearized = network.linearize(input.clone(), &prompt.context);
            let output = linearized.output.clone();
            let gradient = linearized.pull(output.clone());
            (output.into_data(), gradient.into_data())
        })
    };
    let one = run(1);
    for threads in [2, 5] {
        let many = run(threads);
        assert_eq!(one.0.as_bytes(), many.0.as_bytes());
        assert_eq!(one.1.as_bytes(), many.1.as_bytes());
    }
}
