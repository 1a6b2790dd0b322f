//! Networks that predict noise, the clean motion or v lead to the same motions, if they have the same clean motion.

mod toy;

use burn::tensor::{Device, Tensor};
use lamogen_guide::{Batch, Guidance, GuidanceVariable, Sampler, noise};
use lamogen_laban::Scale;
use lamogen_model::{DenoiserInput, Prediction, Prompt};
use lamogen_motion::POSE_FEATURES;
use toy::{ToyDenoiser, ToyNetwork, normalization};

const FRAMES: usize = 40;

/// A network with a fixed clean motion, times the embedding. Its output is that motion, the noise or v.
struct KnownMotionNetwork {
    prediction: Prediction,
    motion: Tensor<3>,
    /// The factor on `tanh(x_t)`, which is added to the clean motion.
    echo: f32,
}

impl KnownMotionNetwork {
    fn new(prediction: Prediction, echo: f32) -> ToyDenoiser<Self> {
        let swing = |i: usize| 0.2 * ((i / POSE_FEATURES) as f32 * 0.4 + (i % 7) as f32).sin();
        let numbers: Vec<f32> = (0..FRAMES * POSE_FEATURES).map(swing).collect();
        let motion = Tensor::<1>::from_floats(&numbers[..], &Device::flex());
        ToyDenoiser(KnownMotionNetwork {
            prediction,
            echo,
            motion: motion.reshape([1, FRAMES, POSE_FEATURES]),
        })
    }
}

impl ToyNetwork for KnownMotionNetwork {
    fn prediction(&self) -> Prediction {
        self.prediction
    }

    fn modulation_width(&self) -> usize {
        1
    }

    fn output(&self, input: DenoiserInput) -> Tensor<3> {
        let alpha = input.time.unsqueeze_dim::<3>(2);
        let rest: Tensor<3> = 1.0 - alpha.clone();
        let (signal, rest) = (alpha.sqrt(), rest.sqrt());
        let clean = self.motion.clone() * input.embedding.unsqueeze_dim::<3>(2)
            + input.x_t.clone().tanh() * self.echo;
        let clean = match input.modulation {
            Some(modulation) => clean + self.motion.clone() * modulation.unsqueeze_dim::<3>(2),
            None => clean,
        };
        let noise = (input.x_t - clean.clone() * signal.clone()) / rest.clone();
        match self.prediction {
            Prediction::Sample => clean,
            Prediction::Epsilon => noise,
            Prediction::V => noise * signal - clean * rest,
        }
    }
}

fn batch() -> Batch<()> {
    let device = Device::flex();
    let start = noise(3, FRAMES, POSE_FEATURES);
    let start = Tensor::<1>::from_floats(&start[..], &device);
    Batch {
        prompt: Prompt {
            embedding: Tensor::from_floats([[1.0]], &device),
            context: (),
        },
        noise: start.reshape([1, FRAMES, POSE_FEATURES]),
        lengths: vec![FRAMES],
        step_noise: None,
        continuation: None,
        known: None,
    }
}

fn largest(tensor: Tensor<3>) -> f32 {
    tensor.abs().max().into_scalar()
}

#[test]
fn noise_clean_motion_and_v_lead_to_the_same_motions() {
    let normalization = normalization(1.0);
    let scale = Scale::new([4.0, 1.0, 1.0, 1.0]).unwrap();
    let mut motions: Vec<[Tensor<3>; 2]> = Vec::new();
    for prediction in [Prediction::Sample, Prediction::Epsilon, Prediction::V] {
        let network = KnownMotionNetwork::new(prediction, 0.0);
        let sampler = Sampler::new(&network, &normalization, 20).unwrap();
        let batch = batch();
        let baseline = sampler.baseline(&batch, &mut ()).unwrap();
        let error = largest(baseline.clone() - network.motion.clone());
        assert!(error < 2e-4, "{prediction:?}: {error}");
        let guidance = Guidance {
            emphasis: [1e4; 4],
            ..Guidance::fast()
        };
        let guided = sampler.guided(
            &batch,
            baseline.clone(),
            &[scale.into()],
            &guidance,
            &mut (),
        );
        let guided = guided.unwrap().motion;
        assert!(
            largest(guided.clone() - baseline.clone()) > 1e-2,
            "{prediction:?}"
        );
        motions.push([baseline, guided]);
    }
    let [sample, others @ ..] = &motions[..] else {
        unreachable!()
    };
    for other in others {
        for (a, b) in sample.iter().zip(other) {
            assert!(largest(a.clone() - b.clone()) < 2e-3);
        }
    }
}

#[test]
fn noise_clean_motion_and_v_lead_to_the_same_motions_with_every_variable() {
    let normalization = normalization(1.0);
    let scale = Scale::new([4.0, 1.0, 1.0, 1.0]).unwrap();
    for (variable, learning_rate) in [
        (GuidanceVariable::Embedding, 0.05),
        (GuidanceVariable::Modulation, 0.05),
        (GuidanceVariable::Prediction, 1e-5),
        (GuidanceVariable::Noise { iterations: 3 }, 0.05),
    ] {
        let motions = [Prediction::Sample, Prediction::Epsilon, Prediction::V].map(|prediction| {
            let network = KnownMotionNetwork::new(prediction, 0.5);
            let sampler = Sampler::new(&network, &normalization, 10).unwrap();
            let batch = batch();
            let baseline = sampler.baseline(&batch, &mut ()).unwrap();
            let guidance = Guidance {
                variable,
                learning_rate,
                ..Guidance::fast()
            };
            let scales = [scale.into()];
            let guided = sampler.guided(&batch, baseline.clone(), &scales, &guidance, &mut ());
            let guided = guided.unwrap().motion;
            assert!(largest(guided.clone() - baseline) > 1e-3, "{variable:?}");
            guided
        });
        let [sample, epsilon, v] = motions;
        for (name, other) in [("noise", epsilon), ("v", v)] {
            let difference = largest(other - sample.clone());
            assert!(difference < 2e-3, "{variable:?}, {name}: {difference}");
        }
    }
}
