//! Tests of conditioning on Laban features, and of the similarities of sentences that the text encoder also learns.

use burn::module::{Module, ModuleVisitor, Param};
use burn::optim::GradientsParams;
use burn::tensor::{Device, Int, Tensor, TensorData};
use lamogen_model::{
    Checkpoint, Denoiser, FrameMask, LabanCondition, ModelConfig, MotionDiffuse, Precision,
    SentenceSimilarity, TrainableDenoiser, TrainingBatch,
};

const CONDITION: LabanCondition = LabanCondition {
    mean: [-4.0, -3.0, -4.0, -1.0],
    std: [1.0, 0.5, 0.5, 0.25],
};

fn config(laban_condition: Option<LabanCondition>) -> ModelConfig {
    let json = serde_json::json!({
        "input_feats": 7, "num_frames": 20, "latent_dim": 16, "ff_size": 16, "num_layers": 1, "num_heads": 2,
        "text_latent_dim": 12, "text_ff_size": 12, "text_num_heads": 2, "num_text_layers": 1,
        "clip": { "vocab_size": 30, "context_length": 6, "width": 8, "heads": 2, "layers": 1 },
        "prediction": "sample",
    });
    let config = ModelConfig::from_json(json.to_string().as_bytes(), "test").unwrap();
    ModelConfig {
        laban_condition,
        sampling: None,
        ..config
    }
}

fn tokens() -> Tensor<2, Int> {
    let ids: Vec<i32> = (0..18)
        .map(|i| if i % 6 == 5 { 29 } else { i * 5 % 28 })
        .collect();
    Tensor::from_data(TensorData::new(ids, [3, 6]), &Device::flex())
}

fn batch(
    laban: Option<Vec<[Option<f32>; 4]>>,
    sentences: Option<SentenceSimilarity>,
) -> TrainingBatch {
    let device = Device::flex();
    let numbers: Vec<f32> = (0..3 * 20 * 7).map(|i| (i as f32 * 0.7).sin()).collect();
    TrainingBatch {
        tokens: tokens(),
        captions: vec![0, 1, 2],
        is_without_text: vec![false; 3],
        x_t: Tensor::from_data(TensorData::new(numbers, [3, 20, 7]), &device),
        timesteps: vec![3, 400, 900],
        laban,
        sentences,
        mask: FrameMask::new(&[20, 12, 20], 20, &device),
    }
}

fn numbers<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor.try_into_vec_as().unwrap()
}

#[test]
fn features_are_normalised_logarithms_and_marks_of_what_is_told() {
    let encoded = CONDITION.encode(&[
        Some((-3.0f32).exp()),
        None,
        Some(0.0),
        Some((-1.0f32).exp()),
    ]);
    assert!((encoded[0] - 1.0).abs() < 1e-5);
    assert_eq!((encoded[1], encoded[2]), (0.0, -4.0));
    assert!(encoded[3].abs() < 1e-5);
    assert_eq!(encoded[4..], [1.0, 0.0, 1.0, 1.0]);
}

#[test]
fn a_fresh_network_is_as_if_nothing_was_told_and_others_are_not_told_anything() {
    let device = Device::flex();
    let means = vec![[Some(0.1); 4]; 3];
    let network = MotionDiffuse::initial(&config(Some(CONDITION)), 1, &device);
    assert!(
        numbers(network.embed_laban(&means).unwrap())
            .iter()
            .all(|n| *n == 0.0)
    );
    let without = MotionDiffuse::initial(&config(None), 1, &device);
    assert!(without.embed_laban(&means).is_none());
    // The weights that both networks have are initialised identically.
    let alike = |network: &MotionDiffuse| numbers(network.predict(batch(None, None)));
    assert_eq!(alike(&network), alike(&without));
}

