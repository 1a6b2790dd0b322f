//! The smoothing of predicted motions along time.

use burn::tensor::Device;
use lamogen_laban::{GaussianKernel, SmoothingWindow};

use crate::error::GuideError;

/// Smooths the predicted clean motion along time at every step with a timestep of at least [`until`](Self::until).
///
/// At noisy timesteps a small network uses little information from neighbouring frames. It predicts the phase of a step
/// of a walk for each frame alone, and the early steps of a pass fix that phase. Smoothing the prediction with a
/// Gaussian makes neighbouring frames agree, at almost no cost. At timesteps below `until` predictions are not
/// smoothed, and the network restores the details.
///
/// Temporal smoothing is not part of the paper.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TemporalSmoothing {
    /// The standard deviation of the Gaussian in frames.
    pub frames: f32,
    /// The smallest timestep that is smoothed.
    pub until: usize,
}

impl Default for TemporalSmoothing {
    /// Returns a deviation of one frame at all timesteps but the last ones: the best values for the embedded model.
    fn default() -> Self {
        TemporalSmoothing {
            frames: 1.0,
            until: 20,
        }
    }
}

impl TemporalSmoothing {
    /// Checks that the numbers are valid.
    ///
    /// # Errors
    ///
    /// If the standard deviation is not from 0.01 to 100 frames.
    pub fn check(&self) -> Result<(), GuideError> {
        match (0.01..=100.0).contains(&self.frames) {
            true => Ok(()),
            false => Err(GuideError::TemporalSmoothing { found: self.frames }),
        }
    }

    /// Returns the window for motions of the given lengths, padded to `frames` frames. The ends of loops are neighbours.
    pub(crate) fn window(
        &self,
        lengths: &[usize],
        frames: usize,
        are_loops: bool,
        device: &Device,
    ) -> SmoothingWindow {
        // Weights beyond three standard deviations are negligible.
        let radius = (3.0 * self.frames).ceil() as usize;
        let gaussian = GaussianKernel::new(2 * radius + 1, self.frames * self.frames);
        let gaussian = gaussian.expect("the numbers were checked");
        let lengths = lengths.iter().copied();
        match are_loops {
            true => SmoothingWindow::cyclic(&gaussian, frames, lengths, device),
            false => SmoothingWindow::new(&gaussian, frames, lengths, device),
        }
    }
}
