//! The mean and standard deviation by which a network's features are normalised.

use std::path::{Path, PathBuf};

use burn::tensor::{Device, Tensor};

use crate::features::FeatureGroup;
use crate::npy::{self, Array, NpyError};

/// The mean and standard deviation of every pose feature over a training set.
#[derive(Clone, Debug)]
pub struct Normalization {
    mean: Tensor<1>,
    std: Tensor<1>,
}

/// Why a mean or standard deviation is rejected.
#[derive(Debug, thiserror::Error)]
pub enum NormalizationError {
    /// A file cannot be read.
    #[error(transparent)]
    File(#[from] NpyError),
    /// An array has another number of features than expected.
    #[error("{path}: expected {expected} values in one row, found the shape {found:?}")]
    #[allow(missing_docs)]
    Shape {
        path: PathBuf,
        expected: usize,
        found: Vec<usize>,
    },
    /// A value cannot be a mean or a standard deviation.
    #[error("{path}: expected {expected} for feature {feature}{group}, found {found}")]
    #[allow(missing_docs)]
    Value {
        path: PathBuf,
        expected: &'static str,
        feature: usize,
        group: String,
        found: f32,
    },
}

impl Normalization {
    /// Reads `mean.npy` and `std.npy` as HumanML3D and MotionDiffuse store them.
    ///
    /// # Errors
    ///
    /// If a file cannot be read, does not hold `features` values, or holds a value that is not
    /// finite or a standard deviation that is not above 0.
    pub fn from_files(
        mean: impl AsRef<Path>,
        std: impl AsRef<Path>,
        features: usize,
        device: &Device,
    ) -> Result<Self, NormalizationError> {
        let (mean, std) = (mean.as_ref(), std.as_ref());
        Self::from_arrays(
            (npy::read(mean)?, mean),
            (npy::read(std)?, std),
            features,
            device,
        )
    }

    /// As [`from_files`](Self::from_files), for files whose bytes are in memory.
    ///
    /// # Errors
    ///
    /// As [`from_files`](Self::from_files).
    pub fn from_bytes(
        mean: &[u8],
        std: &[u8],
        features: usize,
        device: &Device,
    ) -> Result<Self, NormalizationError> {
        let (mean_name, std_name) = (Path::new("mean.npy"), Path::new("std.npy"));
        Self::from_arrays(
            (npy::read_bytes(mean, mean_name)?, mean_name),
            (npy::read_bytes(std, std_name)?, std_name),
            features,
            device,
        )
    }

    /// As [`from_files`](Self::from_files), for numbers that are in memory, one for each feature.
    ///
    /// # Errors
    ///
    /// If there are not as many standard deviations as means, a value is not finite, or a standard deviation is not
    /// above 0. The error names `mean` or `std` instead of a file.
    pub fn from_slices(
        mean: &[f32],
        std: &[f32],
        device: &Device,
    ) -> Result<Self, NormalizationError> {
        let array = |values: &[f32]| Array {
            values: values.to_vec(),
            shape: vec![values.len()],
            is_integer: false,
        };
        Self::from_arrays(
            (array(mean), Path::new("mean")),
            (array(std), Path::new("std")),
            mean.len(),
            device,
        )
    }

    /// Checks both arrays; each path stands in error messages.
    fn from_arrays(
        mean: (Array, &Path),
        std: (Array, &Path),
        features: usize,
        device: &Device,
    ) -> Result<Self, NormalizationError> {
        let mean = checked_values(mean, features, "a finite mean", f32::is_finite)?;
        let std = checked_values(std, features, "a standard deviation above 0", |x| {
            x.is_finite() && x > 0.0
        })?;
        Ok(Normalization {
            mean: Tensor::from_data(mean.as_slice(), device),
            std: Tensor::from_data(std.as_slice(), device),
        })
    }

    /// Returns the number of features.
    pub fn features(&self) -> usize {
        self.mean.dims()[0]
    }

    /// Returns the mean and the standard deviation of every feature, in this order.
    pub fn values(&self) -> [Vec<f32>; 2] {
        [&self.mean, &self.std].map(|row| {
            let values = row.clone().try_into_vec_as();
            values.expect("floats convert to f32")
        })
    }

    /// Normalises features `[batch, frames, features]`: `(x - mean) / std`.
    pub fn normalize(&self, features: Tensor<3>) -> Tensor<3> {
        (features - self.mean.clone().unsqueeze()) / self.std.clone().unsqueeze()
    }