#[test]
fn where_nothing_is_told_nothing_is_added() {
    let device = Device::flex();
    let network = MotionDiffuse::new(&config(Some(CONDITION)), &device);
    let added = network
        .embed_laban(&[[None; 4], [Some(0.1), None, None, None]])
        .unwrap();
    let added = numbers(added);
    let (first, second) = added.split_at(added.len() / 2);
    assert!(first.iter().all(|n| *n == 0.0) && second.iter().any(|n| *n != 0.0));
}

#[test]
fn a_saved_network_is_told_the_same() {
    let device = Device::flex();
    let config = config(Some(CONDITION));
    let network = MotionDiffuse::new(&config, &device);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.safetensors");
    network
        .save(&path, Precision::F32, Default::default())
        .unwrap();
    let loaded = Checkpoint::open(&path)
        .unwrap()
        .load(&config, &device)
        .unwrap();
    let added = |network: &MotionDiffuse| numbers(network.embed_laban(&[[Some(0.2); 4]]).unwrap());
    // The memory layout of the weights differs, so sums are rounded differently.
    for (found, expected) in added(&loaded).into_iter().zip(added(&network)) {
        assert!((found - expected).abs() < 1e-5, "{found} {expected}");
    }
}

/// Computes the Euclidean norm of the gradients of the parameters under a name.
fn gradient_norm(network: &MotionDiffuse, gradients: &GradientsParams, name: &str) -> f32 {
    struct GradientNorm<'g> {
        path: Vec<String>,
        name: &'g str,
        gradients: &'g GradientsParams,
        squared_norm: f32,
    }
    impl ModuleVisitor for GradientNorm<'_> {
        fn enter_module(&mut self, name: &str, _: &str) {
            self.path.push(name.to_owned());
        }
        fn exit_module(&mut self, _: &str, _: &str) {
            self.path.pop();
        }
        fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
            let gradient = self.gradients.get::<D>(param.id);
            if let (true, Some(gradient)) = (self.path[0] == self.name, gradient) {
                self.squared_norm += gradient.square().sum().into_scalar::<f32>();
            }
        }
    }
    let mut visitor = GradientNorm {
        path: Vec::new(),
        name,
        gradients,
        squared_norm: 0.0,
    };
    network.visit(&mut visitor);
    visitor.squared_norm.sqrt()
}

#[test]
fn features_have_gradients_where_they_are_told() {
    let network = MotionDiffuse::new(&config(Some(CONDITION)), &Device::flex());
    let network = network.train().set_require_grad(true);
    let gradient_norm_with = |laban| {
        let trained = network.gradients(batch(laban, None), |output| output.square().mean());
        gradient_norm(&network, &trained.gradients, "laban")
    };
    assert_eq!(gradient_norm_with(None), 0.0);
    assert_eq!(gradient_norm_with(Some(vec![[None; 4]; 3])), 0.0);
    assert!(gradient_norm_with(Some(vec![[Some(0.1); 4], [None; 4], [None; 4]])) > 0.0);
}

#[test]
fn the_text_encoder_comes_nearer_to_given_cosines() {
    let device = Device::flex();
    let mut network = MotionDiffuse::initial(&config(None), 2, &device);
    let cosines = [1.0f32, 0.9, 0.1, 0.9, 1.0, 0.2, 0.1, 0.2, 1.0];
    let similarity = SentenceSimilarity {
        tokens: tokens(),
        cosines: Tensor::from_data(TensorData::new(cosines.to_vec(), [3, 3]), &device),
        weight: 1.0,
    };
    let mut losses = Vec::new();
    let mut optimizer = burn::optim::AdamConfig::new().init();
    for _ in 0..60 {
        let tracked = network.train().set_require_grad(true);
        // The loss of the motions is zero.
        let batch = batch(None, Some(similarity.clone()));
        let trained = tracked.gradients(batch, |output| output.sum() * 0.0);
        losses.extend(numbers(trained.sentence_loss.unwrap()));
        network = optimizer.step(3e-3, tracked, trained.gradients).valid();
    }
    assert!(losses[59] < 0.1 * losses[0], "{} {}", losses[0], losses[59]);
}
