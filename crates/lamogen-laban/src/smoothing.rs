//! Options of Gaussian smoothing along time. Without smoothing, differences between frames are mostly noise.

/// The number of frames of the largest window: more than eight minutes.
const LARGEST: usize = 9_999;

/// A Gaussian window over frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GaussianKernel {
    size: usize,
    variance: f32,
}

/// The reason why a Gaussian window is invalid.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum GaussianKernelError {
    /// The window has no middle frame or is too large.
    #[error("the smoothing window must have an odd number of frames up to {LARGEST}, found {0}")]
    Size(usize),
    /// The variance is not a finite positive number.
    #[error("the variance of the smoothing must be finite and above 0, found {0}")]
    Variance(f32),
}

impl GaussianKernel {
    /// The window of the paper: 11 frames with a variance of 10 frames² (paper, section "Implementation Details").
    pub const PAPER: GaussianKernel = GaussianKernel {
        size: 11,
        variance: 10.0,
    };

    /// Creates a window of `size` frames, with a variance in frames².
    ///
    /// # Errors
    ///
    /// If the size is even (0 included) or above 9,999, or the variance is not finite and positive.
    pub fn new(size: usize, variance: f32) -> Result<GaussianKernel, GaussianKernelError> {
        if size.is_multiple_of(2) || size > LARGEST {
            return Err(GaussianKernelError::Size(size));
        }
        if !variance.is_finite() || variance <= 0.0 {
            return Err(GaussianKernelError::Variance(variance));
        }
        Ok(GaussianKernel { size, variance })
    }

    /// Returns the weights of the window. Their sum is 1.
    pub fn kernel(&self) -> Vec<f32> {
        let middle = (self.size / 2) as f32;
        let weights: Vec<f32> = (0..self.size)
            .map(|i| {
                let exponent = -(i as f32 - middle).powi(2) / (2.0 * self.variance);
                f64::from(exponent).exp() as f32
            })
            .collect();
        let sum: f32 = weights.iter().sum();
        weights.into_iter().map(|weight| weight / sum).collect()
    }
}

/// The place of smoothing in the computation of differences. Beyond the ends of a motion, the first
/// and the last frame repeat.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Smoothing {
    /// Nothing is smoothed.
    None,
    /// The positions are smoothed once (paper, appendix "Detailed LMA Quantification Formulas").
    Positions(GaussianKernel),
    /// Positions, velocity and acceleration are smoothed, each before its difference is taken (paper, section
    /// "Implementation Details").
    EachDifference(GaussianKernel),
}

impl Default for Smoothing {
    fn default() -> Self {
        Smoothing::Positions(GaussianKernel::PAPER)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_kernel_sums_to_one_and_is_even() {
        let kernel = GaussianKernel::PAPER.kernel();
        assert_eq!(kernel.len(), 11);
        assert!((kernel.iter().sum::<f32>() - 1.0).abs() < 1e-6);
        assert_eq!(kernel[0], kernel[10]);
        // The weights are exp(-25 / 20) and exp(0), divided by the same sum.
        assert!((kernel[0] / kernel[5] - (-1.25f32).exp()).abs() < 1e-6);
    }

    #[test]
    fn a_window_needs_a_middle_and_a_width() {
        assert_eq!(
            GaussianKernel::new(10, 1.0),
            Err(GaussianKernelError::Size(10))
        );
        assert_eq!(
            GaussianKernel::new(0, 1.0),
            Err(GaussianKernelError::Size(0))
        );
        let largest = usize::MAX;
        assert_eq!(
            GaussianKernel::new(largest, 1.0),
            Err(GaussianKernelError::Size(largest))
        );
        assert_eq!(
            GaussianKernel::new(3, 0.0),
            Err(GaussianKernelError::Variance(0.0))
        );
        assert!(GaussianKernel::new(3, f32::NAN).is_err());
    }
}
