//! Comparison of lamogen with golden cases of a PyTorch reference.
//!
//! A case is a folder with `config.json`, `latest.tar`, `mean.npy`, `std.npy` and
//! `case.safetensors`. The last file holds inputs (`in.*`) and the values that the reference computes from them
//! (`out.*`). docs/parity.md describes each of them.

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

/// The tolerance of single operations: outputs of the network, joints and Laban features.
const SINGLE_TOLERANCE: f64 = 1e-5;
/// The tolerance of gradients, and of results of ten or more steps.
const ACCUMULATED_TOLERANCE: f64 = 1e-4;
/// The tolerance of everything that is computed after a step of Adam.
const GUIDED_TOLERANCE: f64 = 2e-3;
/// The tolerance of numbers that are computed in 64 bits.
const EXACT_TOLERANCE: f64 = 1e-12;

/// The comparison of one expected value with the value that lamogen computes.
#[derive(Clone, Debug)]
pub struct Row {
    /// The name of the value in the case, such as `out.eps`.
    pub name: String,
    /// The error and the tolerance; `None` if lamogen does not compute the value yet.
    pub result: Option<Comparison>,
}

/// The difference of a value from the expected one.
#[derive(Clone, Copy, Debug)]
pub struct Comparison {
    /// The largest absolute error divided by the largest absolute value. It is infinite if the shapes differ or a number is not
    /// finite.
    pub error: f64,
    /// The largest accepted error.
    pub tolerance: f64,
    /// The error that rounding alone can cause. It is only measured if the error is above the tolerance and the value is a result of
    /// a pass.
    pub rounding: Option<f64>,
}

impl Comparison {
    /// Returns whether the error is within the tolerance.
    pub fn is_within_tolerance(&self) -> bool {
        self.error <= self.tolerance
    }

    /// Returns whether the error is within the error that rounding alone can cause, even if it is above the tolerance.
    ///
    /// Some cases magnify rounding beyond any tolerance, such as random weights that predict noise: the first predicted motion is 60
    /// times too large and spins. In such a case, two correct programs differ by more than the tolerance, and so does the reference
    /// on two different CPUs.
    pub fn is_within_rounding(&self) -> bool {
        self.rounding.is_some_and(|rounding| self.error <= rounding)
    }
}

/// The error of a case that cannot be run.
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

/// Runs a case and compares every `out.*`, in the order of the names. `observer` sees every step.
///
/// # Errors
///
/// If a file of the case is missing or damaged, or an input is missing.
pub fn run(
    folder: &Path,
    device: &Device,
    observer: StepObserver<'_>,
) -> Result<Vec<Row>, ParityError> {
    let bytes = read(&folder.join("case.safetensors"))?;
    let case = Case::new(folder.join("case.safetensors"), &bytes, device)?;
    let network = Network::load(folder, &case)?;
    let actual = network.compute(&case, observer)?;
    let mut rows = compare(&case, &actual)?;
    network.measure_rounding(&case, &actual, &mut rows, observer)?;

    let path = folder.join("options.safetensors");
    if path.exists() {
        let bytes = read(&path)?;
        let expected = Case::new(path, &bytes, device)?;
        rows.extend(compare(&expected, &network.options(&case)?)?);
    }
    Ok(rows)
}

/// Reads a file.
fn read(path: &Path) -> Result<Vec<u8>, ParityError> {
    std::fs::read(path).map_err(|reason| ParityError::Io {
        path: path.to_owned(),
        reason,
    })
}

/// Compares every value that a file expects with the computed one.
fn compare(expected: &Case, computed: &ComputedValues) -> Result<Vec<Row>, ParityError> {
    let row = |name: &str| {
        let result = match computed.get(name) {
            None => None,
            Some(value) => Some(value.compare(&expected.view(name)?)),
        };
        Ok(Row {
            name: name.to_owned(),
            result,
        })
    };
    expected.expected_names().into_iter().map(row).collect()
}

/// The computed values by their names in the case.
type ComputedValues = BTreeMap<&'static str, ComputedValue>;

/// An observer of every step of every pass, to show progress: a full-size case takes minutes.
type StepObserver<'a> = &'a mut dyn FnMut(&Step<'_>);

/// A computed value and its tolerance.
struct ComputedValue {
    values: Vec<f64>,
    shape: Vec<usize>,
    tolerance: f64,
    /// The length of each motion in frames, if the value is motions. Frames beyond it are padding and not compared.
    lengths: Option<Vec<usize>>,
}

impl ComputedValue {
    /// Creates a value that is compared as a whole.
    fn new(values: Vec<f64>, shape: Vec<usize>, tolerance: f64) -> Self {
        ComputedValue {
            values,
            shape,
            tolerance,
            lengths: None,
        }
    }

    /// Reads motions `[batch, frames, features]`, of which only the frames within their lengths are compared.
    fn of_motions(tensor: Tensor<3>, lengths: &[usize], tolerance: f64) -> Self {
        ComputedValue {
            lengths: Some(lengths.to_vec()),
            ..ComputedValue::of(tensor, tolerance)
        }
    }

    /// Reads a tensor that is compared as a whole.
    fn of<const D: usize>(tensor: Tensor<D>, tolerance: f64) -> Self {
        let shape = tensor.dims().to_vec();
        let data = tensor.into_data().convert::<f32>();
        let values = data.iter::<f64>().collect();
        ComputedValue::new(values, shape, tolerance)
    }

    /// Compares the value with the expected one.
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

    /// Returns whether the number at an index is compared: it is not if it belongs to padding.
    fn is_compared(&self, index: usize) -> bool {
        match (&self.lengths, &*self.shape) {
            (Some(lengths), &[_, frames, features]) => {
                index / features % frames < lengths[index / features / frames]
            }
            _ => true,
        }
    }

    /// Computes the largest absolute error divided by the largest absolute expected value.
    fn distance(&self, expected: impl Iterator<Item = f64>) -> f64 {
        let pairs = self.values.iter().zip(expected).enumerate();
        let pairs = pairs.filter(|(index, _)| self.is_compared(*index));
        let (error, largest) = pairs.fold((0.0f64, 0.0f64), |(error, largest), (_, (a, b))| {
            // A maximum would ignore NaN.
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
