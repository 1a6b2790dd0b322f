//! The gradients of MDM's weights, by the CPU's kernels and by autodiff.

mod gradients;

use burn::module::Module;
use burn::optim::GradientsParams;
use burn::tensor::{Device, Int, Tensor, TensorData};
use lamogen_model::{
    ClipTextConfig, Denoiser, DenoiserInput, FrameMask, Mdm, MdmArchitecture, MdmConfig, MdmText,
    MdmTextConfig, TrainableDenoiser, TrainingBatch, initialize,
};

use gradients::by_path;

const FEATURES: usize = 7;
/// Motions of one chunk and of several, one of them padded.
const LENGTHS: [usize; 3] = [60, 41, 9];

/// Returns a network whose weights are all random, so that each has a gradient.
fn network(arch: MdmArchitecture) -> Mdm {
    let device = Device::flex();
    let config = MdmConfig {
        arch,
        features: FEATURES,
        latent_dim: 16,
        ff_size: 24,
        layers: 2,
        text_width: 64,
        ..MdmConfig::default()
    };
    let text = MdmTextConfig::Clip {
        tower: ClipTextConfig {
            vocab_size: 30,
            context_length: 8,
            width: 64,
            heads: 1,
            layers: 1,
        },
        output: 64,
    };
    let network = Mdm::new(&config, MdmText::new(&text, &device), &device);
    let network = initialize(network, 5, |_, shape, draw| {
        draw.uniform(0.3, shape.iter().product())
    });
    network.train().set_require_grad(true)
}

fn batch() -> TrainingBatch {
    let (device, frames) = (Device::flex(), LENGTHS[0]);
    let numbers = (0..3 * frames * FEATURES).map(|i| (i as f32 * 0.7).sin());
    let numbers = TensorData::new(numbers.collect::<Vec<f32>>(), [3, frames, FEATURES]);
    let ids = [1, 5, 3, 29, 0, 0, 1, 7, 2, 9, 4, 29];
    TrainingBatch {
        tokens: Tensor::<2, Int>::from_data(TensorData::new(ids.to_vec(), [2, 6]), &device),
        captions: vec![1, 0, 1],
        is_without_text: vec![false, false, true],
        x_t: Tensor::from_data(numbers, &device),
        timesteps: vec![3, 40, 17],
        mask: FrameMask::new(&LENGTHS, frames, &device),
        laban: None,
        sentences: None,
    }
}

/// A loss that weighs every number of the output differently, without the padding.
fn loss(output: Tensor<3>) -> Tensor<1> {
    let mask = batch().mask.keep().expect("a padded batch");
    let [motions, frames, features] = output.dims();
    let weights = (0..motions * frames * features).map(|i| (i as f32 * 0.3).cos());
    let weights = TensorData::new(weights.collect::<Vec<f32>>(), [motions, frames, features]);
    let weights = Tensor::<3>::from_data(weights, &Device::flex());
    ((output.clone() * weights + output.square()) * mask).sum()
}

#[test]
fn gradients_of_all_weights_are_those_of_autodiff() {
    for arch in [MdmArchitecture::Encoder, MdmArchitecture::Decoder] {
        let network = network(arch);
        let found = network.gradients(batch(), loss);
        let TrainingBatch {
            tokens,
            captions,
            x_t,
            timesteps,
            mask,
            ..
        } = batch();
        // A tracked network runs in tensor operations. The text that is left out is encoded apart.
        let prompts = network.encode(&tokens.autodiff().into());
        let rows: Vec<i32> = captions.iter().map(|&caption| caption as i32).collect();
        let rows = Tensor::<1, Int>::from_data(&rows[..], &Device::flex());
        let with = prompts.embedding.clone().select(0, rows).narrow(0, 0, 2);
        let without = network.unconditional(&prompts, &batch().tokens.into());
        let embedding = Tensor::cat(vec![with, without.embedding.narrow(0, 0, 1)], 0);
        let input = DenoiserInput {
            x_t,
            time: network.embed_timesteps(&timesteps),
            timesteps,
            embedding,
            modulation: None,
            mask,
        };
        let expected = loss(network.denoise(input, &prompts.context));
        let gradients = GradientsParams::from_grads(expected.clone().backward(), &network);

        let number = |x: Tensor<1>| x.into_scalar::<f32>();
        let (found_loss, expected) = (number(found.loss), number(expected.inner()));
        assert!((found_loss / expected - 1.0).abs() < 1e-5, "{arch:?}");
        let found = by_path(&network, found.gradients);
        let expected = by_path(&network, gradients);
        assert!(found.len() > 40 && found.len() == expected.len());
        let size = |x: &[f32]| x.iter().fold(0.0f32, |largest, x| largest.max(x.abs()));
        let largest = expected.values().map(|x| size(x)).fold(0.0, f32::max);
        for (path, expected) in &expected {
            // The true gradient of a bias of keys is zero, because a softmax is invariant to it.
            let limit = 1e-4 * size(expected) + 1e-6 * largest;
            let differences = found[path].iter().zip(expected).map(|(a, b)| (a - b).abs());
            let distance = differences.fold(0.0, f32::max);
            assert!(
                distance < limit,
                "{arch:?} {path}: {distance} above {limit}"
            );
        }
    }
}

#[test]
fn gradients_do_not_depend_on_the_number_of_threads() {
    for arch in [MdmArchitecture::Encoder, MdmArchitecture::Decoder] {
        let network = network(arch);
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
            let compute = || network.gradients(batch(), loss).gradients;
            by_path(&network, pool.build().unwrap().install(compute))
        };
        let one = run(1);
        for threads in [2, 5] {
            assert!(run(threads) == one, "{arch:?}: {threads} threads");
        }
    }
}

#[test]
fn a_text_that_is_left_out_has_no_influence() {
    let network = network(MdmArchitecture::Encoder);
    let output = |captions: Vec<usize>| {
        let output = network.valid().predict(TrainingBatch {
            captions,
            ..batch()
        });
        let motions: [Tensor<3>; 3] = output.split(1, 0).try_into().unwrap();
        motions.map(|motion| motion.try_into_vec_as::<f32>().unwrap())
    };
    let (one, other) = (output(vec![1, 0, 1]), output(vec![1, 1, 0]));
    assert_eq!((&one[0], &one[2]), (&other[0], &other[2]));
    assert_ne!(one[1], other[1]);
}
