//! Initial weights for training.

use burn::tensor::Device;
use lamogen_model::initialize;

use crate::{EvaluatorConfig, EvaluatorNetwork};

impl EvaluatorNetwork {
    /// Returns an untrained network with random weights. They have the distributions of [`new`](Self::new), but are
    /// drawn on the host, so that a seed gives the same network on every device.
    ///
    /// # Panics
    ///
    /// If the sizes are not valid (see [`EvaluatorConfig::problem`]).
    pub fn initial(config: &EvaluatorConfig, seed: u64, device: &Device) -> Self {
        let network = EvaluatorNetwork::new(config, device);
        initialize(network, seed, |path, shape, draw| {
            let count = shape.iter().product();
            match *path {
                // A layer of a GRU has the weights of two gates and the candidate side by side; its biases are random,
                // too.
                [.., "recurrent", "forward" | "backward", _, _] => {
                    let states = shape[shape.len() - 1] / 3;
                    draw.uniform((states as f32).powf(-0.5), count)
                }
                [.., "recurrent", "start"] | [.., "Tokens", "weight"] => draw.normal(1.0, count),
                [.., "gamma"] => vec![1.0; count],
                [.., "weight"] => {
                    // A convolution's weight is `[out, in, kernel]`; its fans are multiplied by the size of the kernel.
                    let kernel: usize = shape[2..].iter().product();
                    let fans = (shape[0] + shape[1]) * kernel;
                    draw.normal((2.0 / fans as f32).sqrt(), count)
                }
                _ => vec![0.0; count],
            }
        })
    }
}
