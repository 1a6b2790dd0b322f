//! The noise schedule, and the timesteps of a DDIM pass.

use crate::error::GuideError;

/// The number of timesteps that the checkpoints were trained with.
pub const TRAINING_STEPS: usize = 1000;

/// The noise schedule: `x_t = √ᾱ_t · x_0 + √(1 - ᾱ_t) · ε`.
#[derive(Clone, Debug, PartialEq)]
pub struct Schedule {
    alphas_cumprod: Vec<f64>,
}

/// One step of a DDIM pass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DdimStep {
    /// The timestep at which the network is evaluated.
    pub timestep: usize,
    /// `ᾱ` at this timestep.
    pub alpha_cumprod: f64,
    /// `ᾱ` at the next timestep; 1 for the last step.
    pub next_alpha_cumprod: f64,
}

impl Schedule {
    /// Returns the linear schedule of the checkpoints: `β` from 1e-4 to 0.02 over 1000 timesteps (Ho et al.
    /// 2020), computed in 64 bits.
    pub fn linear() -> Schedule {
        let (first, last) = (1e-4, 0.02);
        let step = (last - first) / (TRAINING_STEPS - 1) as f64;
        let mut product = 1.0;
        let alphas_cumprod = (0..TRAINING_STEPS)
            .map(|t| {
                product *= 1.0 - (first + step * t as f64);
                product
            })
            .collect();
        Schedule { alphas_cumprod }
    }

    /// Returns `ᾱ` at every timestep.
    pub fn alphas_cumprod(&self) -> &[f64] {
        &self.alphas_cumprod
    }

    /// Returns the steps of a DDIM pass with evenly strided timesteps, of which the last is 0: 10 of 1000 are 900, 800,
    /// …, 0 (Song et al. 2020).
    ///
    /// # Errors
    ///
    /// If `steps` is 0 or larger than the number of timesteps.
    pub fn ddim(&self, steps: usize) -> Result<Vec<DdimStep>, GuideError> {
        let training = self.alphas_cumprod.len();
        if !(1..=training).contains(&steps) {
            return Err(GuideError::Steps {
                found: steps,
                largest: training,
            });
        }
        let stride = training / steps;
        Ok((0..steps)
            .rev()
            .map(|index| DdimStep {
                timestep: index * stride,
                alpha_cumprod: self.alphas_cumprod[index * stride],
                next_alpha_cumprod: match index {
                    0 => 1.0,
                    _ => self.alphas_cumprod[(index - 1) * stride],
                },
            })
            .collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn timesteps_descend_evenly_to_zero() {
        let timesteps = |steps| -> Vec<usize> {
            let pass = Schedule::linear().ddim(steps).unwrap();
            pass.iter().map(|step| step.timestep).collect()
        };
        assert_eq!(
            timesteps(10),
            [900, 800, 700, 600, 500, 400, 300, 200, 100, 0]
        );
        assert_eq!(timesteps(3), [666, 333, 0]);
        assert_eq!(timesteps(1), [0]);
        assert_eq!(timesteps(1000), (0..1000).rev().collect::<Vec<_>>());
    }

    #[test]
    fn each_step_ends_where_the_next_begins_and_the_last_without_noise() {
        let pass = Schedule::linear().ddim(7).unwrap();
        for pair in pass.windows(2) {
            assert_eq!(pair[0].next_alpha_cumprod, pair[1].alpha_cumprod);
            assert!(pair[0].alpha_cumprod < pair[1].alpha_cumprod);
        }
        assert_eq!(pass[6].next_alpha_cumprod, 1.0);
    }

    #[test]
    fn zero_steps_and_too_many_steps_are_refused() {
        for steps in [0, 1001] {
            let message = Schedule::linear().ddim(steps).unwrap_err().to_string();
            assert!(
                message.contains("1 to 1000") && message.contains(&steps.to_string()),
                "{message}"
            );
        }
    }
}
