//! The values that lamogen computes from the inputs of a case.

use std::ops::ControlFlow;
use std::path::Path;

use burn::tensor::{Tensor, TensorData};
use lamogen_guide::{Batch, Guidance, Sampler, Schedule, Step, noise};
use lamogen_laban::{Goals, LabanFeatures, LabanOptions, LabanTarget, LossDivisor, Smoothing};
use lamogen_model::{
    Checkpoint, CrossAttentionContext, Denoiser, DenoiserInput, FrameMask, ModelConfig,
    MotionDiffuse, Prompt,
};
use lamogen_motion::{Normalization, joints};

use super::case::Case;
use super::{
    ACCUMULATED_TOLERANCE, ComputedValue, ComputedValues, EXACT_TOLERANCE, GUIDED_TOLERANCE,
    ParityError, Row, SINGLE_TOLERANCE, StepObserver,
};

/// The values that accumulate the outputs of the network over the steps of a pass.
const PASS_RESULTS: [&str; 7] = [
    "out.classifier",
    "out.e_grad",
    "out.guided",
    "out.guided_mean",
    "out.raw_update",
    "out.trace_e",
    "out.trace_loss",
];

/// The number of runs that measure the effect of rounding.
const ROUNDING_RUNS: u64 = 8;

/// The network of a case, and the statistics of its features.
pub(super) struct Network {
    pub(super) model: MotionDiffuse,
    pub(super) normalization: Normalization,
}

impl Network {
    /// Loads the network and the statistics from the folder of a case.
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

    /// Computes all values from the inputs of a case.
    pub(super) fn compute(
        &self,
        case: &Case,
        observer: StepObserver<'_>,
    ) -> Result<ComputedValues, ParityError> {
        let prompt = self.model.encode(&case.tokens()?.into());
        let mut values = ComputedValues::new();
        schedule(case, &mut values)?;
        self.evaluate(case, &prompt, &mut values)?;
        laban(case, &mut values)?;
        let (noise, baseline) = (case.tensor("in.z")?, case.tensor("out.baseline")?);
        values.append(&mut self.passes(case, prompt, noise, baseline, observer)?);
        Ok(values)
    }

    /// Measures how far rounding alone moves the values that are beyond their tolerance, and stores it in their rows.
    ///
    /// The passes are repeated with random changes of their inputs. The start noise and the baselines change by their rounding, the
    /// embeddings by as much as those of lamogen and of the reference differ.
    pub(super) fn measure_rounding(
        &self,
        case: &Case,
        computed: &ComputedValues,
        rows: &mut [Row],
        observer: StepObserver<'_>,
    ) -> Result<(), ParityError> {
        let error_of = |name: &str| rows.iter().find(|row| row.name == name)?.result;
        let embedding_error = error_of("out.e").map_or(0.0, |result| result.error);
        let size = embedding_error.clamp(f64::from(f32::EPSILON), SINGLE_TOLERANCE);
        let is_off = |row: &Row| {
            row.result
                .is_some_and(|result| !result.is_within_tolerance())
        };
        let mut off: Vec<&mut Row> = rows
            .iter_mut()
            .filter(|row| is_off(row) && PASS_RESULTS.contains(&row.name.as_str()))
            .collect();
        if off.is_empty() {
            return Ok(());
        }
        let prompt = self.model.encode(&case.tokens()?.into());
        let [batch, width] = prompt.embedding.dims();
        let largest: f32 = prompt.embedding.clone().abs().max().into_scalar();
        for seed in 0..ROUNDING_RUNS {
            // Three standard deviations correspond to the largest difference.
            let changes: Vec<f32> = noise(seed, batch, width)
                .into_iter()
                .map(|x| x / 3.0 * largest * size as f32)
                .collect();
            let changes = TensorData::new(changes, [batch, width]);
            let changed_prompt = Prompt {
                embedding: prompt.embedding.clone() + Tensor::from_data(changes, &case.device),
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
            let values = self.passes(case, changed_prompt, start, baseline, observer)?;
            for row in &mut off {
                let name = row.name.as_str();
                let (Some(result), Some(original), Some(changed)) =
                    (&mut row.result, computed.get(name), values.get(name))
                else {
                    continue;
                };
                // Both programs round, so that their results may differ by twice as much.
                let distance = 2.0 * changed.distance(original.values.iter().copied());
                // A run with results that are not finite says nothing about rounding.
                if distance.is_finite() {
                    result.rounding = Some(result.rounding.unwrap_or(0.0).max(distance));
                }
            }
        }
        Ok(())
    }

    /// Creates the batch from which the passes of a case start.
    pub(super) fn batch(&self, case: &Case) -> Result<Batch<CrossAttentionContext>, ParityError> {
        Ok(Batch {
            prompt: self.model.encode(&case.tokens()?.into()),
            noise: case.tensor("in.z")?,
            lengths: case.lengths()?,
            step_noise: None,
            continuation: None,
            known: None,
        })
    }

    /// Computes the outputs of the text encoder, one evaluation of the network, and joints.
    pub(super) fn evaluate(
        &self,
        case: &Case,
        prompt: &Prompt<CrossAttentionContext>,
        values: &mut ComputedValues,
    ) -> Result<(), ParityError> {
        let (x_t, lengths) = (case.tensor::<3>("in.x_t")?, case.lengths()?);
        let (e, text) = self.model.encode_text(case.tokens()?);
        values.insert("out.e", ComputedValue::of(e, SINGLE_TOLERANCE));
        values.insert("out.text", ComputedValue::of(text, SINGLE_TOLERANCE));

        let timesteps: Vec<usize> = case.integers("in.t")?;
        let input = DenoiserInput {
            x_t: x_t.clone(),
            time: self.model.embed_timesteps(&timesteps),
            timesteps,
            embedding: prompt.embedding.clone(),
            modulation: None,
            mask: FrameMask::new(&lengths, x_t.dims()[1], &case.device),
        };
        let eps = self.model.denoise(input, &prompt.context);
        values.insert(
            "out.eps",
            ComputedValue::of_motions(eps, &lengths, SINGLE_TOLERANCE),
        );

        let positions = joints(self.normalization.denormalize(x_t));
        values.insert("out.joints", ComputedValue::of(positions, SINGLE_TOLERANCE));
        Ok(())
    }

    /// Runs the baseline pass and the guided passes. The guided passes begin with the `reference` baseline.
    fn passes(
        &self,
        case: &Case,
        prompt: Prompt<CrossAttentionContext>,
        noise: Tensor<3>,
        reference: Tensor<3>,
        observer: StepObserver<'_>,
    ) -> Result<ComputedValues, ParityError> {
        let mut values = ComputedValues::new();
        let batch = Batch {
            prompt,
            noise,
            lengths: case.lengths()?,
            step_noise: None,
            continuation: None,
            known: None,
        };
        let size = batch.lengths.len();
        let scales = vec![case.scale()?.into(); size];
        let sampler = Sampler::new(&self.model, &self.normalization, case.steps()?)?;
        let mut observe = |step: &Step<'_>| {
            observer(step);
            ControlFlow::Continue(())
        };
        let baseline = sampler.baseline(&batch, &mut observe)?;
        let motions =
            |motions, tolerance| ComputedValue::of_motions(motions, &batch.lengths, tolerance);
        values.insert("out.baseline", motions(baseline, ACCUMULATED_TOLERANCE));

        // The guided passes start from the baseline of the reference, so that an error of the baseline pass does not affect them.
        let baseline = reference;

        let (mut gradient, mut embeddings) = (None, Vec::new());
        let mut record = |step: &Step<'_>| {
            gradient = gradient.take().or(step.gradient.cloned());
            embeddings.push(step.embedding.clone());
            observe(step)
        };
        let guided = sampler.guided(
            &batch,
            baseline.clone(),
            &scales,
            &Guidance::paper(),
            &mut record,
        )?;
        values.insert("out.guided", motions(guided.motion, GUIDED_TOLERANCE));
        values.insert(
            "out.trace_e",
            ComputedValue::of(Tensor::stack::<3>(embeddings, 0), GUIDED_TOLERANCE),
        );
        let shape = vec![guided.loss.len(), size];
        let loss = guided.loss.into_iter().flatten().map(f64::from).collect();
        values.insert(
            "out.trace_loss",
            ComputedValue::new(loss, shape, GUIDED_TOLERANCE),
        );
        if let Some(gradient) = gradient {
            values.insert(
                "out.e_grad",
                ComputedValue::of(gradient, ACCUMULATED_TOLERANCE),
            );
        }

