//! Frames that a network decides about one by one, smoothed along time.

mod batches;
mod toy;

use batches::batch;
use burn::tensor::Tensor;
use lamogen_guide::{Guidance, Sampler, TemporalSmoothing};
use lamogen_laban::Scale;
use lamogen_model::DenoiserInput;
use toy::{Says, Toy, normalization};

/// Sees one of two poses in each frame, the nearer one, and nothing of the others: as a small network sees the legs of a walk.
struct Shortsighted;

impl Says for Shortsighted {
    fn says(&self, input: DenoiserInput) -> Tensor<3> {
        // The mean over the features of a frame tells on which side it is.
        let side = (input.x_t.clone().mean_dim(2) * 20.0).tanh() * 0.3;
        side * input.embedding.unsqueeze_dim::<3>(2) + input.x_t.zeros_like()
    }
}

/// How often neighbouring frames are on different sides.
fn changes(motion: &Tensor<3>) -> usize {
    let sides: Vec<f32> = motion.clone().mean_dim(2).try_into_vec_as().unwrap();
    sides
        .windows(2)
        .filter(|pair| pair[0] * pair[1] < 0.0)
        .count()
}

#[test]
fn frames_agree_where_predictions_are_smoothed() {
    let (network, normalization) = (Toy(Shortsighted), normalization(1.0));
    let batch = batch(&[100], 100);
    let motion = |temporal_smoothing| {
        let sampler = Sampler::new(&network, &normalization, 50).unwrap();
        let sampler = sampler.with_temporal_smoothing(temporal_smoothing).unwrap();
        sampler.baseline(&batch, &mut ()).unwrap()
    };
    let (alone, together) = (motion(None), motion(Some(TemporalSmoothing::default())));
    assert!(changes(&alone) > 35, "each for itself: {}", changes(&alone));
    assert!(changes(&together) < 20, "together: {}", changes(&together));
    // The last steps are the network's own: every frame is on one side, and not between.
    let sides: Vec<f32> = together.mean_dim(2).try_into_vec_as().unwrap();
    assert!(sides.iter().filter(|side| side.abs() > 0.2).count() > 80);
}

#[test]
fn padding_does_not_leak_in_and_guidance_goes_through() {
    let (network, normalization) = (Toy(Shortsighted), normalization(1.0));
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
fn smoothings_that_make_no_sense_are_refused() {
    let (network, normalization) = (Toy(Shortsighted), normalization(1.0));
    for frames in [0.0, 1e-30, -1.0, f32::NAN, 1000.0] {
        let sampler = Sampler::new(&network, &normalization, 10).unwrap();
        let temporal_smoothing = TemporalSmoothing { frames, until: 0 };
        let Err(error) = sampler.with_temporal_smoothing(Some(temporal_smoothing)) else {
            panic!("{frames} was taken");
        };
        assert!(error.to_string().contains("0.01 to 100"), "{error}");
    }
}
