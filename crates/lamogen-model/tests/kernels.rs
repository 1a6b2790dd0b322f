//! Tests of the CPU's kernels against the same network in tensor operations.

mod gradients;

use burn::module::{Module, ModuleMapper, Param};
use burn::optim::GradientsParams;
use burn::tensor::{Device, Int, Tensor, TensorData};
use lamogen_model::{
    Checkpoint, ClipTextConfig, Denoiser, DenoiserInput, FrameMask, LinearizedEvaluation,
    ModelConfig, MotionDiffuse, Precision, Prediction, Prompt, TrainableDenoiser, TrainingBatch,
};
use safetensors::SafeTensors;
use safetensors::tensor::{Dtype, TensorView};

use gradients::by_path;

const LENGTHS: [usize; 4] = [61, 1, 130, 50];
const FRAMES: usize = 130;

fn config() -> ModelConfig {
    ModelConfig {
        input_feats: 37,
        num_frames: 140,
        min_frames: None,
        latent_dim: 40,
        ff_size: 80,
        num_layers: 3,
        num_heads: 4,
        text_latent_dim: 32,
        text_ff_size: 40,
        text_num_heads: 2,
        num_text_layers: 1,
        clip: ClipTextConfig {
            vocab_size: 50,
            context_length: 8,
            width: 24,
            heads: 2,
            layers: 1,
        },
        prediction: Prediction::Epsilon,
        laban_condition: None,
        sampling: None,
    }
}

fn numbers<const D: usize>(shape: [usize; D], seed: f32) -> Tensor<D> {
    let count = shape.iter().product::<usize>();
    let numbers: Vec<f32> = (0..count).map(|i| (i as f32 * seed).sin()).collect();
    Tensor::from_data(TensorData::new(numbers, shape), &Device::flex())
}

fn tokens() -> Tensor<2, Int> {
    let tokens: Vec<i32> = (0..4 * 8)
        .map(|i| if i % 8 == 7 { 49 } else { i * 5 % 48 })
        .collect();
    Tensor::from_data(TensorData::new(tokens, [4, 8]), &Device::flex())
}

fn input(model: &MotionDiffuse) -> (DenoiserInput, Prompt<<MotionDiffuse as Denoiser>::Context>) {
    let device = Device::flex();
    let prompt = model.encode(&tokens().into());
    let input = DenoiserInput {
        x_t: numbers([4, FRAMES, 37], 0.731),
        timesteps: vec![321],
        time: model.embed_timesteps(&[321]),
        embedding: prompt.embedding.clone(),
        modulation: None,
        mask: FrameMask::new(&LENGTHS, FRAMES, &device),
    };
    (input, prompt)
}

/// Returns the output and the gradient of an evaluation, masked to the frames that belong to a motion.
fn output_and_gradient<const D: usize>(
    linearized: LinearizedEvaluation<'_, D>,
    mask: &FrameMask,
) -> (Vec<f32>, Vec<f32>) {
    let keep = mask.keep().unwrap();
    let output = linearized.output.clone() * keep.clone();
    let gradient = linearized.pull(numbers([4, FRAMES, 37], 0.377) * keep);
    (to_vec(output), to_vec(gradient))
}

fn to_vec<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor.try_into_vec_as().unwrap()
}

/// Computes the largest difference, relative to the largest number.
fn distance(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len());
    let largest = b.iter().fold(0.0f32, |largest, x| largest.max(x.abs()));
    assert!(largest > 1e-3, "nothing to compare");
    assert!(a.iter().chain(b).all(|x| x.is_finite()), "not finite");
    let differences = a.iter().zip(b).map(|(a, b)| (a - b).abs());
    differences.fold(0.0, f32::max) / largest
}

