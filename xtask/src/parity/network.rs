//! What lamogen computes from the inputs of a case.

use std::ops::ControlFlow;
use std::path::Path;

use burn::tensor::{Tensor, TensorData};
use lamogen_guide::{Batch, Guidance, Sampler, Schedule, Step, noise};
use lamogen_laban::{Goals, LabanFeatures, LabanOptions, LossDivisor, Smoothing, Target};
use lamogen_model::{
    Checkpoint, CrossAttentionContext, Denoiser, DenoiserInput, FrameMask, ModelConfig,
    MotionDiffuse, Prompt,
};
use lamogen_motion::{Normalization, joints};

use super::case::Case;
use super::{Actual, EXACT, GUIDED, ParityError, Row, SEVERAL, SINGLE, Values, Watch};

/// Values that add up what the network says at every step of a pass.
const BEHIND_PASSES: [&str; 7] = [
    "out.classifier",
    "out.e_grad",
    "out.guided",
    "out.guided_mean",
    "out.raw_update",
    "out.trace_e",
    "out.trace_loss",
];

/// Runs that measure what rounding does.
const ROUNDING_RUNS: u64 = 8;

/// What a case is computed with.
pub(super) struct Network {
    pub(super) model: MotionDiffuse,
    pub(super) normalization: Normalization,
}

impl Network {
    pub(super) fn load(folder: &Path, case: &Case) -> Result<Self, ParityError> {
        let config = ModelConfig::from_file(folder.join("config.json"))?;
        case.check(&config)?;
        let checkpoint = Checkpoint::open(folder.join("latest.tar"))?;
        Ok(Network {
            model: checkpoint.load(&config, &case.device)?,
            normalization: Normalization::from_files(
                folder.join("mean.npy"),
                folder.join("std.npy"),
                config.input_feats,
                &case.device,
            )?,
        })
    }

    /// Everything that lamogen computes from the inputs of a case.
    pub(super) fn compute(&self, case: &Case, watch: Watch<'_>) -> Result<Values, ParityError> {
        let prompt = self.model.encode(case.tokens()?);
        let mut values = Values::new();
        schedule(case, &mut values)?;
        self.evaluate(case, &prompt, &mut values)?;
        laban(case, &mut values)?;
        let (noise, baseline) = (case.tensor("in.z")?, case.tensor("out.baseline")?);
        values.append(&mut self.passes(case, prompt, noise, baseline, watch)?);
        Ok(values)
    }

    /// Repeats the passes from start noise and baselines that are off by their own rounding, and embeddings that are
    /// off by as much as lamogen's and the reference's are from each other, at random; and notes how
    /// far that moves the values that are off.
    pub(super) fn measure_rounding(
        &self,
        case: &Case,
        actual: &Values,
        rows: &mut [Row],
        watch: Watch<'_>,
    ) -> Result<(), ParityError> {
        let error_of = |name: &str| rows.iter().find(|row| row.name == name)?.result;
        let encoder = error_of("out.e").map_or(0.0, |result| result.error);
        let size = encoder.clamp(f64::from(f32::EPSILON), SINGLE);
        let is_off = |row: &Row| {
            row.result
                .is_some_and(|result| !result.is_within_tolerance())
        };
        let mut off: Vec<&mut Row> = rows
            .iter_mut()
            .filter(|row| is_off(row) && BEHIND_PASSES.contains(&row.name.as_str()))
            .collect();
        if off.is_empty() {
            return Ok(());
        }
        let prompt = self.model.encode(case.tokens()?);
        let [batch, width] = prompt.embedding.dims();
        let largest: f32 = prompt.embedding.clone().abs().max().into_scalar();
        for seed in 0..ROUNDING_RUNS {
            // Three standard deviations are as much as the largest difference seen.
            let directions: Vec<f32> = noise(seed, batch, width)
                .into_iter()
                .map(|x| x / 3.0 * largest * size as f32)
                .collect();
            let directions = TensorData::new(directions, [batch, width]);
            let moved = Prompt {
                embedding: prompt.embedding.clone() + Tensor::from_data(directions, &case.device),
                context: prompt.context.clone(),
            };
            let rounded = |name: &str, seed: u64| -> Result<Tensor<3>, ParityError> {
                let exact = case.tensor::<3>(name)?;
                let [motions, frames, features] = exact.dims();
                let rounding = noise(seed, motions * frames, features);
                let rounding = TensorData::new(rounding, [motions, frames, features]);
                let rounding = Tensor::<3>::from_data(rounding, &case.device) * f32::EPSILON;
                Ok(exact.clone() + exact * rounding)
            };
            let start = rounded("in.z", ROUNDING_RUNS + seed)?;
            let baseline = rounded("out.baseline", 2 * ROUNDING_RUNS + seed)?;
            let values = self.passes(case, moved, start, baseline, watch)?;
            for row in &mut off {
                let name = row.name.as_str();
                let (Some(result), Some(actual), Some(moved)) =
                    (&mut row.result, actual.get(name), values.get(name))
                else {
                    continue;
                };
                // Both programs round, so they may be twice as far apart.
                let distance = 2.0 * moved.distance(actual.values.iter().copied());
                // A run that leaves the numbers says nothing about rounding.
                if distance.is_finite() {
                    result.rounding = Some(result.rounding.unwrap_or(0.0).max(distance));
                }
            }
        }
        Ok(())
    }

    /// What the passes of a case start from.
    pub(super) fn batch(&self, case: &Case) -> Result<Batch<CrossAttentionContext>, ParityError> {
        Ok(Batch {
            prompt: self.model.encode(case.tokens()?),
            noise: case.tensor("in.z")?,
            lengths: case.lengths()?,
        })
    }

