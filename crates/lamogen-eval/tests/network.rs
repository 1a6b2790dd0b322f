//! Tests of the network: against PyTorch's (`tests/golden/evaluator/make.py`), in files, in batches and in training.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use burn::module::Module;
use burn::optim::{AdamConfig, GradientsParams};
use burn::tensor::{Device, Int, Tensor, TensorData, Tolerance};
use lamogen_eval::{
    Dropout, EvaluatorConfig, EvaluatorNetwork, TextBatch, TextForm, contrastive_loss, random_shift,
};
use lamogen_model::{Checkpoint, Precision, Tokenizer};
use rand::SeedableRng;
use rand_chacha::ChaCha12Rng;
use safetensors::SafeTensors;

fn golden(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/golden/evaluator")
        .join(name)
}

fn config() -> EvaluatorConfig {
    EvaluatorConfig::from_file(golden("config.json")).unwrap()
}

/// Returns the network of `finest.tar`, which has the format of the public code.
fn golden_network() -> EvaluatorNetwork {
    EvaluatorNetwork::load(golden("finest.tar"), &config(), &Device::flex()).unwrap()
}

/// The inputs of the golden case and PyTorch's outputs for them, as the bytes of a safetensors file.
struct GoldenCase(Vec<u8>);

impl GoldenCase {
    fn open() -> GoldenCase {
        GoldenCase(std::fs::read(golden("case.safetensors")).unwrap())
    }

    fn data(&self, name: &str) -> TensorData {
        let file = SafeTensors::deserialize(&self.0).unwrap();
        let tensor = file.tensor(name).unwrap();
        let numbers = tensor.data().chunks_exact(4);
        let values: Vec<f32> = numbers
            .map(|bytes| {
                let bytes = bytes.try_into().unwrap();
                match tensor.dtype() {
                    safetensors::Dtype::I32 => i32::from_le_bytes(bytes) as f32,
                    _ => f32::from_le_bytes(bytes),
                }
            })
            .collect();
        TensorData::new(values, tensor.shape().to_vec())
    }

    fn tensor<const D: usize>(&self, name: &str) -> Tensor<D> {
        Tensor::from_data(self.data(name), &Device::flex())
    }

    fn counts(&self, name: &str) -> Vec<usize> {
        self.data(name).iter::<f32>().map(|x| x as usize).collect()
    }

    fn texts(&self) -> TextBatch {
        TextBatch::Words {
            vectors: self.tensor("vectors"),
            parts_of_speech: self.tensor("parts_of_speech"),
            lengths: self.counts("words"),
        }
    }
}

/// Asserts that a tensor has the expected values.
fn assert_near<const D: usize>(found: Tensor<D>, expected: TensorData) {
    let tolerance = Tolerance::<f32>::rel_abs(1e-5, 2e-6);
    found
        .into_data()
        .assert_approx_eq::<f32>(&expected, tolerance);
}

#[test]
fn the_public_file_gives_pytorchs_embeddings() {
    let (case, evaluator) = (GoldenCase::open(), golden_network());
    assert_near(
        evaluator.embed_text(&case.texts()),
        case.data("text_embeddings"),
    );
    let motions = evaluator.embed_motion(case.tensor("features"), &case.counts("frames"), None);
    assert_near(motions, case.data("motion_embeddings"));
}

