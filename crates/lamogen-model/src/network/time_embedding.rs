//! The embedding of timesteps.

use burn::module::Module;
use burn::nn::{Linear, LinearConfig};
use burn::tensor::activation::silu;
use burn::tensor::{Device, Tensor, TensorData};

use crate::checkpoint::{NamedParameters, ParameterList};

/// Two linear layers after the cosines and sines of the timestep.
#[derive(Module, Debug)]
pub(super) struct TimeEmbedding {
    expand: Linear,
    mix: Linear,
}

impl TimeEmbedding {
    pub(super) fn new(latent: usize, condition: usize, device: &Device) -> Self {
        TimeEmbedding {
            expand: LinearConfig::new(latent, condition).init(device),
            mix: LinearConfig::new(condition, condition).init(device),
        }
    }

    /// Embeds timesteps.
    ///
    /// # Shapes
    ///
    /// - output: `[timesteps, d_condition]`
    pub(super) fn forward(&self, timesteps: &[usize]) -> Tensor<2> {
        let [latent, _] = self.expand.weight.dims();
        let sinusoids: Vec<f32> = timesteps
            .iter()
            .flat_map(|&t| sinusoids(t, latent))
            .collect();
        let data = TensorData::new(sinusoids, [timesteps.len(), latent]);
        let sinusoids = Tensor::from_data(data, &self.expand.weight.device());
        self.mix.forward(silu(self.expand.forward(sinusoids)))
    }
}

/// Computes the cosines, then the sines, of a timestep, with periods up to 10000 · 2π (Vaswani et al. 2017; in two halves
/// instead of alternating, as in Ho et al. 2020).
///
/// Each intermediate result is rounded to 32 bits, as in the training of the checkpoints.
fn sinusoids(timestep: usize, width: usize) -> impl Iterator<Item = f32> {
    let half = width / 2;
    let angle = move |i: usize| {
        let exponent = -(10000.0f64.ln() as f32) * i as f32 / half as f32;
        let frequency = f64::from(exponent).exp() as f32;
        f64::from(timestep as f32 * frequency)
    };
    (0..half)
        .map(move |i| angle(i).cos() as f32)
        .chain((0..half).map(move |i| angle(i).sin() as f32))
}

impl NamedParameters for TimeEmbedding {
    fn keys(&mut self, keys: &mut ParameterList) {
        keys.linear("0", &mut self.expand);
        keys.linear("2", &mut self.mix);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sinusoids_start_at_one_and_zero() {
        let start: Vec<f32> = sinusoids(0, 6).collect();
        assert_eq!(start, [1.0, 1.0, 1.0, 0.0, 0.0, 0.0]);
        let later: Vec<f32> = sinusoids(1, 4).collect();
        assert_eq!(later[0], 1f32.cos());
        assert!((later[3] - 0.01f32.sin()).abs() < 1e-8);
    }
}
