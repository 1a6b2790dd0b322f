//! Whole passes of MDM against PyTorch (`lamogen-model/tests/golden/mdm/make.py`), and its guidance.

#[path = "../../lamogen-model/tests/golden/mdm/case.rs"]
mod case;

use std::ops::ControlFlow;

use burn::tensor::{Device, Int, Tensor, TensorData, Tolerance};
use case::GoldenCase;
use lamogen_guide::{
    Batch, Body, ClassifierFree, ClassifierFreeContext, Continuation, Guidance, GuidanceVariable,
    GuideError, Sampler, Step, StepNoise, noise,
};
use lamogen_laban::{Goals, Scale};
use lamogen_model::{Denoiser, FrameMask, Mdm, MdmContext, TokenBatch, Tokens};
use lamogen_motion::{Normalization, POSE_FEATURES};

impl GoldenCase {
    fn network(&self) -> ClassifierFree<'_, Mdm> {
        let scale = f64::from(self.data("scale").iter::<f32>().next().unwrap());
        ClassifierFree::new(&self.network, scale, &wordless()).unwrap()
    }

    fn batch(
        &self,
        network: &ClassifierFree<'_, Mdm>,
        step_noise: Option<StepNoise>,
    ) -> Batch<ClassifierFreeContext<MdmContext>> {
        let data = self.data("ids");
        let ids = TensorData::new(data.iter::<i32>().collect(), data.shape().to_vec());
        let tokens = TokenBatch {
            ids: Tensor::<2, Int>::from_data(ids, &Device::flex()),
            lengths: self.counts("lengths"),
        };
        Batch {
            prompt: network.encode(&tokens),
            noise: self.tensor("x"),
            lengths: self.counts("frames"),
            step_noise,
            known: None,
            continuation: network.window().map(|_| Continuation {
                prefix: self.tensor("prefix"),
                prompts: Vec::new(),
            }),
        }
    }

    /// Returns a batch of DiP with several windows.
    fn chained(
        &self,
        network: &ClassifierFree<'_, Mdm>,
        windows: usize,
    ) -> Batch<ClassifierFreeContext<MdmContext>> {
        let mut batch = self.batch(network, Some(StepNoise::Seeded(vec![3, 4])));
        let window = network.window().unwrap().frames;
        let noise: Vec<f32> = { 0..2 }
            .flat_map(|seed| noise(seed, windows * window, POSE_FEATURES))
            .collect();
        let data = TensorData::new(noise, [2, windows * window, POSE_FEATURES]);
        batch.noise = Tensor::from_data(data, &Device::flex());
        batch.lengths = vec![windows * window, windows * window - 1];
        batch
    }

    /// Runs all timesteps and compares the motions with PyTorch's.
    fn assert_pass(&self, step_noise: Option<StepNoise>, expected: &str) {
        let network = self.network();
        let batch = self.batch(&network, step_noise);
        let normalization = normalization();
        let timesteps = self.network.noise_schedule().timesteps();
        let sampler = Sampler::new(&network, &normalization, timesteps).unwrap();
        let motions = sampler.baseline(&batch, &mut ()).unwrap();
        let frames = batch.noise.dims()[1];
        let mask = FrameMask::new(&batch.lengths, frames, &Device::flex());
        let motions = mask.keep().map_or(motions.clone(), |keep| motions * keep);
        let expected = self.data(expected);
        let largest = expected.iter::<f32>().map(f32::abs).fold(0.0, f32::max);
        let tolerance = Tolerance::<f32>::rel_abs(1e-5, 1e-5 * largest);
        motions
            .into_data()
            .assert_approx_eq::<f32>(&expected, tolerance);
    }

    /// Returns the noise that PyTorch added at each step.
    fn step_noise(&self) -> StepNoise {
        let all = self.tensor::<4>("step_noise");
        let [steps, ..] = all.dims();
        let step = |step| all.clone().narrow(0, step, 1).squeeze_dim(0);
        StepNoise::Given((0..steps).map(step).collect())
    }
}

fn wordless() -> Tokens {
    Tokens {
        ids: vec![0],
        length: 1,
        cut: 0,
        own: 0,
    }
}

