//! The variables of guidance: the motion nears its target with each of them.

mod batches;
mod toy;

use std::ops::ControlFlow;
use std::sync::atomic::{AtomicUsize, Ordering};

use batches::batch;
use burn::tensor::{Device, Tensor};
use lamogen_guide::{
    Batch, Body, Finish, Guidance, GuidanceVariable, GuideError, GuidedMotions, Observer, Sampler,
    Step,
};
use lamogen_laban::{Goals, Scale};
use lamogen_model::DenoiserInput;
use lamogen_motion::{Normalization, POSE_FEATURES};
use toy::{ToyDenoiser, ToyNetwork, normalization};

/// A network with two modulations. Its output is `0.8 · tanh(x_t)` plus 0.3 times a swing, which is scaled by the sum
/// of the embedding and the mean of the modulations. It counts its evaluations.
#[derive(Default)]
struct EchoNetwork {
    evaluations: AtomicUsize,
}

impl ToyNetwork for EchoNetwork {
    fn modulation_width(&self) -> usize {
        2
    }

    fn output(&self, input: DenoiserInput) -> Tensor<3> {
        self.evaluations.fetch_add(1, Ordering::Relaxed);
        let [_, frames, _] = input.x_t.dims();
        let swing: Vec<f32> = (0..frames * POSE_FEATURES)
            .map(|i| {
                let (frame, feature) = (i / POSE_FEATURES, i % POSE_FEATURES);
                (0.5 * frame as f32 + feature as f32).sin()
            })
            .collect();
        let swing = Tensor::<1>::from_floats(&swing[..], &Device::flex());
        let swing = swing.reshape([1, frames, POSE_FEATURES]);
        let mut size = input.embedding;
        if let Some(modulation) = input.modulation {
            size = size + modulation.mean_dim(1);
        }
        let size = size.unsqueeze_dim::<3>(2);
        input.x_t.tanh() * 0.8 + swing * size * 0.3
    }
}

/// One motion of 40 frames, with the network and the batch that it is sampled from in ten steps.
struct Setup<N: ToyNetwork> {
    network: ToyDenoiser<N>,
    normalization: Normalization,
    batch: Batch<()>,
    baseline: Tensor<3>,
}

impl<N: ToyNetwork> Setup<N> {
    fn new(network: N) -> Self {
        let (network, normalization) = (ToyDenoiser(network), normalization(0.3));
        let batch = batch(&[40], 40);
        let sampler = Sampler::new(&network, &normalization, 10).unwrap();
        let baseline = sampler.baseline(&batch, &mut ()).unwrap();
        Setup {
            network,
            normalization,
            batch,
            baseline,
        }
    }

    /// Runs the guided pass with the goals of [`strong`].
    fn run_guided(
        &self,
        guidance: &Guidance,
        observer: &mut dyn Observer,
    ) -> Result<GuidedMotions, GuideError> {
        let sampler = Sampler::new(&self.network, &self.normalization, 10).unwrap();
        let baseline = self.baseline.clone();
        sampler.guided(&self.batch, baseline, &[strong()], guidance, observer)
    }
}

fn strong() -> Goals {
    Scale::new([2.0, 1.0, 1.0, 1.0]).unwrap().into()
}

const FINISH: Finish = Finish {
    iterations: 12,
    learning_rate: 0.006,
    epsilon: 1e-8,
};

/// Returns guidance of each variable.
fn all_variables() -> [Guidance; 5] {
    let emphasised = |variable| Guidance {
        variable,
        emphasis: [100.0; 4],
        ..Guidance::fast()
    };
    [
        emphasised(GuidanceVariable::Embedding),
        emphasised(GuidanceVariable::Modulation),
        Guidance {
            updates_per_step: 3,
            // For this variable the learning rate is a factor on the gradient.
            learning_rate: 2e-4,
            ..emphasised(GuidanceVariable::Prediction)
        },
        emphasised(GuidanceVariable::Motion { iterations: 15 }),
        emphasised(GuidanceVariable::Noise { iterations: 30 }),
    ]
}