/// Creates a network with weights like those after training: no scale is 1 and no shift is 0. The weights are read from a
/// file, so they are transposed in memory compared with new ones.
fn trained() -> MotionDiffuse {
    let folder = tempfile::tempdir().unwrap();
    let (fresh, trained) = (
        folder.path().join("fresh.safetensors"),
        folder.path().join("trained.safetensors"),
    );
    let model = MotionDiffuse::new(&config(), &Device::flex());
    model
        .save(&fresh, Precision::F32, Default::default())
        .unwrap();
    let bytes = std::fs::read(fresh).unwrap();
    let tensors = SafeTensors::deserialize(&bytes).unwrap();
    let numbers: Vec<(String, Vec<usize>, Vec<u8>)> = tensors
        .iter()
        .map(|(key, view)| {
            let shape = view.shape().to_vec();
            let is_scale = shape.len() == 1 && key.ends_with("weight");
            let (middle, size) = match &shape[..] {
                [_, inputs] => (0.0, 1.5 / (*inputs as f32).sqrt()),
                _ if is_scale => (1.0, 0.4),
                _ => (0.0, 0.4),
            };
            let seed = 0.37 + key.len() as f32 * 0.11;
            let count = shape.iter().product::<usize>();
            let number = |i: usize| middle + size * (i as f32 * seed).sin();
            let bytes = (0..count).flat_map(|i| number(i).to_le_bytes()).collect();
            (key.to_owned(), shape, bytes)
        })
        .collect();
    let views = numbers.iter().map(|(key, shape, bytes)| {
        let view = TensorView::new(Dtype::F32, shape.clone(), bytes).unwrap();
        (key, view)
    });
    safetensors::serialize_to_file(views, None, &trained).unwrap();
    let checkpoint = Checkpoint::open(trained).unwrap();
    checkpoint.load(&config(), &Device::flex()).unwrap()
}

/// Multiplies all weights by a number.
struct Scaling(f32);

impl ModuleMapper for Scaling {
    fn map_float<const D: usize>(&mut self, weight: Param<Tensor<D>>) -> Param<Tensor<D>> {
        weight.map(|weight| weight * self.0)
    }
}

#[test]
fn kept_modulations_are_those_of_the_weights_and_the_condition() {
    let model = trained();
    let (input, prompt) = input(&model);
    let at = |model: &MotionDiffuse, timestep| {
        let input = DenoiserInput {
            timesteps: vec![timestep],
            time: model.embed_timesteps(&[timestep]),
            ..input.clone()
        };
        to_vec(model.denoise(input.clone(), &prompt.context) * input.mask.keep().unwrap())
    };
    // A copy begins without any.
    let expected = [321, 5].map(|timestep| at(&model.clone(), timestep));
    assert_ne!(expected[0], expected[1]);
    for _ in 0..2 {
        assert_eq!([321, 5].map(|timestep| at(&model, timestep)), expected);
    }
    let scaled = model.map(&mut Scaling(1.5));
    let [found, alone] = [at(&scaled, 5), at(&scaled.clone(), 5)];
    assert_eq!(found, alone);
    assert_ne!(found, expected[1]);
}

#[test]
fn kernels_are_the_network_and_its_gradient() {
    let fresh = MotionDiffuse::new(&config(), &Device::flex());
    for model in [fresh, trained()] {
        let (input, prompt) = input(&model);
        let context = &prompt.context;
        let kernels = output_and_gradient(model.linearize(input.clone(), context), &input.mask);
        // Under autodiff the network runs in tensor operations.
        let tensors =
            LinearizedEvaluation::by_autodiff(input.clone(), |input| model.denoise(input, context));
        let tensors = output_and_gradient(tensors, &input.mask);
        let (output, gradient) = (
            distance(&kernels.0, &tensors.0),
            distance(&kernels.1, &tensors.1),
        );
        assert!(output < 1e-5 && gradient < 1e-5, "{output} {gradient}");
        let kernels_to_motion = model.linearize_motion(input.clone(), context);
        let to_motion = output_and_gradient(kernels_to_motion, &input.mask);
        let tensors = LinearizedEvaluation::of_motion_by_autodiff(input.clone(), |input| {
            model.denoise(input, context)
        });
        let gradient = distance(&to_motion.1, &output_and_gradient(tensors, &input.mask).1);
        assert!(gradient < 1e-5, "of the noisy motion: {gradient}");
        assert_eq!(to_motion.0, kernels.0, "with one record and the other");
        let alone = model.denoise(input.clone(), context) * input.mask.keep().unwrap();
        assert_eq!(to_vec(alone), kernels.0, "with and without a record");
    }
}

