//! The start noise of a pass.

use burn::tensor::{Device, Tensor, TensorData};
use rand::SeedableRng;
use rand_chacha::ChaCha12Rng;
use rand_distr::{Distribution, StandardNormal};

/// Returns standard normal noise `[frames, features]`, row by row.
///
/// The noise is drawn in main memory by a counter-based generator (ChaCha with 12 rounds), so that a seed gives the
/// same noise on every machine and backend. The noise of a longer motion begins with that of a shorter one.
pub fn noise(seed: u64, frames: usize, features: usize) -> Vec<f32> {
    let generator = ChaCha12Rng::seed_from_u64(seed);
    StandardNormal
        .sample_iter(generator)
        .take(frames * features)
        .collect()
}

/// The noise that a sampler adds at each step, as in training (Ho et al. 2020).
#[derive(Clone, Debug)]
pub enum StepNoise {
    /// Noise that is drawn in main memory from a seed for each motion, so that a seed gives the same motion on every
    /// machine and backend.
    Seeded(Vec<u64>),
    /// The noise of each step, `[batch, frames, features]`.
    Given(Vec<Tensor<3>>),
}

impl StepNoise {
    /// Returns the noise of a step, `[motions, frames, features]`. Steps are counted from 0.
    ///
    /// # Panics
    ///
    /// If the noise is given and there is none for the step.
    pub(crate) fn at(
        &self,
        step: usize,
        [frames, features]: [usize; 2],
        device: &Device,
    ) -> Tensor<3> {
        match self {
            StepNoise::Given(noise) => noise[step].clone(),
            StepNoise::Seeded(seeds) => {
                let noise = seeds.iter().flat_map(|&seed| {
                    let mut generator = ChaCha12Rng::seed_from_u64(seed);
                    // The start noise is the stream 0.
                    generator.set_stream(step as u64 + 1);
                    StandardNormal
                        .sample_iter(generator)
                        .take(frames * features)
                        .collect::<Vec<f32>>()
                });
                let data = TensorData::new(noise.collect(), [seeds.len(), frames, features]);
                Tensor::from_data(data, device)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PINNED: [f32; 4] = [-1.0435766, -0.5767478, -0.7112543, 0.11629714];

    #[test]
    fn a_seed_gives_the_same_noise_in_all_versions() {
        let first = noise(7, 2, 2);
        // These numbers must never change, so that published motions can be generated again.
        assert_eq!(first, PINNED);
        assert_eq!(first, noise(7, 2, 2));
        assert_eq!(first, noise(7, 5, 2)[..4]);
        assert_ne!(first, noise(8, 2, 2));
    }

    #[test]
    fn each_step_and_each_seed_has_noise_of_its_own() {
        let seeded = StepNoise::Seeded(vec![7, 8]);
        let at = |step, frames| -> Vec<f32> {
            let noise = seeded.at(step, [frames, 2], &Device::flex());
            noise.try_into_vec_as().unwrap()
        };
        let first = at(0, 2);
        assert_eq!(first, at(0, 2));
        assert_ne!(first, at(1, 2));
        assert_ne!(first[..4], first[4..]);
        assert_ne!(first[..4], noise(7, 2, 2)[..]);
        // The noise of a longer motion begins with that of a shorter one.
        assert_eq!(first[..4], at(0, 3)[..4]);
    }

    #[test]
    fn noise_is_standard_normal() {
        let noise = noise(1, 200, 263);
        let count = noise.len() as f64;
        let mean = noise.iter().map(|&x| f64::from(x)).sum::<f64>() / count;
        let variance = noise.iter().map(|&x| f64::from(x).powi(2)).sum::<f64>() / count;
        assert!(mean.abs() < 0.02, "{mean}");
        assert!((variance - 1.0).abs() < 0.02, "{variance}");
    }
}