#[test]
fn the_motion_nears_the_target_with_every_variable() {
    let setup = Setup::new(EchoNetwork::default());
    for guidance in all_variables() {
        let mut steps = 0;
        let mut observer = |step: &Step<'_>| {
            assert_eq!((step.index, step.steps), (steps, guidance.steps(10)));
            let has_gradient = matches!(
                guidance.variable,
                GuidanceVariable::Embedding | GuidanceVariable::Modulation
            );
            assert_eq!(step.gradient.is_some(), has_gradient);
            let is_embedding = guidance.variable == GuidanceVariable::Embedding;
            let embedding: f32 = step.embedding.clone().into_scalar();
            assert_eq!(embedding != 1.0, is_embedding, "{:?}", guidance.variable);
            steps += 1;
            ControlFlow::Continue(())
        };
        let guided = setup.run_guided(&guidance, &mut observer).unwrap();
        assert_eq!((steps, guided.loss.len()), (guidance.steps(10), steps));
        let distance = |features: &Tensor<3>| -> f32 {
            let [mean, target_mean] = [features, &guided.whole.target]
                .map(|features| features.clone().narrow(2, 0, 1).mean());
            (mean - target_mean).abs().into_scalar()
        };
        let [before, after] = [&guided.whole.baseline, &guided.whole.guided].map(distance);
        println!("{:?}: {before} to {after}", guidance.variable);
        assert!(after < 0.7 * before, "{:?}", guidance.variable);
    }
}

#[test]
fn a_finish_continues_after_the_steps_of_the_variable() {
    let setup = Setup::new(EchoNetwork::default());
    for guidance in all_variables() {
        let run = |guidance: &Guidance| {
            let mut steps_seen: Vec<(usize, usize, bool)> = Vec::new();
            let (mut embeddings, mut predictions) = (Vec::new(), Vec::new());
            let mut observer = |step: &Step<'_>| {
                steps_seen.push((step.index, step.steps, step.gradient.is_some()));
                embeddings.push(step.embedding.clone().into_scalar::<f32>());
                predictions.push(step.prediction.clone());
                ControlFlow::Continue(())
            };
            let guided = setup.run_guided(guidance, &mut observer).unwrap();
            (guided, steps_seen, embeddings, predictions)
        };
        let (plain, before, ..) = run(&guidance);
        let (finished, steps_seen, embeddings, predictions) = run(&Guidance {
            body: Body::Network,
            finish: Some(FINISH),
            ..guidance.clone()
        });
        let steps = before.len();
        assert_eq!(
            (steps_seen.len(), finished.loss.len()),
            (steps + 12, steps + 12)
        );
        for (position, (index, count, has_gradient)) in steps_seen.into_iter().enumerate() {
            assert_eq!((index, count), (position, steps + 12));
            assert!(!has_gradient || position < steps);
        }
        // The steps of the variable are the same as without a finish; the steps after them move the motion itself.
        assert_eq!(finished.loss[..steps], plain.loss);
        let same = |a: &Tensor<3>, b: &Tensor<3>| {
            let difference: f32 = (a.clone() - b.clone()).abs().max().into_scalar();
            difference == 0.0
        };
        assert!(same(&finished.motion, &predictions[steps + 11]));
        assert!(!same(&finished.motion, &plain.motion));
        assert_eq!(embeddings[steps - 1], embeddings[steps + 11]);
        let [first, last] = [steps, steps + 11].map(|step| finished.loss[step][0]);
        println!("{:?}: {first} to {last}", guidance.variable);
        assert!(
            last < 0.9 * first,
            "{:?}: {first} to {last}",
            guidance.variable
        );
    }
}

#[test]
fn with_a_learning_rate_of_zero_the_motion_is_the_baseline() {
    let setup = Setup::new(EchoNetwork::default());
    for guidance in all_variables() {
        let guidance = Guidance {
            learning_rate: 0.0,
            ..guidance
        };
        let guided = setup.run_guided(&guidance, &mut ()).unwrap();
        let difference = (guided.motion - setup.baseline.clone()).abs().max();
        let difference: f32 = difference.into_scalar();
        assert!(difference < 1e-5, "{:?}: {difference}", guidance.variable);
    }
}