#[test]
fn loss_and_gradients_are_pytorchs() {
    let (case, evaluator) = (GoldenCase::open(), golden_network().train());
    let texts = evaluator.embed_text(&case.texts());
    let motions = evaluator.embed_motion(case.tensor("features"), &case.counts("frames"), None);
    let loss = contrastive_loss(texts, motions, case.counts("shift")[0], 10.0);
    assert_near(loss.clone(), case.data("loss"));
    let gradients = GradientsParams::from_grads(loss.backward(), &evaluator);
    let parameters = gradients.len();
    // The movement encoder has two convolutions and a linear layer. Both other encoders have a linear layer, initial
    // states, four layers of the GRU and three of the projection, and the text encoder also a layer for the parts of
    // speech. All but the initial states have two tensors.
    assert_eq!(parameters, 6 + 2 * (2 + 1 + 8 + 6) + 2);
    // The gradients replace the weights, so that they are saved under the weights' keys.
    let gradients = Gradients(gradients).replace_weights(evaluator);
    let folder = tempfile::tempdir().unwrap();
    gradients
        .save(folder.path(), Precision::F32, HashMap::new())
        .unwrap();
    let file = std::fs::read(folder.path().join("model.safetensors")).unwrap();
    let found = GoldenCase(file);
    for (key, name) in [
        ("text_encoder.gru.weight_hh_l0_reverse", "gradient.text"),
        ("movement_encoder.main.0.weight", "gradient.motion"),
        ("motion_encoder.hidden", "gradient.start"),
    ] {
        let expected = case.data(name);
        let largest = expected.iter::<f32>().map(f32::abs).fold(0.0, f32::max);
        assert!(largest > 0.0);
        let tolerance = Tolerance::<f32>::rel_abs(1e-4, 1e-5 * largest);
        found
            .data(key)
            .assert_approx_eq::<f32>(&expected, tolerance);
    }
}

/// A mapper that replaces weights by their gradients.
struct Gradients(GradientsParams);

impl Gradients {
    fn replace_weights(mut self, evaluator: EvaluatorNetwork) -> EvaluatorNetwork {
        evaluator.map(&mut self)
    }
}

impl burn::module::ModuleMapper for Gradients {
    fn map_float<const D: usize>(
        &mut self,
        parameter: burn::module::Param<Tensor<D>>,
    ) -> burn::module::Param<Tensor<D>> {
        let gradient = self.0.remove::<D>(parameter.id).expect("a gradient");
        burn::module::Param::initialized(parameter.id, gradient)
    }
}

#[test]
fn a_batch_is_its_members_whatever_the_padding_holds() {
    let (case, evaluator) = (GoldenCase::open(), golden_network());
    let frames = case.counts("frames");
    let together: Tensor<3> = case.tensor("features");
    let longest = evaluator.embed_motion(together.clone(), &frames, None);
    for (row, &length) in frames.iter().enumerate() {
        let alone = together.clone().narrow(0, row, 1).narrow(1, 0, length);
        let alone = evaluator.embed_motion(alone, &[length], None);
        assert_near(alone, longest.clone().narrow(0, row, 1).into_data());
    }
    // The first motion has 16 frames; here NaN follows them.
    let padded = together.clone().narrow(0, 0, 1);
    let nan = Tensor::full([1, 12, 9], f32::NAN, &Device::flex());
    let padded = Tensor::cat(vec![padded.narrow(1, 0, 16), nan], 1);
    let found = evaluator.embed_motion(padded, &frames[..1], None);
    assert_near(found, longest.narrow(0, 0, 1).into_data());

    let TextBatch::Words {
        vectors,
        parts_of_speech,
        lengths,
    } = case.texts()
    else {
        unreachable!()
    };
    let texts = evaluator.embed_text(&case.texts());
    for (row, &length) in lengths.iter().enumerate() {
        let cut = |x: &Tensor<3>| x.clone().narrow(0, row, 1).narrow(1, 0, length);
        let alone = evaluator.embed_text(&TextBatch::Words {
            vectors: cut(&vectors),
            parts_of_speech: cut(&parts_of_speech),
            lengths: vec![length],
        });
        assert_near(alone, texts.clone().narrow(0, row, 1).into_data());
    }
}

fn small_config(text: TextForm) -> EvaluatorConfig {
    EvaluatorConfig {
        dim_pose: 10,
        max_motion_length: 24,
        dim_movement_enc_hidden: 16,
        dim_movement_latent: 16,
        dim_motion_hidden: 16,
        dim_text_hidden: 16,
        dim_coemb_hidden: 8,
        text,
    }
}

