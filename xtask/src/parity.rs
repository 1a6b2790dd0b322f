//! lamogen against golden cases of a PyTorch reference.
//!
//! A case is a folder with `config.json`, `latest.tar`, `mean.npy`, `std.npy` and
//! `case.safetensors`; the last holds inputs (`in.*`) and what the reference computes from them
//! (`out.*`). docs/parity.md says what each of them is.

use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use burn::tensor::{Device, Int, Tensor, TensorData};
use lamogen_guide::{Batch, Guidance, Sampler, Schedule, Step};
use lamogen_laban::{Divisor, LabanFeatures, LabanOptions, Scale, Smoothing, Target};
use lamogen_model::{
    Checkpoint, CheckpointError, ConfigError, Denoiser, DenoiserInput, FrameMask, ModelConfig,
    MotionDiffuse,
};
use lamogen_motion::{Normalization, NormalizationError, joints};
use safetensors::SafeTensors;
use safetensors::tensor::{Dtype, TensorView};

/// Outputs of the network, of the joints and of the Laban features.
const SINGLE: f64 = 1e-5;
/// Gradients, and what ten or more steps add up to.
const SEVERAL: f64 = 1e-4;
/// Everything behind Adam, whose first steps turn on the sign of a gradient.
const GUIDED: f64 = 2e-3;
/// Numbers of 64 bits.
const EXACT: f64 = 1e-12;

/// One expected value beside what lamogen computes.
#[derive(Clone, Debug)]
pub struct Row {
    /// Its name in the case, such as `out.eps`.
    pub name: String,
    /// Error and tolerance; `None` where lamogen does not compute it yet.
    pub result: Option<Comparison>,
}

/// How far a value is from the expected one.
#[derive(Clone, Copy, Debug)]
pub struct Comparison {
    /// The largest absolute error over the largest absolute value; infinite where shapes differ or
    /// a number is not finite.
    pub error: f64,
    /// The largest error that passes.
    pub tolerance: f64,
}

impl Comparison {
    /// Whether the value is close enough.
    pub fn passes(&self) -> bool {
        self.error <= self.tolerance
    }
}

