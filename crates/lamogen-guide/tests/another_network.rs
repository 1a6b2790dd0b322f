//! Guidance of a network that is not MotionDiffuse: a toy network with outputs that are known in advance.

mod toy;

use std::ops::ControlFlow;

use burn::tensor::{Device, Int, Tensor};
use lamogen_guide::{
    Batch, Guidance, GuideError, Pass, Quantity, Sampler, Step, UpdateTiming, noise,
};
use lamogen_laban::{Goals, Scale};
use lamogen_model::{Denoiser, DenoiserInput};
use lamogen_motion::POSE_FEATURES;
use toy::{ToyDenoiser, ToyNetwork, normalization};

const FRAMES: usize = 24;

/// A network with a fixed swinging motion as its output, times a size that depends on the embedding.
struct SwingNetwork {
    swing: Tensor<3>,
    /// Computes the size from the embedding.
    size: fn(Tensor<2>) -> Tensor<2>,
}

impl SwingNetwork {
    fn new(size: fn(Tensor<2>) -> Tensor<2>) -> ToyDenoiser<Self> {
        let device = Device::flex();
        let values: Vec<f32> = (0..FRAMES * POSE_FEATURES)
            .map(|i| {
                let (frame, feature) = (i / POSE_FEATURES, i % POSE_FEATURES);
                let mean = (feature as f32 * 1.7).sin();
                match feature {
                    0..3 => 0.0,
                    _ => mean + (0.6 * frame as f32 + feature as f32).sin(),
                }
            })
            .collect();
        let swing = Tensor::<1>::from_floats(values.as_slice(), &device);
        ToyDenoiser(SwingNetwork {
            swing: swing.reshape([1, FRAMES, POSE_FEATURES]),
            size,
        })
    }
}

impl ToyNetwork for SwingNetwork {
    fn output(&self, input: DenoiserInput) -> Tensor<3> {
        let size = (self.size)(input.embedding).unsqueeze_dim::<3>(2);
        self.swing.clone() * size
    }
}

fn batch(network: &ToyDenoiser<SwingNetwork>, sizes: &[i32]) -> Batch<()> {
    let device = Device::flex();
    let tokens = Tensor::<1, Int>::from_data(sizes, &device).reshape([sizes.len(), 1]);
    let start: Vec<f32> = (0..sizes.len() as u64)
        .flat_map(|seed| noise(seed, FRAMES, POSE_FEATURES))
        .collect();
    Batch {
        prompt: network.encode(&tokens.into()),
        noise: Tensor::<1>::from_floats(start.as_slice(), &device).reshape([
            sizes.len(),
            FRAMES,
            POSE_FEATURES,
        ]),
        lengths: vec![FRAMES; sizes.len()],
        step_noise: None,
        continuation: None,
        known: None,
    }
}

fn scale(factors: [f32; 4]) -> Goals {
    Scale::new(factors).unwrap().into()
}

fn weight(factor: f32) -> Goals {
    scale([factor, 1.0, 1.0, 1.0])
}

fn largest(tensor: Tensor<3>) -> f32 {
    tensor.abs().max().into_scalar()
}

#[test]
fn guidance_lowers_the_loss_of_any_denoiser() {
    let (network, normalization) = (SwingNetwork::new(|e| e), normalization(1.0));
    let sampler = Sampler::new(&network, &normalization, 40).unwrap();
    let batch = batch(&network, &[1, 2]);
    let baseline = sampler.baseline(&batch, &mut ()).unwrap();
    assert!(largest(baseline.clone().narrow(0, 1, 1) - network.swing.clone() * 2.0) < 1e-4);
    // Four times the Weight needs twice the swing, which also increases Time, Flow and Shape; the
    // emphasis gives Weight priority.
    for update in [UpdateTiming::Immediate, UpdateTiming::Lagged] {
        let guidance = Guidance {
            emphasis: [1e4; 4],
            update,
            ..Guidance::fast()
        };
        let scales = [weight(4.0), weight(1.0)];
        let guided = sampler
            .guided(&batch, baseline.clone(), &scales, &guidance, &mut ())
            .unwrap();
        let (first, last) = (&guided.loss[0], guided.loss.last().unwrap());
        assert!(last[0] < 0.05 * first[0], "{update:?}: {first:?} {last:?}");
        let ratio = largest(guided.motion.clone().narrow(0, 0, 1)) / largest(network.swing.clone());
        assert!((1.8..2.2).contains(&ratio), "{update:?}: {ratio}");
        // The scale of the second motion is 1, so the motion does not change.
        let change = guided.motion.narrow(0, 1, 1) - baseline.clone().narrow(0, 1, 1);
        assert!(largest(change) < 1e-3, "{update:?}");
    }
}

#[test]
fn several_updates_a_step_lower_the_loss_further() {
    let (network, normalization) = (SwingNetwork::new(|e| e), normalization(1.0));
    let sampler = Sampler::new(&network, &normalization, 4).unwrap();
    let batch = batch(&network, &[1]);
    let baseline = sampler.baseline(&batch, &mut ()).unwrap();
    let last_loss = |updates_per_step| {
        let guidance = Guidance {
            updates_per_step,
            emphasis: [1e4; 4],
            ..Guidance::fast()
        };
        let guided = sampler.guided(&batch, baseline.clone(), &[weight(4.0)], &guidance, &mut ());
        guided.unwrap().loss[3][0]
    };
    assert!(last_loss(5) < 0.5 * last_loss(1));
}