fn token_config() -> EvaluatorConfig {
    small_config(TextForm::Tokens {
        vocab_size: 40,
        context_length: 24,
        dim_word: 12,
    })
}

/// Returns the features of four motions, their lengths and their texts.
fn pairs() -> (Tensor<3>, Vec<usize>, TextBatch) {
    let device = Device::flex();
    let features = Tensor::<1, Int>::arange(0..4 * 24 * 6, &device).float();
    let features = (features * 0.37).sin().reshape([4, 24, 6]);
    let ids = Tensor::from_data(
        [[1, 5, 39, 0], [1, 6, 7, 39], [1, 39, 0, 0], [1, 8, 39, 0]],
        &device,
    );
    let texts = TextBatch::Tokens {
        ids,
        lengths: vec![3, 4, 2, 3],
    };
    (features, vec![24, 20, 16, 9], texts)
}

#[test]
fn a_tokenizers_texts_end_at_their_end_token() {
    let tokenizer = Tokenizer::clip(16);
    let texts = ["a person jumps", "walk"].map(|text| tokenizer.encode(text).unwrap());
    let batch = TextBatch::tokens(&texts, &Device::flex());
    assert_eq!(batch.lengths(), [5, 3]);
    let config = small_config(TextForm::Tokens {
        vocab_size: tokenizer.vocab_size(),
        context_length: 16,
        dim_word: 4,
    });
    let evaluator = EvaluatorNetwork::new(&config, &Device::flex());
    let both = evaluator.embed_text(&batch);
    let cut: Vec<_> = texts
        .iter()
        .map(|text| lamogen_model::Tokens {
            ids: text.ids[..5].to_vec(),
            ..text.clone()
        })
        .collect();
    let shorter = evaluator.embed_text(&TextBatch::tokens(&cut, &Device::flex()));
    assert_near(shorter, both.into_data());
}

#[test]
fn folders_keep_every_bit() {
    let device = Device::flex();
    let evaluator = EvaluatorNetwork::new(&token_config(), &device);
    let save = |evaluator: &EvaluatorNetwork| {
        let folder = tempfile::tempdir().unwrap();
        let licence = HashMap::from([("license".to_owned(), "CC0".to_owned())]);
        evaluator
            .save(folder.path(), Precision::F32, licence)
            .unwrap();
        let weights = std::fs::read(folder.path().join("model.safetensors")).unwrap();
        (folder, weights)
    };
    let (folder, weights) = save(&evaluator);
    let again = EvaluatorNetwork::from_folder(folder.path(), &device).unwrap();
    assert_eq!(again.config(), evaluator.config());
    assert_eq!(save(&again).1, weights);
    let path = folder.path().join("model.safetensors");
    let weights = Checkpoint::open_parts(path, &["text_encoder"]).unwrap();
    assert_eq!(weights.metadata("license"), Some("CC0"));

    let (features, lengths, texts) = pairs();
    let embed = |evaluator: &EvaluatorNetwork| {
        let motions = evaluator.embed_motion(features.clone(), &lengths, None);
        Tensor::cat(vec![motions, evaluator.embed_text(&texts)], 0)
    };
    assert_near(embed(&again), embed(&evaluator).into_data());
}

#[test]
fn a_network_saved_in_16_bits_gives_nearly_the_same_embeddings() {
    let (case, evaluator) = (GoldenCase::open(), golden_network());
    let folder = tempfile::tempdir().unwrap();
    evaluator
        .save(folder.path(), Precision::F16, HashMap::new())
        .unwrap();
    let half = EvaluatorNetwork::from_folder(folder.path(), &Device::flex()).unwrap();
    let expected = case.data("text_embeddings");
    let found = half.embed_text(&case.texts()).into_data();
    let tolerance = Tolerance::<f32>::rel_abs(0.01, 0.01);
    found.assert_approx_eq::<f32>(&expected, tolerance);
}