#[test]
fn kernels_know_the_gradient_of_scales_and_shifts() {
    let model = trained();
    let (plain, prompt) = input(&model);
    let context = &prompt.context;
    let with = |modulation| DenoiserInput {
        modulation: Some(modulation),
        ..plain.clone()
    };
    let unmoved = with(Tensor::zeros(
        [4, model.modulation_width()],
        &Device::flex(),
    ));
    let [unmoved, nothing] = [unmoved, plain.clone()].map(|input| model.denoise(input, context));
    assert_eq!(to_vec(unmoved), to_vec(nothing.clone()));

    let moved = with(numbers([4, model.modulation_width()], 0.217) * 0.5);
    let kernels = output_and_gradient(model.linearize(moved.clone(), context), &moved.mask);
    let evaluate = |input| model.denoise(input, context);
    let tensors = LinearizedEvaluation::by_autodiff(moved.clone(), evaluate);
    let tensors = output_and_gradient(tensors, &moved.mask);
    let (output, gradient) = (
        distance(&kernels.0, &tensors.0),
        distance(&kernels.1, &tensors.1),
    );
    assert!(output < 1e-5 && gradient < 1e-5, "{output} {gradient}");
    let nothing = nothing * plain.mask.keep().unwrap();
    assert!(distance(&kernels.0, &to_vec(nothing)) > 1e-3);
}

#[test]
#[should_panic(expected = "must be of as many motions and frames")]
fn a_mask_of_other_frames_is_no_silent_misreading() {
    let model = MotionDiffuse::new(&config(), &Device::flex());
    let (mut input, prompt) = input(&model);
    input.mask = FrameMask::new(&[100; 4], 100, &Device::flex());
    model.denoise(input, &prompt.context);
}

#[test]
#[should_panic(expected = "expected motions of 1 to 140 frames, found 150")]
fn more_frames_than_the_network_knows_are_no_silent_misreading() {
    let model = MotionDiffuse::new(&config(), &Device::flex());
    let (mut input, prompt) = input(&model);
    input.x_t = numbers([4, 150, 37], 0.731);
    input.mask = FrameMask::new(&[150; 4], 150, &Device::flex());
    model.denoise(input, &prompt.context);
}

#[test]
#[should_panic(expected = "the gradient must have the shape of the output")]
fn a_gradient_of_another_shape_is_no_silent_misreading() {
    let model = MotionDiffuse::new(&config(), &Device::flex());
    let (input, prompt) = input(&model);
    let linearized = model.linearize(input, &prompt.context);
    linearized.pull(numbers([4, FRAMES - 1, 37], 0.377));
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let model = trained();
    let (input, prompt) = input(&model);
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        let pool = pool.build().unwrap();
        pool.install(|| {
            output_and_gradient(model.linearize(input.clone(), &prompt.context), &input.mask)
        })
    };
    let one = run(1);
    for threads in [2, 3, 8] {
        assert!(run(threads) == one, "{threads} threads differ from one");
    }
}

/// Creates a batch for training.
fn batch() -> TrainingBatch {
    let (input, _) = input(&MotionDiffuse::new(&config(), &Device::flex()));
    TrainingBatch {
        tokens: tokens(),
        captions: vec![0, 1, 2, 3],
        is_without_text: vec![false; 4],
        x_t: input.x_t,
        timesteps: vec![321, 0, 999, 5],
        laban: None,
        sentences: None,
        mask: input.mask,
    }
}

