//! Temporal smoothing of a network that predicts each frame for itself.

mod batches;
mod toy;

use batches::batch;
use burn::tensor::Tensor;
use lamogen_guide::{Guidance, Sampler, TemporalSmoothing};
use lamogen_laban::Scale;
use lamogen_model::DenoiserInput;
use toy::{ToyDenoiser, ToyNetwork, normalization};

/// A network that predicts one of two poses in each frame, the one nearer to the noisy frame. It ignores the other
/// frames, as a small network does when it predicts the legs of a walk.
struct FrameLocalNetwork;

impl ToyNetwork for FrameLocalNetwork {
    fn output(&self, input: DenoiserInput) -> Tensor<3> {
        // The mean over the features of a frame decides which pose is nearer.
        let side = (input.x_t.clone().mean_dim(2) * 20.0).tanh() * 0.3;
        side * input.embedding.unsqueeze_dim::<3>(2) + input.x_t.zeros_like()
    }
}

/// Returns how often neighbouring frames have different poses.
fn changes(motion: &Tensor<3>) -> usize {
    let sides: Vec<f32> = motion.clone().mean_dim(2).try_into_vec_as().unwrap();
    sides
        .windows(2)
        .filter(|pair| pair[0] * pair[1] < 0.0)
        .count()
}

#[test]
fn neighbouring_frames_agree_if_predictions_are_smoothed() {
    let (network, normalization) = (ToyDenoiser(FrameLocalNetwork), normalization(1.0));
    let batch = batch(&[100], 100);
    let motion = |temporal_smoothing| {
        let sampler = Sampler::new(&network, &normalization, 50).unwrap();
        let sampler = sampler.with_temporal_smoothing(temporal_smoothing).unwrap();
        sampler.baseline(&batch, &mut ()).unwrap()
    };
    let (alone, together) = (motion(None), motion(Some(TemporalSmoothing::default())));
    assert!(changes(&alone) > 35, "each for itself: {}", changes(&alone));
    assert!(changes(&together) < 20, "together: {}", changes(&together));
    // The last steps are not smoothed, so every frame has one of the two poses, not one between them.
    let sides: Vec<f32> = together.mean_dim(2).try_into_vec_as().unwrap();
    assert!(sides.iter().filter(|side| side.abs() > 0.2).count() > 80);
}

#[test]
fn padding_has_no_effect_and_guidance_works_with_smoothing() {
    let (network, normalization) = (ToyDenoiser(FrameLocalNetwork), normalization(1.0));
    let sampler = Sampler::new(&network, &normalization, 10).unwrap();
    let sampler = sampler
        .with_temporal_smoothing(Some(TemporalSmoothing::default()))
        .unwrap();
    let alone = sampler.baseline(&batch(&[40], 40), &mut ()).unwrap();
    let mut padded = batch(&[40, 60], 60);
    let first = batch(&[40], 40).noise;
    let rest = padded.noise.clone().narrow(0, 0, 1).narrow(1, 40, 20) * 100.0;
    let first = Tensor::cat(vec![first, rest], 1);
    padded.noise = Tensor::cat(vec![first, padded.noise.narrow(0, 1, 1)], 0);
    let together = sampler.baseline(&padded, &mut ()).unwrap();
    let difference = together.clone().narrow(0, 0, 1).narrow(1, 0, 40) - alone;
    let difference: f32 = difference.abs().max().into_scalar();
    assert!(difference < 1e-5, "{difference}");

    let scales = [[4.0, 1.0, 1.0, 1.0], [1.0; 4]].map(|scale| Scale::new(scale).unwrap().into());
    let guidance = Guidance {
        emphasis: [1e3; 4],
        ..Guidance::fast()
    };
    let guided = sampler.guided(&padded, together, &scales, &guidance, &mut ());
    let loss = guided.unwrap().loss;
    assert!(
        loss[9][0] < 0.9 * loss[0][0],
        "{:?} to {:?}",
        loss[0],
        loss[9]
    );
}

#[test]
fn invalid_smoothings_are_refused() {
    let (network, normalization) = (ToyDenoiser(FrameLocalNetwork), normalization(1.0));
    for frames in [0.0, 1e-30, -1.0, f32::NAN, 1000.0] {
        let sampler = Sampler::new(&network, &normalization, 10).unwrap();
        let temporal_smoothing = TemporalSmoothing { frames, until: 0 };
        let Err(error) = sampler.with_temporal_smoothing(Some(temporal_smoothing)) else {
            panic!("{frames} was accepted");
        };
        assert!(error.to_string().contains("0.01 to 100"), "{error}");
    }
}