#[test]
fn files_of_other_networks_are_refused() {
    let device = Device::flex();
    let message = |result: Result<EvaluatorNetwork, _>| match result {
        Ok(_) => panic!("the file does not fit"),
        Err(error) => lamogen_eval::EvaluatorNetworkError::to_string(&error),
    };
    let wider = EvaluatorConfig {
        dim_coemb_hidden: 10,
        ..config()
    };
    let found = message(EvaluatorNetwork::load(
        golden("finest.tar"),
        &wider,
        &device,
    ));
    assert!(
        found
            .contains("output_net.3.weight` has shape [9, 12]; the model config asks for [10, 12]"),
        "{found}"
    );
    let found = message(EvaluatorNetwork::load(
        golden("finest.tar"),
        &token_config(),
        &device,
    ));
    assert!(found.contains("do not fit"), "{found}");
    let found = message(EvaluatorNetwork::load(
        golden("case.safetensors"),
        &config(),
        &device,
    ));
    assert!(
        found.contains("expected weights under the key `movement_encoder`"),
        "{found}"
    );
    let found = message(EvaluatorNetwork::load(
        golden("none.tar"),
        &config(),
        &device,
    ));
    assert!(found.contains("none.tar"), "{found}");
}

/// Trains the golden case's network on its pairs and returns the losses.
fn train(steps: usize, seed: u64) -> Vec<f32> {
    let (case, mut evaluator) = (GoldenCase::open(), golden_network().train());
    let (features, frames, texts) = (case.tensor("features"), case.counts("frames"), case.texts());
    let mut optimizer = AdamConfig::new().with_epsilon(1e-8).init();
    let mut stream = ChaCha12Rng::seed_from_u64(seed);
    let mut losses = Vec::new();
    for _ in 0..steps {
        let dropout = Dropout {
            probability: 0.2,
            stream: &mut stream,
        };
        let motions = evaluator.embed_motion(features.clone(), &frames, Some(dropout));
        let shift = random_shift(frames.len(), &mut stream);
        let loss = contrastive_loss(evaluator.embed_text(&texts), motions, shift, 10.0);
        losses.push(loss.clone().into_scalar());
        let gradients = GradientsParams::from_grads(loss.backward(), &evaluator);
        evaluator = optimizer.step(3e-3, evaluator, gradients);
    }
    losses
}

#[test]
fn training_brings_texts_to_their_motions_and_can_be_repeated() {
    let losses = train(80, 1);
    let (first, last) = (losses[0], losses[70..].iter().sum::<f32>() / 10.0);
    assert!(last < 0.5 * first, "{first} to {last}");
    assert_eq!(losses[..5], train(5, 1));
    assert_ne!(losses[..5], train(5, 2));
}

#[test]
fn a_network_read_from_a_file_can_be_trained_on() {
    let folder = tempfile::tempdir().unwrap();
    EvaluatorNetwork::new(&token_config(), &Device::flex())
        .save(folder.path(), Precision::F32, HashMap::new())
        .unwrap();
    let (features, lengths, texts) = pairs();
    let plain = EvaluatorNetwork::from_folder(folder.path(), &Device::flex())
        .unwrap()
        .train();
    let on_tape = EvaluatorNetwork::from_folder(folder.path(), &Device::flex().autodiff()).unwrap();
    for evaluator in [plain, on_tape] {
        let motions = evaluator.embed_motion(features.clone(), &lengths, None);
        let loss = contrastive_loss(evaluator.embed_text(&texts), motions, 1, 10.0);
        let gradients = GradientsParams::from_grads(loss.backward(), &evaluator);
        assert_eq!(gradients.len(), 6 + 2 * (2 + 1 + 8 + 6) + 1);
    }
}
