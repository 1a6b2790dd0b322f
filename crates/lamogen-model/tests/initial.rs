//! Tests of initial networks, before training.

use burn::module::{Module, ModuleVisitor, Param};
use burn::tensor::{Device, Int, Tensor, TensorData};
use lamogen_model::{
    ClipTextConfig, FrameMask, ModelConfig, MotionDiffuse, Prediction, TrainableDenoiser,
    TrainingBatch,
};

fn config() -> ModelConfig {
    ModelConfig {
        input_feats: 20,
        num_frames: 50,
        min_frames: None,
        latent_dim: 32,
        ff_size: 48,
        num_layers: 2,
        num_heads: 4,
        text_latent_dim: 16,
        text_ff_size: 24,
        text_num_heads: 2,
        num_text_layers: 1,
        clip: ClipTextConfig {
            vocab_size: 40,
            context_length: 6,
            width: 16,
            heads: 2,
            layers: 1,
        },
        prediction: Prediction::Sample,
        laban_condition: None,
        sampling: None,
    }
}

/// Collects the numbers of all parameters of a network with their paths.
#[derive(Default)]
struct ParameterCollector {
    path: Vec<String>,
    found: Vec<(String, Vec<f32>)>,
}

impl ModuleVisitor for ParameterCollector {
    fn enter_module(&mut self, name: &str, _: &str) {
        self.path.push(name.to_owned());
    }
    fn exit_module(&mut self, _: &str, _: &str) {
        self.path.pop();
    }
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let numbers = param.val().try_into_vec_as().unwrap();
        self.found.push((self.path.join("."), numbers));
    }
}

fn numbers(network: &MotionDiffuse) -> Vec<(String, Vec<f32>)> {
    let mut numbers = ParameterCollector::default();
    network.visit(&mut numbers);
    numbers.found
}

#[test]
fn a_seed_means_the_same_network_and_another_seed_another() {
    let [a, again, other] = [1, 1, 2].map(|seed| {
        let network = MotionDiffuse::initial(&config(), seed, &Device::flex());
        numbers(&network)
    });
    assert_eq!(a, again);
    assert_ne!(a, other);
    // Every weight is either drawn from the seed or a constant, so none keeps the value from burn's own generator.
    for ((path, a), (_, other)) in a.iter().zip(&other) {
        let is_drawn = a != other;
        let is_constant = a.iter().all(|x| x == &a[0]) && [0.0, 1.0].contains(&a[0]);
        assert!(
            is_drawn || is_constant || path == "frame_embedding",
            "{path}"
        );
    }
    // The expected value of the first weight is recorded in this test.
    let (path, first) = &a[0];
    assert_eq!(
        (path.as_str(), first[0]),
        ("text.clip.token_embedding.weight", PINNED)
    );
}

const PINNED: f32 = 0.033_272_542;

#[test]
fn at_first_the_network_says_zero_whatever_it_sees() {
    let network = MotionDiffuse::initial(&config(), 3, &Device::flex());
    let tokens = TensorData::new(vec![1, 2, 39, 0, 0, 0], [1, 6]);
    let x_t: Vec<f32> = (0..30 * 20).map(|i| (i as f32).sin()).collect();
    let output = network.predict(TrainingBatch {
        tokens: Tensor::<2, Int>::from_data(tokens, &Device::flex()),
        captions: vec![0],
        is_without_text: vec![false; 1],
        x_t: Tensor::from_data(TensorData::new(x_t, [1, 30, 20]), &Device::flex()),
        timesteps: vec![400],
        laban: None,
        sentences: None,
        mask: FrameMask::new(&[30], 30, &Device::flex()),
    });
    let output: Vec<f32> = output.try_into_vec_as().unwrap();
    assert!(output.iter().all(|x| *x == 0.0));
}

#[test]
fn further_layers_change_nothing_at_first_and_then_learn() {
    let device = Device::flex();
    // Not the initial network, whose output is zero.
    let shaken = burn::module::Module::map(
        MotionDiffuse::initial(&config(), 3, &device),
        &mut Shaken(0.0),
    );
    let batch = || {
        let tokens = TensorData::new(vec![1, 2, 39, 0, 0, 0], [1, 6]);
        let x_t: Vec<f32> = (0..30 * 20).map(|i| (i as f32).sin()).collect();
        TrainingBatch {
            tokens: Tensor::<2, Int>::from_data(tokens, &device),
            captions: vec![0],
            is_without_text: vec![false; 1],
            x_t: Tensor::from_data(TensorData::new(x_t, [1, 30, 20]), &device),
            timesteps: vec![400],
            laban: None,
            sentences: None,
            mask: FrameMask::new(&[30], 30, &device),
        }
    };
    let output = |network: &MotionDiffuse| -> Vec<f32> {
        network.predict(batch()).try_into_vec_as().unwrap()
    };
    let larger = shaken.clone().with_layers(5, 7);
    assert_eq!(larger.config().num_layers, 5);
    let before = output(&shaken);
    assert!(before.iter().any(|x| x.abs() > 1e-3));
    assert_eq!(before, output(&larger));
    assert_eq!(numbers(&shaken), numbers(&shaken.clone().with_layers(2, 7)));

    // It has the parameters of a network of five layers, and those that were there are what they were.
    let five = ModelConfig {
        num_layers: 5,
        ..config()
    };
    let paths = |network: &MotionDiffuse| -> Vec<(String, usize)> {
        let all = numbers(network).into_iter();
        all.map(|(path, values)| (path, values.len())).collect()
    };
    assert_eq!(
        paths(&larger),
        paths(&MotionDiffuse::initial(&five, 1, &device))
    );
    let own = numbers(&shaken);
    for (path, values) in numbers(&larger) {
        match own.iter().find(|(own, _)| *own == path) {
            Some((_, own)) if !path.starts_with("modulations") => {
                assert_eq!(own, &values, "{path}");
            }
            _ => {}
        }
    }
}

/// Adds small numbers to all weights.
struct Shaken(f32);

impl burn::module::ModuleMapper for Shaken {
    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        param.map(|tensor| {
            let shape: [usize; D] = tensor.dims();
            let count = shape.iter().product();
            let noise = (0..count).map(|_| {
                self.0 += 1.0;
                0.05 * self.0.sin()
            });
            let noise = TensorData::new(noise.collect::<Vec<f32>>(), shape);
            tensor.clone() + Tensor::from_data(noise, &tensor.device())
        })
    }
}

#[test]
fn neighbouring_frames_are_alike_and_all_frames_differ() {
    let network = MotionDiffuse::initial(&config(), 3, &Device::flex());
    let all = numbers(&network);
    let (_, sinusoids) = all
        .iter()
        .find(|(path, _)| path == "frame_embedding")
        .unwrap();
    let row = |frame: usize| &sinusoids[frame * 32..][..32];
    let similarity = |a: usize, b: usize| -> f32 {
        row(a).iter().zip(row(b)).map(|(a, b)| a * b).sum::<f32>() / 16.0
    };
    for frame in 0..49 {
        assert!((similarity(frame, frame) - 1.0).abs() < 1e-5);
        assert!(similarity(frame, frame + 1) > 0.5);
        for other in frame + 1..50 {
            assert!(similarity(frame, other) < 0.95, "{frame} {other}");
        }
    }
}
