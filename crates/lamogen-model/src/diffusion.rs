//! The diffusion process that a network was trained for.

use std::str::FromStr;

use serde::Serialize;

/// The schedule of the noise `β_t`, over the timesteps that the network was trained with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum NoiseSchedule {
    /// `β` rises evenly, from 1e-4 to 0.02 over 1000 timesteps, and `1000 / timesteps` times as much over fewer (Ho et al.
    /// 2020).
    Linear {
        /// The number of timesteps.
        timesteps: usize,
    },
    /// `ᾱ` falls like the square of a cosine (Nichol and Dhariwal 2021).
    Cosine {
        /// The number of timesteps.
        timesteps: usize,
    },
}

impl NoiseSchedule {
    /// Returns the number of timesteps.
    pub fn timesteps(self) -> usize {
        match self {
            NoiseSchedule::Linear { timesteps } | NoiseSchedule::Cosine { timesteps } => timesteps,
        }
    }
}

impl Default for NoiseSchedule {
    /// Returns MotionDiffuse's schedule: linear over 1000 timesteps.
    fn default() -> Self {
        NoiseSchedule::Linear { timesteps: 1000 }
    }
}

/// How a step of sampling goes from a noisy motion and the predicted clean motion to the next timestep.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SamplingMethod {
    /// The noise of a step is the one that the network finds in the motion (Song et al. 2020): the start noise alone decides
    /// which motion it becomes.
    #[default]
    Ddim,
    /// A part of the noise is drawn anew at each step, as in training (Ho et al. 2020).
    Ddpm,
}

impl SamplingMethod {
    /// Returns the name, `ddim` or `ddpm`.
    pub const fn name(self) -> &'static str {
        match self {
            SamplingMethod::Ddim => "ddim",
            SamplingMethod::Ddpm => "ddpm",
        }
    }
}

impl FromStr for SamplingMethod {
    type Err = &'static str;

    fn from_str(name: &str) -> Result<Self, Self::Err> {
        match name {
            "ddim" => Ok(SamplingMethod::Ddim),
            "ddpm" => Ok(SamplingMethod::Ddpm),
            _ => Err("expected ddim or ddpm"),
        }
    }
}

/// The windows of a network that continues a motion a few frames at a time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct MotionWindow {
    /// The number of frames before the window that the network reads.
    pub prefix: usize,
    /// The number of frames that the network adds in one pass.
    pub frames: usize,
}