        for (name, guidance) in [
            ("out.guided_mean", Guidance::fast()),
            ("out.raw_update", Guidance::raw_frame_update()),
            ("out.classifier", Guidance::classifier()),
        ] {
            let baseline = baseline.clone();
            let guided = sampler.guided(&batch, baseline, &scales, &guidance, &mut observe)?;
            values.insert(name, motions(guided.motion, GUIDED_TOLERANCE));
        }
        Ok(values)
    }
}

/// Computes the timesteps and the noise schedule.
fn schedule(case: &Case, values: &mut ComputedValues) -> Result<(), ParityError> {
    let schedule = Schedule::linear();
    let timesteps = schedule.ddim(case.steps()?)?;
    let timesteps: Vec<f64> = timesteps.iter().map(|s| s.timestep as f64).collect();
    let shape = vec![timesteps.len()];
    values.insert(
        "out.timesteps",
        ComputedValue::new(timesteps, shape, EXACT_TOLERANCE),
    );
    let alphas_cumprod = schedule.alphas_cumprod().to_vec();
    let shape = vec![alphas_cumprod.len()];
    values.insert(
        "out.abar",
        ComputedValue::new(alphas_cumprod, shape, EXACT_TOLERANCE),
    );
    Ok(())
}

/// Computes the Laban features of the joints of a case, and the gradient of the loss.
pub(super) fn laban(case: &Case, values: &mut ComputedValues) -> Result<(), ParityError> {
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
    values.insert("out.laban_raw", ComputedValue::of(raw, SINGLE_TOLERANCE));

    let features = extractor(Smoothing::default());
    let baseline = features.measure(joints.clone());
    values.insert(
        "out.laban",
        ComputedValue::of(baseline.clone(), SINGLE_TOLERANCE),
    );

    let goals = vec![Goals::from(case.scale()?).whole().clone(); batch];
    let target = LabanTarget::new(baseline, &lengths, &goals, LossDivisor::Frame, [1.0; 4]);
    let leaf = (joints * 0.9).autodiff().require_grad();
    let loss = target.loss(features.measure(leaf.clone())).sum();
    let gradient = leaf
        .grad_remove(&mut loss.backward())
        .expect("the loss depends on the joints");
    values.insert(
        "out.laban_grad",
        ComputedValue::of(gradient, ACCUMULATED_TOLERANCE),
    );
    Ok(())
}
