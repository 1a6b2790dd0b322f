//! Weights to start training from.

use burn::module::{Module, ModuleMapper, Param};
use burn::tensor::{Device, Tensor, TensorData};
use rand::SeedableRng;
use rand_chacha::ChaCha12Rng;
use rand_distr::{Distribution, Normal, StandardNormal, Uniform};

use crate::{Evaluator, EvaluatorConfig};

impl Evaluator {
    /// A network to be trained. Its weights are distributed as those of [`new`](Self::new), but drawn on the host, so that a
    /// seed means the same network on every device.
    ///
    /// # Panics
    ///
    /// If the sizes make no network (see [`EvaluatorConfig::problem`]).
    pub fn initial(config: &EvaluatorConfig, seed: u64, device: &Device) -> Self {
        Evaluator::new(config, device).map(&mut Initial {
            path: Vec::new(),
            generator: ChaCha12Rng::seed_from_u64(seed),
        })
    }
}

struct Initial {
    path: Vec<String>,
    generator: ChaCha12Rng,
}

impl ModuleMapper for Initial {
    fn enter_module(&mut self, name: &str, _: &str) {
        self.path.push(name.to_owned());
    }

    fn exit_module(&mut self, _: &str, _: &str) {
        self.path.pop();
    }

    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        let path = self.path.clone();
        let path: Vec<&str> = path.iter().map(String::as_str).collect();
        let shape: [usize; D] = param.lazy_shape().dims();
        let count = shape.iter().product();
        let numbers = match path[..] {
            // The layers of a GRU give three states side by side, and also their biases are drawn.
            [.., "recurrent", "forward" | "backward", _, _] => {
                self.uniform(((shape[D - 1] / 3) as f32).powf(-0.5), count)
            }
            [.., "recurrent", "start"] | [.., "Tokens", "weight"] => {
                self.draw(StandardNormal, count)
            }
            [.., "gamma"] => vec![1.0; count],
            [.., "weight"] => {
                // Of a convolution, `[out, in, kernel]`, each number counts once for every place of the kernel.
                let places: usize = shape[2..].iter().product();
                let fans = (shape[0] + shape[1]) * places;
                let normal = Normal::new(0.0, (2.0 / fans as f32).sqrt());
                self.draw(normal.expect("a finite deviation"), count)
            }
            _ => vec![0.0; count],
        };
        param.map(|tensor| Tensor::from_data(TensorData::new(numbers, shape), &tensor.device()))
    }
}

impl Initial {
    fn uniform(&mut self, largest: f32, count: usize) -> Vec<f32> {
        let uniform = Uniform::new_inclusive(-largest, largest);
        self.draw(uniform.expect("a finite range"), count)
    }

    fn draw(&mut self, from: impl Distribution<f32>, count: usize) -> Vec<f32> {
        from.sample_iter(&mut self.generator).take(count).collect()
    }
}