fn normalization() -> Normalization {
    // Small numbers, so that the body does not spin.
    let (mean, std) = ([0.0; POSE_FEATURES], [0.05; POSE_FEATURES]);
    Normalization::from_slices(&mean, &std, &Device::flex()).unwrap()
}

#[test]
fn a_pass_of_fifty_deterministic_steps_is_pytorchs() {
    GoldenCase::open("trans_enc", "clip.pt").assert_pass(None, "pass");
}

#[test]
fn passes_of_the_network_s_own_sampler_are_pytorchs() {
    for name in ["trans_dec", "dip"] {
        let case = GoldenCase::open(name, "clip.pt");
        case.assert_pass(Some(case.step_noise()), "pass");
        case.assert_pass(None, "pass.ddim");
    }
}

#[test]
fn more_steps_than_the_network_has_timesteps_are_refused() {
    let case = GoldenCase::open("dip", "clip.pt");
    let (network, normalization) = (case.network(), normalization());
    let error = Sampler::new(&network, &normalization, 5).err().unwrap();
    let message = error.to_string();
    assert!(
        message.contains("1 to 4") && message.contains("found 5"),
        "{message}"
    );
}

fn largest(tensor: Tensor<3>) -> f32 {
    tensor.abs().max().into_scalar()
}

fn strong() -> Goals {
    Scale::new([1.5, 1.0, 1.0, 1.0]).unwrap().into()
}

/// Returns guidance of each part of a network's condition.
fn handles() -> [Guidance; 3] {
    [
        GuidanceVariable::Embedding,
        GuidanceVariable::Modulation,
        GuidanceVariable::Tokens,
    ]
    .map(|variable| Guidance {
        variable,
        body: Body::Network,
        ..Guidance::fast()
    })
}

#[test]
fn every_handle_lowers_the_loss_of_every_network() {
    for name in ["trans_enc", "trans_dec"] {
        let case = GoldenCase::open(name, "clip.pt");
        let (network, normalization) = (case.network(), normalization());
        // The features of a short motion need more frames than the golden case has.
        let mut batch = case.batch(&network, Some(StepNoise::Seeded(vec![3, 4])));
        let start: Vec<f32> = { 0..2 }
            .flat_map(|seed| noise(seed, 24, POSE_FEATURES))
            .collect();
        let start = TensorData::new(start, [2, 24, POSE_FEATURES]);
        batch.noise = Tensor::from_data(start, &Device::flex());
        batch.lengths = vec![24, 20];
        // One step, so that all updates are of the same function.
        let sampler = Sampler::new(&network, &normalization, 1).unwrap();
        let baseline = sampler.baseline(&batch, &mut ()).unwrap();
        let goals = [strong(), strong()];
        for guidance in handles() {
            let run = |guidance: &Guidance| {
                sampler
                    .guided(&batch, baseline.clone(), &goals, guidance, &mut ())
                    .unwrap()
            };
            let guided = run(&Guidance {
                updates_per_step: 40,
                learning_rate: 0.01,
                ..guidance.clone()
            });
            let still = run(&Guidance {
                learning_rate: 0.0,
                ..guidance.clone()
            });
            let label = (name, guidance.variable);
            // Norms with offsets of 0 round differently.
            let moved = largest(still.motion - baseline.clone());
            assert!(moved < 1e-4, "{label:?}: {moved}");
            let sum = |losses: &[f32]| losses.iter().sum::<f32>();
            let (with, without) = (
                sum(guided.loss.last().unwrap()),
                sum(still.loss.last().unwrap()),
            );
            assert!(with < 0.95 * without, "{label:?}: {without} {with}");
        }
    }
}

