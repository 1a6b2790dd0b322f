//! What a network is told: how strongly to follow the sentence, and the features to reach.

mod batches;
mod toy;

use batches::batch;
use burn::tensor::{Device, Int, Tensor};
use lamogen_guide::{ClassifierFree, Guidance, GuidanceVariable, GuideError, Sampler};
use lamogen_laban::{Goals, Scale};
use lamogen_model::{Denoiser, DenoiserInput, FrameMask};
use lamogen_motion::{FeatureGroup, POSE_FEATURES};
use toy::{Says, Toy, normalization};

/// Says its embedding at every number.
struct Tells;

impl Says for Tells {
    fn says(&self, input: DenoiserInput) -> Tensor<3> {
        let embedding = input.embedding.unsqueeze_dim::<3>(2);
        input.x_t * 0.0 + embedding.clone() * embedding
    }
}

fn input(network: &impl Denoiser, embedding: Tensor<2>) -> DenoiserInput {
    let device = Device::flex();
    DenoiserInput {
        x_t: Tensor::zeros([1, 4, POSE_FEATURES], &device),
        time: network.embed_timesteps(&[10]),
        embedding,
        modulation: None,
        mask: FrameMask::new(&[4], 4, &device),
    }
}

/// How far the root turns, and its height.
fn yaw_and_height(tensor: &Tensor<3>) -> [f32; 2] {
    let values = tensor.clone().try_into_vec_as::<f32>().unwrap();
    [FeatureGroup::RootYaw, FeatureGroup::RootHeight].map(|group| values[group.range().start])
}

#[test]
fn the_output_goes_beyond_what_is_said_to_nothing_by_the_scale() {
    let toy = Toy(Tells);
    // The embedding of a toy is its one token: 3 is told, and 1 where nothing is.
    let token = |id: i32| Tensor::<2, Int>::from_data([[id]], &Device::flex());
    for (scale, expected) in [
        (1.0, [9.0, 9.0]),
        (0.0, [1.0, 1.0]),
        // Turning is not exaggerated.
        (2.5, [9.0, 1.0 + 2.5 * 8.0]),
    ] {
        let network = ClassifierFree::new(&toy, scale, &[1]).unwrap();
        let prompt = network.encode(token(3));
        let input = input(&network, prompt.embedding.clone());
        let output = network.denoise(input.clone(), &prompt.context);
        assert_eq!(yaw_and_height(&output), expected);
        // The way back goes through what is told: the derivative of its square, at each of the numbers.
        let linearized = network.linearize(input, &prompt.context);
        assert_eq!(yaw_and_height(&linearized.output), expected);
        let gradient = linearized.pull(output.ones_like());
        let gradient = gradient.try_into_vec_as::<f32>().unwrap()[0];
        let scale = scale as f32;
        let numbers = 4.0 * (scale * (POSE_FEATURES - 1) as f32 + scale.min(1.0));
        assert!((gradient - 6.0 * numbers).abs() < 1.0, "{gradient}");
    }
}

#[test]
fn a_scale_that_is_none_is_refused() {
    for scale in [-1.0, f64::NAN, f64::INFINITY] {
        let refused = ClassifierFree::new(&Toy(Tells), scale, &[1]);
        let message = refused.err().expect("no scale").to_string();
        assert!(
            message.contains("text scale") && message.contains("found"),
            "{message}"
        );
    }
}

#[test]
fn a_network_that_cannot_be_told_features_says_so() {
    let (toy, normalization) = (Toy(Tells), normalization(0.3));
    let batch = batch(&[40], 40);
    let sampler = Sampler::new(&toy, &normalization, 3).unwrap();
    let baseline = sampler.baseline(&batch, &mut ()).unwrap();
    let goals: Goals = Scale::new([2.0, 1.0, 1.0, 1.0]).unwrap().into();
    let guidance = Guidance {
        variable: GuidanceVariable::Nothing,
        laban_condition: true,
        ..Guidance::fast()
    };
    let error = sampler.guided(
        &batch,
        baseline.clone(),
        std::slice::from_ref(&goals),
        &guidance,
        &mut (),
    );
    assert!(matches!(error, Err(GuideError::NoLabanCondition)));
    // Where nothing is moved and nothing told, the second pass is the first.
    let guidance = Guidance {
        laban_condition: false,
        ..guidance
    };
    let guided = sampler
        .guided(&batch, baseline.clone(), &[goals], &guidance, &mut ())
        .unwrap();
    assert_eq!(guided.motion.into_data(), baseline.into_data());
    assert_eq!(guided.loss.len(), 3);
}
