//! Timesteps as vectors.

use burn::module::Module;
use burn::nn::{Linear, LinearConfig};
use burn::tensor::activation::silu;
use burn::tensor::{Device, Tensor, TensorData};

use crate::checkpoint::{Keyed, Keys};

/// Cosines and sines of the timestep, through two linear layers.
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

    /// # Shapes
    ///
    /// - output: `[timesteps, d_condition]`
    pub(super) fn forward(&self, timesteps: &[usize]) -> Tensor<2> {
        let [latent, _] = self.expand.weight.dims();
        let waves: Vec<f32> = timesteps.iter().flat_map(|&t| waves(t, latent)).collect();
        let data = TensorData::new(waves, [timesteps.len(), latent]);
        let waves = Tensor::from_data(data, &self.expand.weight.device());
        self.mix.forward(silu(self.expand.forward(waves)))
    }
}

/// Cosines, then sines, with periods up to 10000 · 2π (Vaswani et al. 2017, halves instead of
/// alternating as in Ho et al. 2020). Rounded to 32 bits at each step, as the checkpoints were
/// trained.
fn waves(timestep: usize, width: usize) -> impl Iterator<Item = f32> {
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

impl Keyed for TimeEmbedding {
    fn keys(&mut self, keys: &mut Keys) {
        keys.linear("0", &mut self.expand);
        keys.linear("2", &mut self.mix);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waves_start_at_one_and_zero() {
        let start: Vec<f32> = waves(0, 6).collect();
        assert_eq!(start, [1.0, 1.0, 1.0, 0.0, 0.0, 0.0]);
        let later: Vec<f32> = waves(1, 4).collect();
        assert_eq!(later[0], 1f32.cos());
        assert!((later[3] - 0.01f32.sin()).abs() < 1e-8);
    }
}
