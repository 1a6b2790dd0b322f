//! The noise schedule, and the timesteps of a DDIM pass.

use std::f64::consts::FRAC_PI_2;

use lamogen_model::NoiseSchedule;

use crate::error::GuideError;

/// The number of timesteps that MotionDiffuse's networks were trained with.
pub const TRAINING_STEPS: usize = 1000;

/// The noise schedule: `x_t = √ᾱ_t · x_0 + √(1 - ᾱ_t) · ε`.
#[derive(Clone, Debug, PartialEq)]
pub struct Schedule {
    alphas_cumprod: Vec<f64>,
}

/// One step of a pass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DdimStep {
    /// The timestep at which the network is evaluated.
    pub timestep: usize,
    /// `ᾱ` at this timestep.
    pub alpha_cumprod: f64,
    /// `ᾱ` at the next timestep; 1 for the last step.
    pub next_alpha_cumprod: f64,
}

impl DdimStep {
    /// Returns the variance of the next noisy motion if this one and the clean motion are known (Ho et al. 2020, equation 7).
    pub fn posterior_variance(&self) -> f64 {
        let beta = 1.0 - self.alpha_cumprod / self.next_alpha_cumprod;
        beta * (1.0 - self.next_alpha_cumprod) / (1.0 - self.alpha_cumprod)
    }
}

impl Schedule {
    /// Returns the schedule of MotionDiffuse's networks: `β` from 1e-4 to 0.02 over 1000 timesteps (Ho et al.
    /// 2020).
    pub fn linear() -> Schedule {
        Schedule::new(NoiseSchedule::Linear {
            timesteps: TRAINING_STEPS,
        })
    }

    /// Computes a schedule in 64 bits.
    pub fn new(schedule: NoiseSchedule) -> Schedule {
        let timesteps = schedule.timesteps();
        let beta = |t: usize| match schedule {
            NoiseSchedule::Linear { .. } => {
                let scale = TRAINING_STEPS as f64 / timesteps as f64;
                let (first, last) = (scale * 1e-4, scale * 0.02);
                let step = (last - first) / timesteps.saturating_sub(1).max(1) as f64;
                first + step * t as f64
            }
            NoiseSchedule::Cosine { .. } => {
                // Nichol and Dhariwal 2021, section 3.2.
                const OFFSET: f64 = 0.008;
                const MAX_BETA: f64 = 0.999;
                let level = |t: usize| {
                    let time = t as f64 / timesteps as f64;
                    ((time + OFFSET) / (1.0 + OFFSET) * FRAC_PI_2).cos().powi(2)
                };
                (1.0 - level(t + 1) / level(t)).min(MAX_BETA)
            }
        };
        let mut product = 1.0;
        let alphas_cumprod = (0..timesteps)
            .map(|t| {
                product *= 1.0 - beta(t);
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
    fn the_cosine_has_a_schedule_of_its_own_for_each_number_of_timesteps() {
        let alphas = |timesteps| {
            let schedule = Schedule::new(NoiseSchedule::Cosine { timesteps });
            schedule.alphas_cumprod().to_vec()
        };
        let fifty = alphas(50);
        assert_eq!(fifty.len(), 50);
        // Values of MDM's public code, rounded to six digits.
        for (t, expected) in [
            (0, 0.998252),
            (1, 0.99457),
            (25, 0.462707),
            (48, 9.712e-4),
            (49, 9.712e-7),
        ] {
            let difference = (fifty[t] / expected - 1.0).abs();
            assert!(difference < 1e-4, "{t}: {}", fifty[t]);
        }
        let last = alphas(1000)[999];
        assert!((last / 2.429e-9 - 1.0).abs() < 1e-3, "{last}");
    }

    #[test]
    fn a_linear_schedule_of_fewer_timesteps_ends_as_noisy() {
        let schedule = Schedule::new(NoiseSchedule::Linear { timesteps: 50 });
        let [last, reference] = [&schedule, &Schedule::linear()]
            .map(|schedule| *schedule.alphas_cumprod().last().unwrap());
        assert!(last < 1e-4 && reference < 1e-4, "{last} {reference}");
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
