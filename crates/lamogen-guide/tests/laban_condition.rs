//! The conditions of a network: the sentence at a text scale, and the Laban features to reach.

mod batches;
mod toy;

use batches::batch;
use burn::tensor::{Device, Int, Tensor};
use lamogen_guide::{ClassifierFree, Guidance, GuidanceVariable, GuideError, Sampler, TextScale};
use lamogen_laban::{Goals, Scale};
use lamogen_model::{Denoiser, DenoiserInput, FrameMask, Tokens};
use lamogen_motion::{FeatureGroup, POSE_FEATURES};
use toy::{ToyDenoiser, ToyNetwork, normalization};

/// A network whose output is the square of the embedding in all features of all frames.
struct SquaredEmbeddingNetwork;

impl ToyNetwork for SquaredEmbeddingNetwork {
    fn output(&self, input: DenoiserInput) -> Tensor<3> {
        let embedding = input.embedding.unsqueeze_dim::<3>(2);
        input.x_t * 0.0 + embedding.clone() * embedding
    }
}

fn input(network: &impl Denoiser, embedding: Tensor<2>) -> DenoiserInput {
    let device = Device::flex();
    DenoiserInput {
        x_t: Tensor::zeros([1, 4, POSE_FEATURES], &device),
        timesteps: vec![10],
        time: network.embed_timesteps(&[10]),
        embedding,
        modulation: None,
        mask: FrameMask::new(&[4], 4, &device),
    }
}

/// Returns the yaw feature and the height feature of the root in the first frame.
fn yaw_and_height(tensor: &Tensor<3>) -> [f32; 2] {
    let values = tensor.clone().try_into_vec_as::<f32>().unwrap();
    [FeatureGroup::RootYaw, FeatureGroup::RootHeight].map(|group| values[group.range().start])
}

/// Returns a text without words.
fn wordless() -> Tokens {
    Tokens {
        ids: vec![1],
        length: 1,
        cut: 0,
        own: 0,
    }
}

#[test]
fn the_scale_extrapolates_from_the_unconditional_output() {
    let toy = ToyDenoiser(SquaredEmbeddingNetwork);
    // The embedding is the one token: 3 for the sentence, and 1 for the text without words.
    let token = |id: i32| Tensor::<2, Int>::from_data([[id]], &Device::flex());
    for (scale, expected) in [
        (1.0, [9.0, 9.0]),
        (0.0, [1.0, 1.0]),
        // The scale of the yaw is at most 1.
        (2.5, [9.0, 1.0 + 2.5 * 8.0]),
    ] {
        let network = ClassifierFree::new(&toy, scale, &wordless()).unwrap();
        let prompt = network.encode(&token(3).into());
        let input = input(&network, prompt.embedding.clone());
        let output = network.denoise(input.clone(), &prompt.context);
        assert_eq!(yaw_and_height(&output), expected);
        // The gradient goes through the conditional output: it is the sum of the derivatives of the squared embedding.
        let linearized = network.linearize(input.clone(), &prompt.context);
        assert_eq!(yaw_and_height(&linearized.output), expected);
        // With another embedding, the unconditional output that was kept is that of the same evaluation.
        let moved = DenoiserInput {
            embedding: input.embedding + 2.0,
            ..input
        };
        let kept = linearized.unconditional.clone();
        assert_eq!(kept.is_some(), scale != 1.0);
        let again = |kept| network.denoise_again(moved.clone(), &prompt.context, kept);
        let whole = yaw_and_height(&network.denoise(moved.clone(), &prompt.context));
        assert_eq!(yaw_and_height(&again(kept.clone())), whole);
        if let Some(kept) = kept {
            // Here it is 0 instead of 1, and nothing computes it anew.
            let height = yaw_and_height(&again(Some(kept.zeros_like())))[1];
            assert_eq!(height, 25.0 * scale as f32);
        }
        let gradient = linearized.pull(output.ones_like());
        let gradient = gradient.try_into_vec_as::<f32>().unwrap()[0];
        let scale = scale as f32;
        let numbers = 4.0 * (scale * (POSE_FEATURES - 1) as f32 + scale.min(1.0));
        assert!((gradient - 6.0 * numbers).abs() < 1.0, "{gradient}");
    }
}

