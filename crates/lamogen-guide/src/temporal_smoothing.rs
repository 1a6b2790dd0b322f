//! Frames that agree with each other.

use burn::tensor::Device;
use lamogen_laban::{Gaussian, Window};

use crate::error::GuideError;

/// Smooths the predicted clean motion along time at every step, while there is much noise.
///
/// A small network sees little beyond a frame when most of it is noise: it decides for each frame alone where in a step
/// of a walk the legs are, and what is decided early stays. Smoothing the prediction with a Gaussian makes neighbours decide together, and
/// costs next to nothing. Below the last timestep that is smoothed the network is left alone, and brings the details back.
///
/// This is not part of the paper.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TemporalSmoothing {
    /// Standard deviation of the Gaussian, in frames.
    pub frames: f32,
    /// The last timestep that is smoothed; smaller ones are not.
    pub until: usize,
}

impl Default for TemporalSmoothing {
    /// One frame, at all timesteps but the last ones: what is best for the embedded model.
    fn default() -> Self {
        TemporalSmoothing {
            frames: 1.0,
            until: 20,
        }
    }
}

impl TemporalSmoothing {
    /// Whether the numbers make sense.
    ///
    /// # Errors
    ///
    /// If the deviation is not from 0.01 to 100 frames.
    pub fn check(&self) -> Result<(), GuideError> {
        match (0.01..=100.0).contains(&self.frames) {
            true => Ok(()),
            false => Err(GuideError::TemporalSmoothing { found: self.frames }),
        }
    }

    /// The window for motions of these lengths, padded to `frames`.
    pub(crate) fn window(&self, lengths: &[usize], frames: usize, device: &Device) -> Window {
        // Beyond three deviations there is nothing worth a sum.
        let reach = (3.0 * self.frames).ceil() as usize;
        let gaussian = Gaussian::new(2 * reach + 1, self.frames * self.frames);
        let gaussian = gaussian.expect("the numbers were checked");
        Window::new(&gaussian, frames, lengths.iter().copied(), device)
    }
}
