//! Dropout with a random number generator of the caller, so that its draws can be repeated.

use burn::tensor::{Tensor, TensorData};
use rand::Rng;
use rand_chacha::ChaCha12Rng;

/// Dropout, which sets random numbers of a tensor to 0 during training.
///
/// burn's own dropout draws from the device's generator, and the state of that cannot be saved. This one draws on the
/// host from the caller's generator, so that training can be stopped and resumed with the same results.
#[derive(Debug)]
pub struct Dropout<'a> {
    /// The share of numbers that become 0: at least 0 and less than 1. The other numbers are scaled up, so that the mean
    /// does not change. The public code has 0.2.
    pub probability: f64,
    /// The random number generator.
    pub stream: &'a mut ChaCha12Rng,
}

impl Dropout<'_> {
    /// Sets random numbers of a tensor to 0 and scales up the others.
    ///
    /// # Panics
    ///
    /// If the probability is not at least 0 and less than 1.
    pub(super) fn apply<const D: usize>(&mut self, x: Tensor<D>) -> Tensor<D> {
        assert!(
            (0.0..1.0).contains(&self.probability),
            "expected a probability of dropout from 0 up to but not including 1, found {}",
            self.probability
        );
        let threshold = (self.probability * 2f64.powi(32)) as u32;
        let scale = (1.0 / (1.0 - self.probability)) as f32;
        let shape = x.dims();
        let factors: Vec<f32> = (0..shape.iter().product())
            .map(|_| match self.stream.next_u32() < threshold {
                true => 0.0,
                false => scale,
            })
            .collect();
        let factors = Tensor::from_data(TensorData::new(factors, shape), &x.device());
        x * factors
    }
}

#[cfg(test)]
mod tests {
    use burn::tensor::Device;
    use rand::SeedableRng;

    use super::*;

    fn dropped(seed: u64) -> Vec<f32> {
        let mut dropout = Dropout {
            probability: 0.2,
            stream: &mut ChaCha12Rng::seed_from_u64(seed),
        };
        let ones = Tensor::<2>::ones([100, 100], &Device::flex());
        dropout.apply(ones).try_into_vec_as().unwrap()
    }

    #[test]
    fn a_fifth_becomes_0_and_the_mean_stays() {
        let numbers = dropped(3);
        assert!(numbers.iter().all(|&x| x == 0.0 || x == 1.25));
        let mean = numbers.iter().sum::<f32>() / numbers.len() as f32;
        assert!((mean - 1.0).abs() < 0.02, "{mean}");
    }

    #[test]
    fn the_same_seed_gives_the_same_draws() {
        assert_eq!(dropped(3), dropped(3));
        assert_ne!(dropped(3), dropped(4));
    }
}
