//! The CPU's kernels against the same network in tensor operations.

use burn::tensor::{Device, Int, Tensor, TensorData};
use lamogen_model::{
    Checkpoint, ClipTextConfig, Denoiser, DenoiserInput, FrameMask, Linearized, ModelConfig,
    MotionDiffuse, Precision, Prediction, Prompt,
};

const LENGTHS: [usize; 4] = [61, 1, 130, 50];
const FRAMES: usize = 130;

fn config() -> ModelConfig {
    ModelConfig {
        input_feats: 37,
        num_frames: 140,
        min_frames: None,
        latent_dim: 48,
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
    }
}

fn numbers<const D: usize>(shape: [usize; D], seed: f32) -> Tensor<D> {
    let count = shape.iter().product::<usize>();
    let numbers: Vec<f32> = (0..count).map(|i| (i as f32 * seed).sin()).collect();
    Tensor::from_data(TensorData::new(numbers, shape), &Device::flex())
}

fn input(model: &MotionDiffuse) -> (DenoiserInput, Prompt<<MotionDiffuse as Denoiser>::Context>) {
    let device = Device::flex();
    let tokens: Vec<i32> = (0..4 * 8)
        .map(|i| if i % 8 == 7 { 49 } else { i * 5 % 48 })
        .collect();
    let tokens = Tensor::<2, Int>::from_data(TensorData::new(tokens, [4, 8]), &device);
    let prompt = model.encode(tokens);
    let input = DenoiserInput {
        x_t: numbers([4, FRAMES, 37], 0.731),
        time: model.embed_timesteps(&[321]),
        embedding: prompt.embedding.clone(),
        mask: FrameMask::new(&LENGTHS, FRAMES, &device),
    };
    (input, prompt)
}

/// Output and gradient of an evaluation, where frames belong to a motion.
fn both(linearized: Linearized<'_>, mask: &FrameMask) -> (Vec<f32>, Vec<f32>) {
    let keep = mask.keep().unwrap();
    let output = linearized.output.clone() * keep.clone();
    let gradient = linearized.pull(numbers([4, FRAMES, 37], 0.377) * keep);
    (host(output), host(gradient))
}

fn host<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor.try_into_vec_as().unwrap()
}

/// The largest difference, relative to the largest number.
fn distance(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len());
    let largest = b.iter().fold(0.0f32, |largest, x| largest.max(x.abs()));
    assert!(largest > 1e-3, "nothing to compare");
    let differences = a.iter().zip(b).map(|(a, b)| (a - b).abs());
    differences.fold(0.0, f32::max) / largest
}

#[test]
fn kernels_are_the_network_and_its_gradient() {
    let fresh = MotionDiffuse::new(&config(), &Device::flex());
    // Weights that were read lie the other way around in memory.
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.safetensors");
    fresh
        .save(&path, Precision::F32, Default::default())
        .unwrap();
    let read = Checkpoint::open(&path)
        .unwrap()
        .load(&config(), &Device::flex())
        .unwrap();
    for model in [fresh, read] {
        let (input, prompt) = input(&model);
        let context = &prompt.context;
        let kernels = both(model.linearize(input.clone(), context), &input.mask);
        // Under autodiff the network runs in tensor operations.
        let tensors = Linearized::by_autodiff(input.clone(), |input| model.denoise(input, context));
        let tensors = both(tensors, &input.mask);
        let (output, gradient) = (
            distance(&kernels.0, &tensors.0),
            distance(&kernels.1, &tensors.1),
        );
        assert!(output < 1e-5 && gradient < 1e-5, "{output} {gradient}");
        let alone = model.denoise(input.clone(), context) * input.mask.keep().unwrap();
        assert_eq!(host(alone), kernels.0, "with and without a record");
    }
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let model = MotionDiffuse::new(&config(), &Device::flex());
    let (input, prompt) = input(&model);
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        let pool = pool.build().unwrap();
        pool.install(|| both(model.linearize(input.clone(), &prompt.context), &input.mask))
    };
    let one = run(1);
    for threads in [2, 3, 8] {
        assert!(run(threads) == one, "{threads} threads differ from one");
    }
}
