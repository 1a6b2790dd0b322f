//! Dropout that can be repeated.

use burn::tensor::{Tensor, TensorData};
use rand::Rng;
use rand_chacha::ChaCha12Rng;

/// Leaves out numbers at random while a network is trained.
///
/// burn's own dropout draws from the device's generator, whose state cannot be kept; this one draws on the host
/// from a stream of the caller's, so that training can be stopped and go on as if it had not been.
#[derive(Debug)]
pub struct Dropout<'a> {
    /// The share of numbers that becomes 0, from 0 up to but not including 1; the others grow so that the mean
    /// stays. The public code has 0.2.
    pub probability: f64,
    /// Where the draws come from.
    pub stream: &'a mut ChaCha12Rng,
}

impl Dropout<'_> {
    /// # Panics
    ///
    /// If the probability is not from 0 up to but not including 1.
    pub(super) fn apply<const D: usize>(&mut self, x: Tensor<D>) -> Tensor<D> {
        assert!(
            (0.0..1.0).contains(&self.probability),
            "expected a probability of dropout from 0 up to but not including 1, found {}",
            self.probability
        );
        let below = (self.probability * 2f64.powi(32)) as u32;
        let kept = (1.0 / (1.0 - self.probability)) as f32;
        let shape = x.dims();
        let factors: Vec<f32> = (0..shape.iter().product())
            .map(|_| match self.stream.next_u32() < below {
                true => 0.0,
                false => kept,
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
    fn a_fifth_is_left_out_and_the_mean_stays() {
        let numbers = dropped(3);
        assert!(numbers.iter().all(|&x| x == 0.0 || x == 1.25));
        let mean = numbers.iter().sum::<f32>() / numbers.len() as f32;
        assert!((mean - 1.0).abs() < 0.02, "{mean}");
    }

    #[test]
    fn a_stream_means_the_same_draws_again() {
        assert_eq!(dropped(3), dropped(3));
        assert_ne!(dropped(3), dropped(4));
    }
}
