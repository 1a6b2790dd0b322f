//! What guidance may move: everything lowers the same loss.

mod batches;
mod toy;

use std::ops::ControlFlow;
use std::sync::atomic::{AtomicUsize, Ordering};

use batches::batch;
use burn::tensor::{Device, Tensor};
use lamogen_guide::{
    Batch, Body, Finish, Guidance, GuidanceVariable, GuideError, Guided, Observer, Sampler, Step,
};
use lamogen_laban::{Goals, Scale};
use lamogen_model::DenoiserInput;
use lamogen_motion::{Normalization, POSE_FEATURES};
use toy::{Says, Toy, normalization};

/// Says that the motion is what it sees of it, and a swing as large as the embedding and the mean of both its modulations; counts how
/// often it is asked.
#[derive(Default)]
struct Echo {
    asked: AtomicUsize,
}

impl Says for Echo {
    fn modulations(&self) -> usize {
        2
    }

    fn says(&self, input: DenoiserInput) -> Tensor<3> {
        self.asked.fetch_add(1, Ordering::Relaxed);
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

/// One motion of 40 frames, and what makes it in ten steps.
struct Scene<S: Says> {
    network: Toy<S>,
    normalization: Normalization,
    batch: Batch<()>,
    baseline: Tensor<3>,
}

impl<S: Says> Scene<S> {
    fn new(says: S) -> Self {
        let (network, normalization) = (Toy(says), normalization(0.3));
        let batch = batch(&[40], 40);
        let sampler = Sampler::new(&network, &normalization, 10).unwrap();
        let baseline = sampler.baseline(&batch, &mut ()).unwrap();
        Scene {
            network,
            normalization,
            batch,
            baseline,
        }
    }

    /// The motion, asked to be strong.
    fn guided(
        &self,
        guidance: &Guidance,
        observer: &mut dyn Observer,
    ) -> Result<Guided, GuideError> {
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

fn ways() -> [Guidance; 5] {
    let few = |moved| Guidance {
        variable: moved,
        emphasis: [100.0; 4],
        ..Guidance::fast()
    };
    [
        few(GuidanceVariable::Embedding),
        few(GuidanceVariable::Modulation),
        Guidance {
            updates_per_step: 3,
            // A factor on the gradient, not the length of a step.
            learning_rate: 2e-4,
            ..few(GuidanceVariable::Prediction)
        },
        few(GuidanceVariable::Motion { iterations: 15 }),
        few(GuidanceVariable::Noise { iterations: 30 }),
    ]
}

#[test]
fn whatever_is_moved_the_motion_nears_the_target() {
    let scene = Scene::new(Echo::default());
    for guidance in ways() {
        let mut steps = 0;
        let mut watch = |step: &Step<'_>| {
            assert_eq!((step.index, step.steps), (steps, guidance.steps(10)));
            let told = matches!(
                guidance.variable,
                GuidanceVariable::Embedding | GuidanceVariable::Modulation
            );
            assert_eq!(step.gradient.is_some(), told);
            let is_moved = guidance.variable == GuidanceVariable::Embedding;
            let size: f32 = step.embedding.clone().into_scalar();
            assert_eq!(size != 1.0, is_moved, "{:?}", guidance.variable);
            steps += 1;
            ControlFlow::Continue(())
        };
        let guided = scene.guided(&guidance, &mut watch).unwrap();
        assert_eq!((steps, guided.loss.len()), (guidance.steps(10), steps));
        let distance = |features: &Tensor<3>| -> f32 {
            let [found, asked] = [features, &guided.whole.target]
                .map(|features| features.clone().narrow(2, 0, 1).mean());
            (found - asked).abs().into_scalar()
        };
        let [before, after] = [&guided.whole.baseline, &guided.whole.guided].map(distance);
        println!("{:?}: {before} to {after}", guidance.variable);
        assert!(after < 0.7 * before, "{:?}", guidance.variable);
    }
}

#[test]
fn a_finish_goes_on_where_the_steps_end() {
    let scene = Scene::new(Echo::default());
    for guidance in ways() {
        let run = |guidance: &Guidance| {
            let mut seen: Vec<(usize, usize, bool)> = Vec::new();
            let (mut embeddings, mut predictions) = (Vec::new(), Vec::new());
            let mut watch = |step: &Step<'_>| {
                seen.push((step.index, step.steps, step.gradient.is_some()));
                embeddings.push(step.embedding.clone().into_scalar::<f32>());
                predictions.push(step.prediction.clone());
                ControlFlow::Continue(())
            };
            let guided = scene.guided(guidance, &mut watch).unwrap();
            (guided, seen, embeddings, predictions)
        };
        let (plain, before, ..) = run(&guidance);
        let (finished, seen, embeddings, predictions) = run(&Guidance {
            body: Body::Network,
            finish: Some(FINISH),
            ..guidance.clone()
        });
        let steps = before.len();
        assert_eq!((seen.len(), finished.loss.len()), (steps + 12, steps + 12));
        for (place, (index, of, gradient)) in seen.into_iter().enumerate() {
            assert_eq!((index, of), (place, steps + 12));
            assert!(!gradient || place < steps);
        }
        // Up to there nothing is different, and then it is the motion itself that goes on.
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
fn where_nothing_moves_it_is_the_baseline() {
    let scene = Scene::new(Echo::default());
    for guidance in ways() {
        let guidance = Guidance {
            learning_rate: 0.0,
            ..guidance
        };
        let guided = scene.guided(&guidance, &mut ()).unwrap();
        let difference = (guided.motion - scene.baseline.clone()).abs().max();
        let difference: f32 = difference.into_scalar();
        assert!(difference < 1e-5, "{:?}: {difference}", guidance.variable);
    }
}

#[test]
fn a_batch_gives_the_motions_of_single_calls() {
    let (network, normalization) = (Toy(Echo::default()), normalization(0.3));
    let sampler = Sampler::new(&network, &normalization, 10).unwrap();
    let alone = batch(&[30], 30);
    let mut padded = batch(&[30, 50], 50);
    let rest = padded.noise.clone().narrow(0, 0, 1).narrow(1, 30, 20) * 100.0;
    let first = Tensor::cat(vec![alone.noise.clone(), rest], 1);
    padded.noise = Tensor::cat(vec![first, padded.noise.narrow(0, 1, 1)], 0);
    for guidance in ways() {
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
fn a_finished_motion_is_moved_without_the_network() {
    let scene = Scene::new(Echo::default());
    let asked = |guidance: &Guidance| {
        let asked = &scene.network.0.asked;
        asked.store(0, Ordering::Relaxed);
        scene.guided(guidance, &mut ()).unwrap();
        asked.load(Ordering::Relaxed)
    };
    let [embedding, modulation, prediction, motion, noise] =
        ways().map(|guidance| asked(&guidance));
    // The embedding: once for the gradient, once with the new embedding. The noise: all steps each time, and once more at the end.
    assert_eq!([embedding, modulation], [20, 20]);
    assert_eq!([prediction, motion, noise], [10, 0, 310]);
}

#[test]
fn without_scales_and_shifts_there_is_nothing_to_move() {
    struct Plain;
    impl Says for Plain {
        fn says(&self, input: DenoiserInput) -> Tensor<3> {
            input.x_t
        }
    }
    let refused = Scene::new(Plain).guided(&Guidance::precise(), &mut ());
    let message = refused.unwrap_err().to_string();
    assert!(message.contains("scales and shifts"), "{message}");
}

#[test]
fn updates_of_a_motion_can_be_stopped_and_are_at_least_one() {
    let scene = Scene::new(Echo::default());
    let guidance = Guidance::raw_frame_update();
    let mut watch = |step: &Step<'_>| match step.index {
        4 => ControlFlow::Break(()),
        _ => ControlFlow::Continue(()),
    };
    let stopped = scene.guided(&guidance, &mut watch);
    let Err(GuideError::Stopped(stopped)) = stopped else {
        panic!("it went on");
    };
    assert_eq!(
        (stopped.index, stopped.steps, stopped.loss.len()),
        (4, 100, 5)
    );
    for moved in [
        GuidanceVariable::Motion { iterations: 0 },
        GuidanceVariable::Noise { iterations: 0 },
    ] {
        let guidance = Guidance {
            variable: moved,
            ..Guidance::fast()
        };
        let result = scene.guided(&guidance, &mut ());
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
    let result = scene.guided(&guidance, &mut ());
    let message = result.unwrap_err().to_string();
    assert!(
        message.contains("finish: expected a finite learning rate") && message.contains("NaN"),
        "{message}"
    );
}