#[test]
fn with_a_learning_rate_of_zero_the_guided_motion_is_the_baseline() {
    let (network, normalization) = (SwingNetwork::new(|e| e), normalization(1.0));
    let sampler = Sampler::new(&network, &normalization, 10).unwrap();
    let batch = batch(&network, &[1]);
    let baseline = sampler.baseline(&batch, &mut ()).unwrap();
    let guidance = Guidance {
        learning_rate: 0.0,
        ..Guidance::paper()
    };
    let guided = sampler
        .guided(&batch, baseline.clone(), &[weight(1.5)], &guidance, &mut ())
        .unwrap();
    assert_eq!(largest(guided.motion - baseline), 0.0);
}

#[test]
fn an_observer_receives_every_step_and_may_stop_the_run() {
    let (network, normalization) = (SwingNetwork::new(|e| e), normalization(1.0));
    let sampler = Sampler::new(&network, &normalization, 10).unwrap();
    let batch = batch(&network, &[1]);
    let mut steps_seen = Vec::new();
    let mut observer = |step: &Step<'_>| {
        steps_seen.push((step.pass, step.index, step.timestep, step.loss.is_some()));
        match (step.pass, step.index) {
            (Pass::Guided, 6) => ControlFlow::Break(()),
            _ => ControlFlow::Continue(()),
        }
    };
    let baseline = sampler.baseline(&batch, &mut observer).unwrap();
    let guidance = Guidance::fast();
    let error = sampler
        .guided(&batch, baseline, &[weight(1.5)], &guidance, &mut observer)
        .unwrap_err();
    assert_eq!(steps_seen.len(), 17);
    assert_eq!(steps_seen[0], (Pass::Baseline, 0, 900, false));
    assert_eq!(steps_seen[9], (Pass::Baseline, 9, 0, false));
    assert_eq!(steps_seen[16], (Pass::Guided, 6, 300, true));
    let message = error.to_string();
    assert!(
        message.contains("step 7 of 10 of the guided pass"),
        "{message}"
    );
    let GuideError::Stopped(stopped) = error else {
        panic!("{message}");
    };
    assert_eq!(stopped.loss.len(), 7);
    assert_eq!(stopped.prediction.dims(), [1, FRAMES, POSE_FEATURES]);
}

#[test]
fn the_error_of_a_non_finite_loss_names_component_step_and_motion() {
    let (network, normalization) = (SwingNetwork::new(|e| e), normalization(1.0));
    let sampler = Sampler::new(&network, &normalization, 10).unwrap();
    let batch = batch(&network, &[1, 1]);
    let baseline = sampler.baseline(&batch, &mut ()).unwrap();
    let scales = [weight(1.5), scale([1.0, 1.0, 1e30, 1.0])];
    let error = sampler
        .guided(&batch, baseline, &scales, &Guidance::fast(), &mut ())
        .unwrap_err();
    let message = error.to_string();
    assert!(
        matches!(
            error,
            GuideError::NotFinite {
                quantity: Quantity::Loss,
                index: 0,
                timestep: 900,
                motion: 1,
                ..
            }
        ),
        "{message}"
    );
    assert!(
        message.contains("loss of Flow") && message.contains("step 1 of 10"),
        "{message}"
    );
}

#[test]
fn the_error_of_a_non_finite_gradient_names_its_component() {
    // The square root of 0 is 0, and its derivative there is infinite.
    let (network, normalization) = (
        SwingNetwork::new(|e| (e - 1.0).sqrt() + 1.0),
        normalization(1.0),
    );
    let sampler = Sampler::new(&network, &normalization, 10).unwrap();
    let batch = batch(&network, &[1]);
    let baseline = sampler.baseline(&batch, &mut ()).unwrap();
    let error = sampler
        .guided(&batch, baseline, &[weight(1.5)], &Guidance::fast(), &mut ())
        .unwrap_err();
    let message = error.to_string();
    assert!(
        matches!(
            error,
            GuideError::NotFinite {
                quantity: Quantity::Gradient,
                index: 0,
                motion: 0,
                ..
            }
        ),
        "{message}"
    );
    assert!(
        message.contains("gradient of the loss of Weight"),
        "{message}"
    );
}

#[test]
fn invalid_options_are_refused() {
    type Change = fn(&mut Guidance);
    let changes: [(Change, &str); 7] = [
        (|g| g.learning_rate = f64::NAN, "learning rate"),
        (|g| g.learning_rate = -0.1, "-0.1"),
        (|g| g.betas = [0.7, 1.0], "betas"),
        (|g| g.epsilon = 0.0, "epsilon"),
        (|g| g.updates_per_step = 0, "update"),
        (|g| g.emphasis[1] = f32::INFINITY, "emphasis"),
        (|g| g.emphasis[3] = -1.0, "emphasis"),
    ];
    for (change, part) in changes {
        let mut guidance = Guidance::default();
        change(&mut guidance);
        let message = guidance.check().unwrap_err().to_string();
        assert!(message.contains(part), "{message}");
    }
}

#[test]
fn the_motion_of_a_network_that_ignores_the_embedding_does_not_change() {
    let (network, normalization) = (
        SwingNetwork::new(|e| e.inner() * 0.0 + 1.0),
        normalization(1.0),
    );
    let sampler = Sampler::new(&network, &normalization, 5).unwrap();
    let batch = batch(&network, &[1]);
    let baseline = sampler.baseline(&batch, &mut ()).unwrap();
    let guidance = Guidance::fast();
    let scales = [weight(1.5)];
    let guided = sampler.guided(&batch, baseline.clone(), &scales, &guidance, &mut ());
    assert_eq!(largest(guided.unwrap().motion - baseline), 0.0);
}