    /// Text encoder, one evaluation, and joints.
    pub(super) fn evaluate(
        &self,
        case: &Case,
        prompt: &Prompt<CrossAttentionContext>,
        actual: &mut Values,
    ) -> Result<(), ParityError> {
        let (x_t, lengths) = (case.tensor::<3>("in.x_t")?, case.lengths()?);
        let (e, text) = self.model.encode_text(case.tokens()?);
        actual.insert("out.e", Actual::of(e, SINGLE));
        actual.insert("out.text", Actual::of(text, SINGLE));

        let timesteps: Vec<usize> = case.integers("in.t")?;
        let input = DenoiserInput {
            x_t: x_t.clone(),
            time: self.model.embed_timesteps(&timesteps),
            embedding: prompt.embedding.clone(),
            modulation: None,
            mask: FrameMask::new(&lengths, x_t.dims()[1], &case.device),
        };
        let eps = self.model.denoise(input, &prompt.context);
        actual.insert("out.eps", Actual::of_motions(eps, &lengths, SINGLE));

        let positions = joints(self.normalization.denormalize(x_t));
        actual.insert("out.joints", Actual::of(positions, SINGLE));
        Ok(())
    }

    /// Baseline and guided passes; these begin with the `reference` baseline.
    fn passes(
        &self,
        case: &Case,
        prompt: Prompt<CrossAttentionContext>,
        noise: Tensor<3>,
        reference: Tensor<3>,
        watch: Watch<'_>,
    ) -> Result<Values, ParityError> {
        let mut actual = Values::new();
        let batch = Batch {
            prompt,
            noise,
            lengths: case.lengths()?,
        };
        let size = batch.lengths.len();
        let scales = vec![case.scale()?.into(); size];
        let sampler = Sampler::new(&self.model, &self.normalization, case.steps()?)?;
        let mut watched = |step: &Step<'_>| {
            watch(step);
            ControlFlow::Continue(())
        };
        let baseline = sampler.baseline(&batch, &mut watched)?;
        let motions = |motions, tolerance| Actual::of_motions(motions, &batch.lengths, tolerance);
        actual.insert("out.baseline", motions(baseline, SEVERAL));

        // The reference's baseline is the guided pass's input, so that an error shows where it arises.
        let baseline = reference;

        let (mut gradient, mut embeddings) = (None, Vec::new());
        let mut record = |step: &Step<'_>| {
            gradient = gradient.take().or(step.gradient.cloned());
            embeddings.push(step.embedding.clone());
            watched(step)
        };
        let guided = sampler.guided(
            &batch,
            baseline.clone(),
            &scales,
            &Guidance::paper(),
            &mut record,
        )?;
        actual.insert("out.guided", motions(guided.motion, GUIDED));
        actual.insert(
            "out.trace_e",
            Actual::of(Tensor::stack::<3>(embeddings, 0), GUIDED),
        );
        let shape = vec![guided.loss.len(), size];
        let loss = guided.loss.into_iter().flatten().map(f64::from).collect();
        actual.insert("out.trace_loss", Actual::new(loss, shape, GUIDED));
        if let Some(gradient) = gradient {
            actual.insert("out.e_grad", Actual::of(gradient, SEVERAL));
        }

        for (name, guidance) in [
            ("out.guided_mean", Guidance::fast()),
            ("out.raw_update", Guidance::raw_frame_update()),
            ("out.classifier", Guidance::classifier()),
        ] {
            let baseline = baseline.clone();
            let guided = sampler.guided(&batch, baseline, &scales, &guidance, &mut watched)?;
            actual.insert(name, motions(guided.motion, GUIDED));
        }
        Ok(actual)
    }
}

fn schedule(case: &Case, actual: &mut Values) -> Result<(), ParityError> {
    let schedule = Schedule::linear();
    let timesteps = schedule.ddim(case.steps()?)?;
    let timesteps: Vec<f64> = timesteps.iter().map(|s| s.timestep as f64).collect();
    let shape = vec![timesteps.len()];
    actual.insert("out.timesteps", Actual::new(timesteps, shape, EXACT));
    let abar = schedule.alphas_cumprod().to_vec();
    let shape = vec![abar.len()];
    actual.insert("out.abar", Actual::new(abar, shape, EXACT));
    Ok(())
}

/// Laban features of given joints, and the gradient of the loss.
pub(super) fn laban(case: &Case, actual: &mut Values) -> Result<(), ParityError> {
    let joints = case.tensor::<4>("in.joints")?;
    let [batch, frames, _, _] = joints.dims();
    let lengths = vec![frames; batch];
    let extractor = |smoothing| {
        let options = LabanOptions {
            smoothing,
            ..LabanOptions::default()
        };
        LabanFeatures::new(&options, frames, &lengths, &case.device)
    };
    let raw = extractor(Smoothing::None).measure(joints.clone());
    actual.insert("out.laban_raw", Actual::of(raw, SINGLE));

    let features = extractor(Smoothing::default());
    let baseline = features.measure(joints.clone());
    actual.insert("out.laban", Actual::of(baseline.clone(), SINGLE));

    let goals = vec![Goals::from(case.scale()?).whole().clone(); batch];
    let target = Target::new(baseline, &lengths, &goals, LossDivisor::Frame, [1.0; 4]);
    let leaf = (joints * 0.9).autodiff().require_grad();
    let loss = target.loss(features.measure(leaf.clone())).sum();
    let gradient = leaf
        .grad_remove(&mut loss.backward())
        .expect("the loss depends on the joints");
    actual.insert("out.laban_grad", Actual::of(gradient, SEVERAL));
    Ok(())
}