/// Why a case cannot be run.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)]
pub enum ParityError {
    #[error("{path}: {source}")]
    Io {
        path: PathBuf,
        source: std::io::Error,
    },
    #[error("{path}: {problem}")]
    Case { path: PathBuf, problem: String },
    #[error(transparent)]
    Config(#[from] ConfigError),
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    #[error(transparent)]
    Normalization(#[from] NormalizationError),
    #[error(transparent)]
    Guide(#[from] lamogen_guide::GuideError),
    #[error("in.scale: {0}")]
    Scale(#[from] lamogen_laban::ScaleError),
}

/// Runs a case and compares every `out.*`, in the order of their names.
///
/// # Errors
///
/// If a file of the case is missing or damaged, or an input is not there.
pub fn run(folder: &Path, device: &Device) -> Result<Vec<Row>, ParityError> {
    let path = folder.join("case.safetensors");
    let bytes = std::fs::read(&path).map_err(|source| ParityError::Io {
        path: path.clone(),
        source,
    })?;
    let tensors = SafeTensors::deserialize(&bytes).map_err(|error| ParityError::Case {
        path: path.clone(),
        problem: error.to_string(),
    })?;
    let case = Case {
        path,
        tensors,
        device: device.clone(),
    };
    let actual = compute(folder, &case)?;
    let mut names = case.tensors.names();
    names.retain(|name| name.starts_with("out."));
    names.sort_unstable();
    names
        .into_iter()
        .map(|name| {
            let result = match actual.get(name) {
                None => None,
                Some(actual) => Some(actual.compare(&case.view(name)?)),
            };
            Ok(Row {
                name: name.to_owned(),
                result,
            })
        })
        .collect()
}

/// What lamogen computes from the inputs of a case.
fn compute(folder: &Path, case: &Case) -> Result<BTreeMap<&'static str, Actual>, ParityError> {
    let device = &case.device;
    let config = ModelConfig::from_file(folder.join("config.json"))?;
    let model = Checkpoint::open(folder.join("latest.tar"))?.load(&config, device)?;
    let normalization = Normalization::from_files(
        folder.join("mean.npy"),
        folder.join("std.npy"),
        config.input_feats,
        device,
    )?;
    let mut actual = BTreeMap::new();
    schedule(case, &mut actual)?;
    network(case, &model, &normalization, &mut actual)?;
    laban(case, &mut actual)?;
    passes(case, &model, &normalization, &mut actual)?;
    Ok(actual)
}

type Values = BTreeMap<&'static str, Actual>;

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

/// Text encoder, one evaluation, and joints.
fn network(
    case: &Case,
    model: &MotionDiffuse,
    normalization: &Normalization,
    actual: &mut Values,
) -> Result<(), ParityError> {
    let (x_t, lengths) = (case.tensor::<3>("in.x_t")?, case.lengths()?);
    let (e, text) = model.encode_text(case.tokens()?);
    actual.insert("out.e", Actual::of(e, SINGLE));
    actual.insert("out.text", Actual::of(text, SINGLE));

    let prompt = model.encode(case.tokens()?);
    let timesteps: Vec<usize> = case.integers("in.t")?;
    let input = DenoiserInput {
        x_t: x_t.clone(),
        time: model.embed_timesteps(&timesteps),
        embedding: prompt.embedding,
        mask: FrameMask::new(&lengths, x_t.dims()[1], &case.device),
    };
    let eps = model.denoise(input, &prompt.context);
    actual.insert("out.eps", Actual::of(eps, SINGLE));

    let positions = joints(normalization.denormalize(x_t));
    actual.insert("out.joints", Actual::of(positions, SINGLE));
    Ok(())
}

/// Laban features of given joints, and the gradient of the loss.
fn laban(case: &Case, actual: &mut Values) -> Result<(), ParityError> {
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

    let scales = vec![case.scale()?; batch];
    let target = Target::new(baseline, &lengths, &scales, Divisor::Frame, 1.0);
    let leaf = (joints * 0.9).autodiff().require_grad();
    let loss = target.loss(features.measure(leaf.clone())).sum();
    let gradient = leaf
        .grad_remove(&mut loss.backward())
        .expect("the loss depends on the joints");
    actual.insert("out.laban_grad", Actual::of(gradient, SEVERAL));
    Ok(())
}

/// Baseline and guided passes.
fn passes(
    case: &Case,
    model: &MotionDiffuse,
    normalization: &Normalization,
    actual: &mut Values,
) -> Result<(), ParityError> {
    let batch = Batch {
        prompt: model.encode(case.tokens()?),
        noise: case.tensor("in.z")?,
        lengths: case.lengths()?,
    };
    let size = batch.lengths.len();
    let scales = vec![case.scale()?; size];
    let sampler = Sampler::new(model, normalization, case.steps()?)?;
    let baseline = sampler.baseline(&batch, &mut ())?;
    actual.insert("out.baseline", Actual::of(baseline, SEVERAL));

    // The reference's baseline is the guided pass's input, so that an error shows where it arises.
    let baseline = case.tensor::<3>("out.baseline")?;

    let (mut gradient, mut embeddings) = (None, Vec::new());
    let mut record = |step: &Step<'_>| {
        gradient = gradient.take().or(step.gradient.cloned());
        embeddings.push(step.embedding.clone());
        ControlFlow::Continue(())
    };
    let guided = sampler.guided(
        &batch,
        baseline.clone(),
        &scales,
        &Guidance::paper(),
        &mut record,
    )?;
    actual.insert("out.guided", Actual::of(guided.motion, GUIDED));
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

    let guidance = Guidance::fast();
    let guided = sampler.guided(&batch, baseline, &scales, &guidance, &mut ())?;
    actual.insert("out.guided_mean", Actual::of(guided.motion, GUIDED));
    Ok(())
}

/// The file of inputs and expected values.
struct Case<'a> {
    path: PathBuf,
    tensors: SafeTensors<'a>,
    device: Device,
}

impl Case<'_> {
    fn problem(&self, problem: String) -> ParityError {
        ParityError::Case {
            path: self.path.clone(),
            problem,
        }
    }