    /// Undoes the normalisation of features `[batch, frames, features]`: `x * std + mean`. Differentiable.
    pub fn denormalize(&self, normalized: Tensor<3>) -> Tensor<3> {
        normalized * self.std.clone().unsqueeze() + self.mean.clone().unsqueeze()
    }
}

/// Returns the values of an array if there are as many as `features` and all are valid; `expected` says in the error
/// what a valid value is.
fn checked_values(
    (array, path): (Array, &Path),
    features: usize,
    expected: &'static str,
    valid: impl Fn(f32) -> bool,
) -> Result<Vec<f32>, NormalizationError> {
    let longest = array.shape.iter().copied().max().unwrap_or(0);
    if array.values.len() != features || longest != features {
        return Err(NormalizationError::Shape {
            path: path.to_owned(),
            expected: features,
            found: array.shape,
        });
    }
    match array.values.iter().position(|&value| !valid(value)) {
        None => Ok(array.values),
        Some(feature) => Err(NormalizationError::Value {
            path: path.to_owned(),
            expected,
            feature,
            group: FeatureGroup::of(feature)
                .map(|group| format!(" ({})", group.name()))
                .unwrap_or_default(),
            found: array.values[feature],
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::features::POSE_FEATURES;

    fn load(mean: &[f32], std: &[f32]) -> Result<Normalization, NormalizationError> {
        let folder = tempfile::tempdir().unwrap();
        let (mean_path, std_path) = (
            folder.path().join("mean.npy"),
            folder.path().join("std.npy"),
        );
        npy::write(&mean_path, mean, &[mean.len()]).unwrap();
        npy::write(&std_path, std, &[std.len()]).unwrap();
        Normalization::from_files(mean_path, std_path, POSE_FEATURES, &Device::flex())
    }

    #[test]
    fn denormalising_undoes_normalising() {
        let mean: Vec<f32> = (0..POSE_FEATURES).map(|i| i as f32 * 0.01).collect();
        let std: Vec<f32> = (0..POSE_FEATURES).map(|i| 0.1 + i as f32 * 0.001).collect();
        let normalization = load(&mean, &std).unwrap();
        let features = Tensor::<3>::ones([2, 3, POSE_FEATURES], &Device::flex());
        let back = normalization.denormalize(normalization.normalize(features.clone()));
        assert!((back - features).abs().max().into_scalar::<f32>() < 1e-5);
    }

    #[test]
    fn numbers_in_memory_are_checked_as_files_are() {
        let normalization = Normalization::from_slices(&[1.0], &[2.0], &Device::flex()).unwrap();
        let features = Tensor::<3>::ones([1, 1, 1], &Device::flex()) * 5.0;
        let normalized = normalization.normalize(features);
        assert_eq!(normalized.into_scalar::<f32>(), 2.0);
        assert_eq!(normalization.values(), [[1.0], [2.0]]);
        for (mean, std, part) in [
            (&[0.0; 2][..], &[1.0][..], "std"),
            (&[0.0], &[0.0], "above 0"),
        ] {
            let error = Normalization::from_slices(mean, std, &Device::flex()).unwrap_err();
            assert!(error.to_string().contains(part), "{error}");
        }
    }

    #[test]
    fn another_length_is_an_error() {
        let message = load(&[0.0; 251], &[1.0; POSE_FEATURES])
            .unwrap_err()
            .to_string();
        assert!(
            message.contains("mean.npy") && message.contains("263") && message.contains("251"),
            "{message}"
        );
    }

    #[test]
    fn a_zero_or_nan_is_named_with_its_feature() {
        for (feature, value, name) in [(0, 0.0, "root yaw"), (70, f32::NAN, "rotations")] {
            let mut std = [1.0; POSE_FEATURES];
            std[feature] = value;
            let message = load(&[0.0; POSE_FEATURES], &std).unwrap_err().to_string();
            assert!(
                message.contains("std.npy")
                    && message.contains(&format!("feature {feature}"))
                    && message.contains(name),
                "{message}"
            );
        }
        let mut mean = [0.0; POSE_FEATURES];
        mean[3] = f32::INFINITY;
        let message = load(&mean, &[1.0; POSE_FEATURES]).unwrap_err().to_string();
        assert!(
            message.contains("mean.npy") && message.contains("root height"),
            "{message}"
        );
    }
}
