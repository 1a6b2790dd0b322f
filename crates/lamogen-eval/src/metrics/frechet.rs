//! The Fréchet distance between two sets of embeddings (FID).

use faer::linalg::solvers::{SelfAdjointEigen, Svd};
use faer::{Mat, Side};

use super::{Embeddings, MetricError};

/// The mean and the covariance of a set of embeddings.
#[derive(Clone, Debug)]
pub struct Gaussian {
    mean: Vec<f64>,
    covariance: Mat<f64>,
}

impl Gaussian {
    /// Computes mean and covariance of a set. Covariances are divided by the number of embeddings less one, as in
    /// `numpy.cov`.
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

    /// Computes the squared Fréchet distance: `|m - m'|² + tr(S + S' - 2 (S S')^½)`.
    ///
    /// The trace of the root is computed as the sum of the singular values of `S^½ S'^½`. This needs no root of a matrix
    /// that is not symmetric, and is exact for singular covariances, too, such as those of fewer embeddings than their
    /// width.
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
        let squared_distance: f64 = means.map(|(a, b)| (a - b) * (a - b)).sum();
        let product = square_root(&self.covariance) * square_root(&other.covariance);
        let values = Svd::new(product.as_ref()).expect("finite matrices have singular values");
        let root_trace: f64 = values.S().column_vector().iter().sum();
        let distance = squared_distance + trace(&self.covariance) + trace(&other.covariance)
            - 2.0 * root_trace;
        // Rounding may give equal sets a distance slightly below 0.
        Ok(distance.max(0.0))
    }
}

/// Returns the symmetric square root of a covariance.
fn square_root(covariance: &Mat<f64>) -> Mat<f64> {
    let eigen = SelfAdjointEigen::new(covariance.as_ref(), Side::Lower)
        .expect("finite symmetric matrices have eigenvalues");
    let vectors = eigen.U();
    let values = eigen.S().column_vector();
    // Eigenvalues within rounding of 0 count as 0, because their roots would be larger by orders of magnitude.
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

/// Computes the squared Fréchet distance between two sets of embeddings (Heusel et al. 2017, "FID"). 0 is best.
///
/// The distance depends on the number of embeddings, so compare only distances of sets of the same sizes. To compare
/// many sets with one set, compute the [`Gaussian`] of that set once.
///
/// # Errors
///
/// If the widths differ, or a set has fewer than two embeddings.
pub fn fid(a: &Embeddings, b: &Embeddings) -> Result<f64, MetricError> {
    Gaussian::of(a)?.distance(&Gaussian::of(b)?)
}
