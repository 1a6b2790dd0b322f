//! What a network predicts makes no difference to the motion, if it knows the same.

mod toy;

use burn::tensor::{Device, Tensor};
use lamogen_guide::{Batch, Guidance, GuidanceVariable, Sampler, noise};
use lamogen_laban::Scale;
use lamogen_model::{DenoiserInput, Prediction, Prompt};
use lamogen_motion::POSE_FEATURES;
use toy::{Says, Toy, normalization};

const FRAMES: usize = 40;

/// Knows a motion, whose size the embedding sets, and says so in the terms of its prediction.
struct Knowing {
    prediction: Prediction,
    motion: Tensor<3>,
    /// How much of what it sees is part of its motion.
    echo: f32,
}

impl Knowing {
    fn new(prediction: Prediction, echo: f32) -> Toy<Self> {
        let swing = |i: usize| 0.2 * ((i / POSE_FEATURES) as f32 * 0.4 + (i % 7) as f32).sin();
        let numbers: Vec<f32> = (0..FRAMES * POSE_FEATURES).map(swing).collect();
        let motion = Tensor::<1>::from_floats(&numbers[..], &Device::flex());
        Toy(Knowing {
            prediction,
            echo,
            motion: motion.reshape([1, FRAMES, POSE_FEATURES]),
        })
    }
}

impl Says for Knowing {
    fn prediction(&self) -> Prediction {
        self.prediction
    }

    fn modulations(&self) -> usize {
        1
    }

    fn says(&self, input: DenoiserInput) -> Tensor<3> {
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
    }
}

fn largest(tensor: Tensor<3>) -> f32 {
    tensor.abs().max().into_scalar()
}

#[test]
fn noise_clean_motion_and_v_lead_to_the_same_motions() {
    let normalization = normalization(1.0);
    let scale = Scale::new([4.0, 1.0, 1.0, 1.0]).unwrap();
    let mut found: Vec<[Tensor<3>; 2]> = Vec::new();
    for prediction in [Prediction::Sample, Prediction::Epsilon, Prediction::V] {
        let network = Knowing::new(prediction, 0.0);
        let sampler = Sampler::new(&network, &normalization, 20).unwrap();
        let batch = batch();
        let baseline = sampler.baseline(&batch, &mut ()).unwrap();
        let known = largest(baseline.clone() - network.motion.clone());
        assert!(known < 2e-4, "{prediction:?}: {known}");
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
        found.push([baseline, guided]);
    }
    let [sample, others @ ..] = &found[..] else {
        unreachable!()
    };
    for other in others {
        for (a, b) in sample.iter().zip(other) {
            assert!(largest(a.clone() - b.clone()) < 2e-3);
        }
    }
}

#[test]
fn so_do_they_whatever_is_moved() {
    let normalization = normalization(1.0);
    let scale = Scale::new([4.0, 1.0, 1.0, 1.0]).unwrap();
    for (moved, learning_rate) in [
        (GuidanceVariable::Embedding, 0.05),
        (GuidanceVariable::Modulation, 0.05),
        (GuidanceVariable::Prediction, 1e-5),
        (GuidanceVariable::Noise { iterations: 3 }, 0.05),
    ] {
        let motions = [Prediction::Sample, Prediction::Epsilon, Prediction::V].map(|prediction| {
            let network = Knowing::new(prediction, 0.5);
            let sampler = Sampler::new(&network, &normalization, 10).unwrap();
            let batch = batch();
            let baseline = sampler.baseline(&batch, &mut ()).unwrap();
            let guidance = Guidance {
                variable: moved,
                learning_rate,
                ..Guidance::fast()
            };
            let scales = [scale.into()];
            let guided = sampler.guided(&batch, baseline.clone(), &scales, &guidance, &mut ());
            let guided = guided.unwrap().motion;
            assert!(largest(guided.clone() - baseline) > 1e-3, "{moved:?}");
            guided
        });
        let [sample, epsilon, v] = motions;
        for (name, other) in [("noise", epsilon), ("v", v)] {
            let difference = largest(other - sample.clone());
            assert!(difference < 2e-3, "{moved:?}, {name}: {difference}");
        }
    }
}