#[test]
fn a_batch_gives_the_motions_of_single_calls() {
    let (network, normalization) = (ToyDenoiser(EchoNetwork::default()), normalization(0.3));
    let sampler = Sampler::new(&network, &normalization, 10).unwrap();
    let alone = batch(&[30], 30);
    let mut padded = batch(&[30, 50], 50);
    let rest = padded.noise.clone().narrow(0, 0, 1).narrow(1, 30, 20) * 100.0;
    let first = Tensor::cat(vec![alone.noise.clone(), rest], 1);
    padded.noise = Tensor::cat(vec![first, padded.noise.narrow(0, 1, 1)], 0);
    for guidance in all_variables() {
        let motion = |batch: &Batch<()>| {
            let baseline = sampler.baseline(batch, &mut ()).unwrap();
            let scales = vec![strong(); batch.lengths.len()];
            let guided = sampler.guided(batch, baseline, &scales, &guidance, &mut ());
            guided.unwrap().motion.narrow(0, 0, 1).narrow(1, 0, 30)
        };
        let difference: f32 = (motion(&alone) - motion(&padded)).abs().max().into_scalar();
        assert!(difference < 1e-3, "{:?}: {difference}", guidance.variable);
    }
}

#[test]
fn updates_of_a_finished_motion_do_not_evaluate_the_network() {
    let setup = Setup::new(EchoNetwork::default());
    let count_evaluations = |guidance: &Guidance| {
        let evaluations = &setup.network.0.evaluations;
        evaluations.store(0, Ordering::Relaxed);
        setup.run_guided(guidance, &mut ()).unwrap();
        evaluations.load(Ordering::Relaxed)
    };
    let [embedding, modulation, prediction, motion, noise] =
        all_variables().map(|guidance| count_evaluations(&guidance));
    // For the embedding, each step evaluates the network once for the gradient and once with the new embedding. For the
    // noise, each iteration evaluates it at all steps, and the final pass does so once more.
    assert_eq!([embedding, modulation], [20, 20]);
    assert_eq!([prediction, motion, noise], [10, 0, 310]);
}

#[test]
fn modulation_of_a_network_without_scales_and_shifts_is_refused() {
    struct IdentityNetwork;
    impl ToyNetwork for IdentityNetwork {
        fn output(&self, input: DenoiserInput) -> Tensor<3> {
            input.x_t
        }
    }
    let result = Setup::new(IdentityNetwork).run_guided(&Guidance::precise(), &mut ());
    let message = result.unwrap_err().to_string();
    assert!(message.contains("scales and shifts"), "{message}");
}

#[test]
fn updates_of_a_motion_can_be_stopped_and_are_at_least_one() {
    let setup = Setup::new(EchoNetwork::default());
    let guidance = Guidance::raw_frame_update();
    let mut observer = |step: &Step<'_>| match step.index {
        4 => ControlFlow::Break(()),
        _ => ControlFlow::Continue(()),
    };
    let stopped = setup.run_guided(&guidance, &mut observer);
    let Err(GuideError::Stopped(stopped)) = stopped else {
        panic!("the pass was not stopped");
    };
    assert_eq!(
        (stopped.index, stopped.steps, stopped.loss.len()),
        (4, 100, 5)
    );
    for variable in [
        GuidanceVariable::Motion { iterations: 0 },
        GuidanceVariable::Noise { iterations: 0 },
    ] {
        let guidance = Guidance {
            variable,
            ..Guidance::fast()
        };
        let result = setup.run_guided(&guidance, &mut ());
        let message = result.unwrap_err().to_string();
        assert!(message.contains("1 to 1000000 iterations"), "{message}");
    }
    let guidance = Guidance {
        finish: Some(Finish {
            learning_rate: f64::NAN,
            ..FINISH
        }),
        ..Guidance::fast()
    };
    let result = setup.run_guided(&guidance, &mut ());
    let message = result.unwrap_err().to_string();
    assert!(
        message.contains("finish: expected a finite learning rate") && message.contains("NaN"),
        "{message}"
    );
}