#[test]
fn windows_are_passes_that_continue_each_other() {
    let case = GoldenCase::open("dip", "clip.pt");
    let (network, normalization) = (case.network(), normalization());
    let batch = case.chained(&network, 3);
    let sampler = Sampler::new(&network, &normalization, 4).unwrap();
    assert_eq!(sampler.windows(&batch), 3);
    let mut steps = Vec::new();
    let mut observer = |step: &Step<'_>| {
        steps.push((step.index, step.timestep, step.prediction.dims()[1]));
        assert_eq!(step.steps, 12);
        ControlFlow::Continue(())
    };
    let chained = sampler.baseline(&batch, &mut observer).unwrap();
    assert_eq!(
        (steps[0], steps[4], steps[11]),
        ((0, 3, 6), (4, 3, 12), (11, 0, 18))
    );
    // Each window alone, with the end of the one before as its prefix, and the noise of its steps.
    let mut prefix = batch.continuation.as_ref().unwrap().prefix.clone();
    for window in 0..3 {
        let step_noise = (0..4).map(|step| {
            let noise = { [3, 4] }.into_iter().map(|seed| {
                let all = batch_noise(seed, 4 * window + step);
                Tensor::<1>::from_floats(&all[..], &Device::flex()).reshape([1, 6, POSE_FEATURES])
            });
            Tensor::cat(noise.collect(), 0)
        });
        let alone = Batch {
            noise: batch.noise.clone().narrow(1, 6 * window, 6),
            lengths: vec![6, 6],
            step_noise: Some(StepNoise::Given(step_noise.collect())),
            continuation: Some(Continuation {
                prefix,
                prompts: Vec::new(),
            }),
            ..batch.clone()
        };
        let alone = sampler.baseline(&alone, &mut ()).unwrap();
        let part = chained.clone().narrow(1, 6 * window, 6);
        assert_eq!(largest(part - alone.clone()), 0.0, "window {window}");
        prefix = alone.narrow(1, 2, 4);
    }
}

/// The noise that is added to a window of six frames at a step, as `StepNoise` draws it from a seed.
fn batch_noise(seed: u64, step: usize) -> Vec<f32> {
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    let mut generator = rand_chacha::ChaCha12Rng::seed_from_u64(seed);
    generator.set_stream(step as u64 + 1);
    StandardNormal
        .sample_iter(generator)
        .take(6 * POSE_FEATURES)
        .collect()
}

#[test]
fn a_sentence_of_a_window_changes_the_motion_from_there_on() {
    let case = GoldenCase::open("dip", "clip.pt");
    let (network, normalization) = (case.network(), normalization());
    let batch = case.chained(&network, 3);
    let sampler = Sampler::new(&network, &normalization, 4).unwrap();
    let one_sentence = sampler.baseline(&batch, &mut ()).unwrap();
    let mut changed = batch.clone();
    let ids = Tensor::<2, Int>::from_data([[28, 9, 8, 29], [28, 1, 3, 29]], &Device::flex());
    let continuation = changed.continuation.as_mut().unwrap();
    continuation.prompts = vec![batch.prompt.clone(), network.encode(&ids.into())];
    let two_sentences = sampler.baseline(&changed, &mut ()).unwrap();
    let change = (one_sentence - two_sentences).abs();
    assert_eq!(largest(change.clone().narrow(1, 0, 12)), 0.0);
    assert!(largest(change.narrow(1, 12, 6)) > 1e-3);
}

#[test]
fn guidance_moves_every_window_towards_the_goals_of_the_whole_motion() {
    let case = GoldenCase::open("dip", "clip.pt");
    let (network, normalization) = (case.network(), normalization());
    let batch = case.chained(&network, 4);
    let sampler = Sampler::new(&network, &normalization, 4).unwrap();
    let baseline = sampler.baseline(&batch, &mut ()).unwrap();
    let goals = [strong(), strong()];
    for guidance in handles() {
        let guidance = Guidance {
            updates_per_step: 4,
            learning_rate: 0.004,
            ..guidance
        };
        let guided = sampler
            .guided(&batch, baseline.clone(), &goals, &guidance, &mut ())
            .unwrap();
        assert_eq!(guided.motion.dims(), baseline.dims());
        assert_eq!(guided.loss.len(), 16);
        let change = (guided.motion - baseline.clone()).abs();
        for window in 0..4 {
            let change = largest(change.clone().narrow(1, 6 * window, 6));
            assert!(change > 1e-4, "{:?}, window {window}", guidance.variable);
        }
        let sum = |losses: &[f32]| losses.iter().sum::<f32>();
        let (first, last) = (sum(&guided.loss[0]), sum(&guided.loss[15]));
        assert!(last < first, "{:?}: {first} {last}", guidance.variable);
    }
    let guidance = Guidance {
        variable: GuidanceVariable::Noise { iterations: 2 },
        ..Guidance::start_noise()
    };
    let error = sampler.guided(&batch, baseline, &goals, &guidance, &mut ());
    assert!(matches!(error, Err(GuideError::NoStartNoise)));
}