/// Computes a loss over the frames that belong to a motion.
fn loss(output: Tensor<3>, mask: &FrameMask) -> Tensor<1> {
    let target = numbers([4, FRAMES, 37], 0.377);
    ((output - target).square() * mask.keep().unwrap()).sum() / 1000.0
}

#[test]
fn gradients_of_all_weights_are_those_of_autodiff() {
    for model in [trained(), MotionDiffuse::new(&config(), &Device::flex())] {
        let model = model.train().set_require_grad(true);
        let batch = batch();
        let mask = batch.mask.clone();
        let found = model.gradients(batch.clone(), |output| loss(output, &mask));

        // A tracked network runs in tensor operations.
        let prompt = model.encode(&batch.tokens.autodiff().into());
        let input = DenoiserInput {
            x_t: batch.x_t,
            time: model.embed_timesteps(&batch.timesteps),
            timesteps: batch.timesteps,
            embedding: prompt.embedding,
            modulation: None,
            mask: batch.mask,
        };
        let expected = loss(model.denoise(input, &prompt.context), &mask);
        let expected_gradients = GradientsParams::from_grads(expected.clone().backward(), &model);

        let (found_loss, expected) = (to_vec(found.loss), to_vec(expected.inner()));
        assert!((found_loss[0] / expected[0] - 1.0).abs() < 1e-5);
        let found = by_path(&model, found.gradients);
        let expected = by_path(&model, expected_gradients);
        assert!(found.len() > 100 && found.len() == expected.len());
        let size = |x: &[f32]| x.iter().fold(0.0f32, |largest, x| largest.max(x.abs()));
        let largest = expected.values().map(|x| size(x)).fold(0.0, f32::max);
        for (path, expected) in &expected {
            // The true gradient of a bias of keys is zero, because a softmax is invariant to it. Only rounding errors remain.
            let limit = 1e-4 * size(expected) + 1e-6 * largest;
            let differences = found[path].iter().zip(expected).map(|(a, b)| (a - b).abs());
            let distance = differences.fold(0.0, f32::max);
            assert!(distance < limit, "{path}: {distance} above {limit}");
        }
    }
}

#[test]
fn gradients_do_not_depend_on_the_number_of_threads() {
    let model = trained().train().set_require_grad(true);
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        let batch = batch();
        let mask = batch.mask.clone();
        let gradients = pool.build().unwrap().install(|| {
            model
                .gradients(batch, |output| loss(output, &mask))
                .gradients
        });
        by_path(&model, gradients)
    };
    let one = run(1);
    for threads in [2, 5] {
        for (path, gradient) in run(threads) {
            assert!(
                gradient == one[&path],
                "{path}: {threads} threads differ from one"
            );
        }
    }
}

#[test]
fn motions_may_share_captions() {
    let model = trained().train().set_require_grad(true);
    let apart = batch();
    let mask = apart.mask.clone();
    let rows = [2, 0, 2, 2];
    let mut repeated = apart.clone();
    repeated.tokens = Tensor::cat(rows.map(|row| tokens().narrow(0, row, 1)).to_vec(), 0);
    let mut shared = apart;
    shared.tokens = Tensor::cat([2, 0].map(|row| tokens().narrow(0, row, 1)).to_vec(), 0);
    shared.captions = vec![0, 1, 0, 0];
    let gradients = [repeated, shared].map(|batch| {
        let trained = model.gradients(batch, |output| loss(output, &mask));
        by_path(&model, trained.gradients)
    });
    let [repeated, shared] = &gradients;
    for (path, repeated) in repeated {
        let largest = repeated
            .iter()
            .fold(1e-2f32, |largest, x| largest.max(x.abs()));
        for (a, b) in repeated.iter().zip(&shared[path]) {
            assert!((a - b).abs() < 1e-5 * largest, "{path}: {a} {b}");
        }
    }
}