#[test]
fn predictions_below_the_smallest_timestep_are_not_scaled() {
    let toy = ToyDenoiser(SquaredEmbeddingNetwork);
    let token = Tensor::<2, Int>::from_data([[3]], &Device::flex());
    let evaluate = |text_scale, timesteps: Vec<usize>| {
        let network = ClassifierFree::new(&toy, text_scale, &wordless()).unwrap();
        let prompt = network.encode(&token.clone().into());
        let rows = timesteps.len();
        let input = DenoiserInput {
            x_t: Tensor::zeros([rows, 4, POSE_FEATURES], &Device::flex()),
            time: network.embed_timesteps(&timesteps),
            timesteps,
            embedding: prompt.embedding.clone().repeat_dim(0, rows),
            modulation: None,
            mask: FrameMask::new(&vec![4; rows], 4, &Device::flex()),
        };
        let linearized = network.linearize(input.clone(), &prompt.context);
        let output = network.denoise(input.clone(), &prompt.context);
        let kept = linearized.unconditional.clone();
        let again = network.denoise_again(input, &prompt.context, kept.clone());
        let outputs = [output.clone(), linearized.output.clone(), again];
        let gradient = linearized.pull(output.ones_like());
        let gradient = gradient.sum().into_scalar::<f32>();
        let heights = outputs.map(|output| {
            let height = FeatureGroup::RootHeight.range().start;
            let heights = output.narrow(1, 0, 1).narrow(2, height, 1);
            heights.try_into_vec_as::<f32>().unwrap()
        });
        assert_eq!(heights[0], heights[1]);
        assert_eq!(heights[0], heights[2]);
        (heights[0].clone(), kept.is_some(), gradient)
    };
    let at_all = |timestep| evaluate(TextScale::from(2.5), vec![timestep]);
    let until_600 = |timesteps| {
        evaluate(
            TextScale {
                scale: 2.5,
                until: 600,
            },
            timesteps,
        )
    };
    for timestep in [600, 999] {
        assert_eq!(until_600(vec![timestep]), at_all(timestep));
    }
    let plain = evaluate(TextScale::default(), vec![599]);
    assert_eq!(until_600(vec![599]), plain);
    assert_eq!((plain.0, plain.1), (vec![9.0], false));
    // The rows of a batch may be at different timesteps.
    let (heights, ..) = until_600(vec![599, 600]);
    assert_eq!(heights, [9.0, 21.0]);
}

#[test]
fn an_invalid_scale_is_refused() {
    let toy = ToyDenoiser(SquaredEmbeddingNetwork);
    let scales = [-1.0, f64::NAN, f64::INFINITY].map(TextScale::from);
    let never = TextScale {
        scale: 2.0,
        until: 1000,
    };
    for text_scale in scales.into_iter().chain([never]) {
        let result = ClassifierFree::new(&toy, text_scale, &wordless());
        let message = result.err().expect("an error").to_string();
        assert!(
            message.contains("text scale") && message.contains("found"),
            "{message}"
        );
    }
}

#[test]
fn the_laban_condition_of_a_network_without_one_is_refused() {
    let (toy, normalization) = (ToyDenoiser(SquaredEmbeddingNetwork), normalization(0.3));
    let batch = batch(&[40], 40);
    let sampler = Sampler::new(&toy, &normalization, 3).unwrap();
    let baseline = sampler.baseline(&batch, &mut ()).unwrap();
    let goals: Goals = Scale::new([2.0, 1.0, 1.0, 1.0]).unwrap().into();
    let guidance = Guidance {
        variable: GuidanceVariable::None,
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
    // Without a variable and without the condition, the second pass gives the motions of the first.
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