    fn view(&self, name: &str) -> Result<TensorView<'_>, ParityError> {
        self.tensors
            .tensor(name)
            .map_err(|_| self.problem(format!("{name} is missing")))
    }

    fn tensor<const D: usize>(&self, name: &str) -> Result<Tensor<D>, ParityError> {
        let view = self.view(name)?;
        if view.shape().len() != D {
            let shape = view.shape();
            return Err(self.problem(format!("expected {D} axes of {name}, found {shape:?}")));
        }
        let values: Vec<f32> = numbers(&view).map(|x| x as f32).collect();
        let data = TensorData::new(values, view.shape().to_vec());
        Ok(Tensor::from_data(data, &self.device))
    }

    fn integers(&self, name: &str) -> Result<Vec<usize>, ParityError> {
        Ok(numbers(&self.view(name)?).map(|x| x as usize).collect())
    }

    fn tokens(&self) -> Result<Tensor<2, Int>, ParityError> {
        let view = self.view("in.tokens")?;
        let ids: Vec<i32> = numbers(&view).map(|x| x as i32).collect();
        let data = TensorData::new(ids, view.shape().to_vec());
        Ok(Tensor::from_data(data, &self.device))
    }

    fn lengths(&self) -> Result<Vec<usize>, ParityError> {
        self.integers("in.lengths")
    }

    fn steps(&self) -> Result<usize, ParityError> {
        Ok(self.integers("out.timesteps")?.len())
    }

    fn scale(&self) -> Result<Scale, ParityError> {
        let factors: Vec<f32> = numbers(&self.view("in.scale")?).map(|x| x as f32).collect();
        let factors = factors.try_into().map_err(|found| {
            self.problem(format!("expected 4 values of in.scale, found {found:?}"))
        })?;
        Ok(Scale::new(factors)?)
    }
}

/// A computed value and how close it must be.
struct Actual {
    values: Vec<f64>,
    shape: Vec<usize>,
    tolerance: f64,
}

impl Actual {
    fn new(values: Vec<f64>, shape: Vec<usize>, tolerance: f64) -> Self {
        Actual {
            values,
            shape,
            tolerance,
        }
    }

    fn of<const D: usize>(tensor: Tensor<D>, tolerance: f64) -> Self {
        let shape = tensor.dims().to_vec();
        let data = tensor.into_data().convert::<f32>();
        let values = data.iter::<f64>().collect();
        Actual::new(values, shape, tolerance)
    }

    fn compare(&self, expected: &TensorView<'_>) -> Comparison {
        let error = if self.shape == expected.shape() {
            let pairs = self.values.iter().zip(numbers(expected));
            let (error, largest) = pairs.fold((0.0f64, 0.0f64), |(error, largest), (a, b)| {
                let difference = (a - b).abs();
                // NaN must not slip through a maximum.
                let difference = match difference.is_finite() {
                    true => difference,
                    false => f64::INFINITY,
                };
                (error.max(difference), largest.max(b.abs()))
            });
            match error == 0.0 {
                true => 0.0,
                false => error / largest,
            }
        } else {
            f64::INFINITY
        };
        Comparison {
            error,
            tolerance: self.tolerance,
        }
    }
}

/// The numbers of a stored tensor, whichever of the case's types they are.
fn numbers<'v>(view: &TensorView<'v>) -> Box<dyn Iterator<Item = f64> + 'v> {
    let data = view.data();
    match view.dtype() {
        Dtype::F32 => Box::new(
            data.as_chunks()
                .0
                .iter()
                .map(|&bytes| f64::from(f32::from_le_bytes(bytes))),
        ),
        Dtype::F64 => Box::new(
            data.as_chunks()
                .0
                .iter()
                .map(|&bytes| f64::from_le_bytes(bytes)),
        ),
        Dtype::I64 => Box::new(
            data.as_chunks()
                .0
                .iter()
                .map(|&bytes| i64::from_le_bytes(bytes) as f64),
        ),
        // Comparing with nothing fails on its shape.
        _ => Box::new(std::iter::empty()),
    }
}
