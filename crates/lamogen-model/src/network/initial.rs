//! The initial weights for training.

use burn::module::{Module, ModuleMapper, Param};
use burn::tensor::{Device, Tensor, TensorData};
use rand::SeedableRng;
use rand_chacha::ChaCha12Rng;
use rand_distr::{Distribution, Normal, Uniform};

use super::motion_diffuse::MotionDiffuse;
use crate::config::ModelConfig;

impl MotionDiffuse {
    /// Creates a network for training. Its weights are drawn on the host, so that a seed gives the same network on every
    /// device.
    ///
    /// Linear layers are initialised as in PyTorch, but with biases of zero. The layers whose output is added to a residual
    /// stream, and the last layer, start at zero (as in MotionDiffuse's code), so that every block is the identity at first.
    /// The embeddings of the frames are sines and cosines with periods from 4 frames to twice the longest motion, so that
    /// neighbouring frames have similar embeddings from the first step on.
    ///
    /// # Panics
    ///
    /// If the sizes do not form a valid network (see [`ModelConfig::problem`]).
    pub fn initial(config: &ModelConfig, seed: u64, device: &Device) -> Self {
        let network = MotionDiffuse::new(config, device);
        initialize(network, seed, |path, shape, draw| {
            let count = shape.iter().product();
            match *path {
                [.., "frame_embedding"] => sinusoids(shape[0], shape[1]),
                [.., "positional_embedding"] => draw.normal(0.01, count),
                [.., "token_embedding", "weight"] => draw.normal(0.02, count),
                // The output layers of the stylization layers and of the whole network.
                [.., "output", "output", "weight"] | ["output", "weight"] => vec![0.0; count],
                ["laban", "mix", "weight"] => vec![0.0; count],
                [.., "gamma"] => vec![1.0; count],
                [.., "weight"] => draw.uniform((shape[0] as f32).powf(-0.5), count),
                _ => vec![0.0; count],
            }
        })
    }
}

/// Initialises all weights of a network, in their order, with a function of the weight's path in the network and its shape.
///
/// Random numbers are drawn on the host, so that a seed gives the same network on every device.
///
/// # Panics
///
/// If the function returns a number of values that does not match the shape.
pub fn initialize<M: Module>(
    network: M,
    seed: u64,
    numbers: impl FnMut(&[&str], &[usize], &mut WeightSampler) -> Vec<f32>,
) -> M {
    network.map(&mut WeightInitializer {
        path: Vec::new(),
        draw: WeightSampler(ChaCha12Rng::seed_from_u64(seed)),
        numbers,
    })
}

/// A generator of random numbers on the host.
pub struct WeightSampler(ChaCha12Rng);

impl WeightSampler {
    /// Draws normally distributed numbers with mean 0.
    ///
    /// # Panics
    ///
    /// If the deviation is not finite.
    pub fn normal(&mut self, deviation: f32, count: usize) -> Vec<f32> {
        let normal = Normal::new(0.0, deviation).expect("a finite deviation");
        normal.sample_iter(&mut self.0).take(count).collect()
    }

    /// Draws uniformly distributed numbers from `-largest` to `largest`.
    ///
    /// # Panics
    ///
    /// If `largest` is not finite, or below 0.
    pub fn uniform(&mut self, largest: f32, count: usize) -> Vec<f32> {
        let uniform = Uniform::new_inclusive(-largest, largest).expect("a finite range");
        uniform.sample_iter(&mut self.0).take(count).collect()
    }
}

/// Replaces the weights of a network by those that a function computes.
struct WeightInitializer<F> {
    path: Vec<String>,
    draw: WeightSampler,
    numbers: F,
}

impl<F: FnMut(&[&str], &[usize], &mut WeightSampler) -> Vec<f32>> ModuleMapper
    for WeightInitializer<F>
{
    fn enter_module(&mut self, name: &str, _: &str) {
        self.path.push(name.to_owned());
    }

    fn exit_module(&mut self, _: &str, _: &str) {
        self.path.pop();
    }

    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        let path: Vec<&str> = self.path.iter().map(String::as_str).collect();
        let shape: [usize; D] = param.lazy_shape().dims();
        let numbers = (self.numbers)(&path, &shape, &mut self.draw);
        param.map(|tensor| Tensor::from_data(TensorData::new(numbers, shape), &tensor.device()))
    }
}

/// Computes the embeddings of the frames: sines of the frame number, then cosines. The periods are a geometric series.
fn sinusoids(frames: usize, width: usize) -> Vec<f32> {
    const MIN_PERIOD: f64 = 4.0;
    let half = width / 2;
    let max_period = (2 * frames) as f64;
    let angle = |frame: usize, wave: usize| {
        let fraction = wave as f64 / (half - 1).max(1) as f64;
        let period = MIN_PERIOD * (max_period / MIN_PERIOD).max(1.0).powf(fraction);
        std::f64::consts::TAU * frame as f64 / period
    };
    let row = |frame: usize| {
        let sines = (0..half).map(move |wave| angle(frame, wave).sin() as f32);
        sines.chain((0..half).map(move |wave| angle(frame, wave).cos() as f32))
    };
    (0..frames).flat_map(row).collect()
}
