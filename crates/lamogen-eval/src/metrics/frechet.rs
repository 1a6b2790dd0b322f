//! How far two sets of motions are from each other as distributions.

use faer::linalg::solvers::{SelfAdjointEigen, Svd};
use faer::{Mat, Side};

use super::{Embeddings, MetricError};

/// Mean and covariance of a set of embeddings.
#[derive(Clone, Debug)]
pub struct Gaussian {
    mean: Vec<f64>,
    covariance: Mat<f64>,
}

impl Gaussian {
    /// Measures a set; covariances are divided by one less than its number, as by `numpy.cov`.
    ///
    /// # Errors
    ///
    /// If there are fewer than two embeddings.
    pub fn of(embeddings: &Embeddings) -> Result<Gaussian, MetricError> {
        let (count, width) = (embeddings.len(), embeddings.width());
        if count < 2 {
            return Err(MetricError::TooFew {
                metric: "FID",
                what: "embeddings in each set",
                needed: 2,
                found: count,
            });
        }
        let mut mean = vec![0.0; width];
        for row in embeddings.rows() {
            for (mean, &value) in mean.iter_mut().zip(row) {
                *mean += f64::from(value) / count as f64;
            }
        }
        let centred = Mat::from_fn(count, width, |row, column| {
            f64::from(embeddings.row(row)[column]) - mean[column]
        });
        let covariance = centred.transpose() * &centred * faer::Scale(1.0 / (count - 1) as f64);
        Ok(Gaussian { mean, covariance })
    }

    /// The Fréchet distance, squared: `|m - m'|² + tr(S + S' - 2 (S S')^½)`.
    ///
    /// The trace of the root is the sum of the singular values of `S^½ S'^½`, which needs no root of a matrix that is
    /// not symmetric, and stays exact for singular covariances, as of fewer embeddings than their width.
    ///
    /// # Errors
    ///
    /// If the widths differ.
    pub fn distance(&self, other: &Gaussian) -> Result<f64, MetricError> {
        if self.mean.len() != other.mean.len() {
            return Err(MetricError::Mismatch {
                what: "embeddings of a width",
                expected: self.mean.len(),
                found: other.mean.len(),
            });
        }
        let means = self.mean.iter().zip(&other.mean);
        let apart: f64 = means.map(|(a, b)| (a - b) * (a - b)).sum();
        let product = root(&self.covariance) * root(&other.covariance);
        let values = Svd::new(product.as_ref()).expect("finite matrices have singular values");
        let common: f64 = values.S().column_vector().iter().sum();
        let distance = apart + trace(&self.covariance) + trace(&other.covariance) - 2.0 * common;
        // Rounding may bring equal sets a little below.
        Ok(distance.max(0.0))
    }
}

/// The symmetric root of a covariance.
fn root(covariance: &Mat<f64>) -> Mat<f64> {
    let eigen = SelfAdjointEigen::new(covariance.as_ref(), Side::Lower)
        .expect("finite symmetric matrices have eigenvalues");
    let vectors = eigen.U();
    let values = eigen.S().column_vector();
    // What is within rounding of 0 is 0: its root would be larger by orders.
    let largest = values.iter().copied().fold(0.0, f64::max);
    let noise = largest * f64::EPSILON * covariance.nrows() as f64;
    let scaled = Mat::from_fn(
        vectors.nrows(),
        vectors.ncols(),
        |row, column| match values[column] {
            value if value > noise => vectors[(row, column)] * value.sqrt(),
            _ => 0.0,
        },
    );
    scaled * vectors.transpose()
}

fn trace(matrix: &Mat<f64>) -> f64 {
    (0..matrix.nrows()).map(|i| matrix[(i, i)]).sum()
}

/// The Fréchet distance between two sets of embeddings (Heusel et al. 2017, "FID"). 0 is best.
///
/// It depends on how many embeddings there are: compare sets of one size only. For many sets against one, keep the
/// [`Gaussian`] of that one.
///
/// # Errors
///
/// If the widths differ, or a set has fewer than two embeddings.
pub fn fid(a: &Embeddings, b: &Embeddings) -> Result<f64, MetricError> {
    Gaussian::of(a)?.distance(&Gaussian::of(b)?)
}
