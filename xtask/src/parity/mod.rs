//! lamogen against golden cases of a PyTorch reference.
//!
//! A case is a folder with `config.json`, `latest.tar`, `mean.npy`, `std.npy` and
//! `case.safetensors`; the last holds inputs (`in.*`) and what the reference computes from them
//! (`out.*`). docs/parity.md says what each of them is.

mod case;
mod network;
mod options;
mod short;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use burn::tensor::{Device, Tensor};
use lamogen_guide::{GuideError, Step};
use lamogen_laban::ScaleError;
use lamogen_model::{CheckpointError, ConfigError};
use lamogen_motion::NormalizationError;
use safetensors::tensor::TensorView;

use case::{Case, numbers};
use network::Network;
pub use short::{Distance, Short, short};

/// Outputs of the network, of the joints and of the Laban features.
const SINGLE: f64 = 1e-5;
/// Gradients, and what ten or more steps add up to.
const SEVERAL: f64 = 1e-4;
/// Everything behind Adam.
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
    /// How far rounding alone moves the value, measured where the error is above the tolerance and
    /// the value is behind a pass.
    pub rounding: Option<f64>,
}

impl Comparison {
    /// Whether the error is within the tolerance.
    pub fn is_within_tolerance(&self) -> bool {
        self.error <= self.tolerance
    }

    /// Whether the error is beyond the tolerance, but within what rounding alone does.
    ///
    /// Some cases magnify rounding beyond any tolerance (random weights that predict noise: the
    /// first predicted motion is 60 times too large and spins). There two correct programs differ
    /// by more than the tolerance, and so does the reference from itself on another CPU.
    pub fn is_within_rounding(&self) -> bool {
        self.rounding.is_some_and(|rounding| self.error <= rounding)
    }
}

/// Why a case cannot be run.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)]
pub enum ParityError {
    #[error("{path}: {reason}")]
    Io {
        path: PathBuf,
        reason: std::io::Error,
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
    Guide(#[from] GuideError),
    #[error("in.scale: {0}")]
    Scale(#[from] ScaleError),
}

/// Runs a case and compares every `out.*`, in the order of their names. `watch` sees every step.
///
/// # Errors
///
/// If a file of the case is missing or damaged, or an input is not there.
pub fn run(folder: &Path, device: &Device, watch: Watch<'_>) -> Result<Vec<Row>, ParityError> {
    let bytes = read(&folder.join("case.safetensors"))?;
    let case = Case::new(folder.join("case.safetensors"), &bytes, device)?;
    let network = Network::load(folder, &case)?;
    let actual = network.compute(&case, watch)?;
    let mut rows = compare(&case, &actual)?;
    network.measure_rounding(&case, &actual, &mut rows, watch)?;

    let path = folder.join("options.safetensors");
    if path.exists() {
        let bytes = read(&path)?;
        let expected = Case::new(path, &bytes, device)?;
        rows.extend(compare(&expected, &network.options(&case)?)?);
    }
    Ok(rows)
}

fn read(path: &Path) -> Result<Vec<u8>, ParityError> {
    std::fs::read(path).map_err(|reason| ParityError::Io {
        path: path.to_owned(),
        reason,
    })
}

/// A row for every value that a file expects.
fn compare(expected: &Case, actual: &Values) -> Result<Vec<Row>, ParityError> {
    let row = |name: &str| {
        let result = match actual.get(name) {
            None => None,
            Some(actual) => Some(actual.compare(&expected.view(name)?)),
        };
        Ok(Row {
            name: name.to_owned(),
            result,
        })
    };
    expected.expected().into_iter().map(row).collect()
}

type Values = BTreeMap<&'static str, Actual>;

/// Sees every step of every pass; a full-size case takes minutes.
type Watch<'a> = &'a mut dyn FnMut(&Step<'_>);

/// A computed value and how close it must be.
struct Actual {
    values: Vec<f64>,
    shape: Vec<usize>,
    tolerance: f64,
    /// Frames of each motion, where the values are motions: what is past them has no meaning.
    lengths: Option<Vec<usize>>,
}

impl Actual {
    fn new(values: Vec<f64>, shape: Vec<usize>, tolerance: f64) -> Self {
        Actual {
            values,
            shape,
            tolerance,
            lengths: None,
        }
    }

    /// Motions `[batch, frames, features]`, of which only the frames within their lengths count.
    fn of_motions(tensor: Tensor<3>, lengths: &[usize], tolerance: f64) -> Self {
        Actual {
            lengths: Some(lengths.to_vec()),
            ..Actual::of(tensor, tolerance)
        }
    }

    fn of<const D: usize>(tensor: Tensor<D>, tolerance: f64) -> Self {
        let shape = tensor.dims().to_vec();
        let data = tensor.into_data().convert::<f32>();
        let values = data.iter::<f64>().collect();
        Actual::new(values, shape, tolerance)
    }

    fn compare(&self, expected: &TensorView<'_>) -> Comparison {
        Comparison {
            error: match self.shape == expected.shape() {
                true => self.distance(numbers(expected)),
                false => f64::INFINITY,
            },
            tolerance: self.tolerance,
            rounding: None,
        }
    }

    /// Whether the value at a place has a meaning.
    fn counts(&self, place: usize) -> bool {
        match (&self.lengths, &*self.shape) {
            (Some(lengths), &[_, frames, features]) => {
                place / features % frames < lengths[place / features / frames]
            }
            _ => true,
        }
    }

    /// The largest absolute error over the largest absolute value expected.
    fn distance(&self, expected: impl Iterator<Item = f64>) -> f64 {
        let pairs = self.values.iter().zip(expected).enumerate();
        let pairs = pairs.filter(|(place, _)| self.counts(*place));
        let (error, largest) = pairs.fold((0.0f64, 0.0f64), |(error, largest), (_, (a, b))| {
            // NaN must not slip through a maximum.
            let difference = match (a - b).abs() {
                difference if difference.is_finite() => difference,
                _ => f64::INFINITY,
            };
            (error.max(difference), largest.max(b.abs()))
        });
        match error == 0.0 {
            true => 0.0,
            false => error / largest,
        }
    }
}
