//! How strongly motions follow the sentence.

use lamogen_model::NoiseSchedule;

use crate::error::GuideError;

/// The scale of [classifier-free guidance](crate::ClassifierFree), at every step with a timestep of at least
/// [`until`](Self::until).
///
/// What a motion does is decided while there is much noise. At timesteps below `until` the network's prediction is used as it
/// is, for half of the cost ("guidance interval", Kynkäänniemi et al. 2024, arXiv 2404.07724).
///
/// The scale is not part of the paper.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TextScale {
    /// The scale. At 1 the network's prediction is used as it is.
    pub scale: f64,
    /// The smallest timestep whose prediction is scaled.
    pub until: usize,
}

impl Default for TextScale {
    /// Returns a scale of 1.
    fn default() -> Self {
        TextScale::from(1.0)
    }
}

impl From<f64> for TextScale {
    /// Returns a scale at all timesteps.
    fn from(scale: f64) -> Self {
        TextScale { scale, until: 0 }
    }
}

impl TextScale {
    /// Returns the scale with other numbers, where there are any.
    pub fn with(self, scale: Option<f64>, until: Option<usize>) -> Self {
        TextScale {
            scale: scale.unwrap_or(self.scale),
            until: until.unwrap_or(self.until),
        }
    }

    /// Checks that the numbers are valid for a network with this noise schedule.
    ///
    /// # Errors
    ///
    /// If the scale is not finite or below 0, or if the network has no timestep that would be scaled.
    pub fn check(&self, schedule: NoiseSchedule) -> Result<(), GuideError> {
        let TextScale { scale, until } = *self;
        if !(scale.is_finite() && scale >= 0.0) {
            return Err(GuideError::Guidance(format!(
                "expected a finite text scale of at least 0, found {scale}"
            )));
        }
        let timesteps = schedule.timesteps();
        if until >= timesteps {
            return Err(GuideError::Guidance(format!(
                "expected a text scale until a timestep below {timesteps}, the number of the network's timesteps, found {until}"
            )));
        }
        Ok(())
    }
}
