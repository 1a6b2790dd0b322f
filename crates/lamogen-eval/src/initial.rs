//! Weights to start training from.

use burn::tensor::Device;
use lamogen_model::initialize;

use crate::{EvaluatorConfig, EvaluatorNetwork};

impl EvaluatorNetwork {
    /// A network to be trained. Its weights are distributed as those of [`new`](Self::new), but drawn on the host, so that a
    /// seed means the same network on every device.
    ///
    /// # Panics
    ///
    /// If the sizes make no network (see [`EvaluatorConfig::problem`]).
    pub fn initial(config: &EvaluatorConfig, seed: u64, device: &Device) -> Self {
        let network = EvaluatorNetwork::new(config, device);
        initialize(network, seed, |path, shape, draw| {
            let count = shape.iter().product();
            match *path {
                // The layers of a GRU give three states side by side, and also their biases are drawn.
                [.., "recurrent", "forward" | "backward", _, _] => {
                    let states = shape[shape.len() - 1] / 3;
                    draw.uniform((states as f32).powf(-0.5), count)
                }
                [.., "recurrent", "start"] | [.., "Tokens", "weight"] => draw.normal(1.0, count),
                [.., "gamma"] => vec![1.0; count],
                [.., "weight"] => {
                    // Of a convolution, `[out, in, kernel]`, each number counts once for every place of the kernel.
                    let places: usize = shape[2..].iter().product();
                    let fans = (shape[0] + shape[1]) * places;
                    draw.normal((2.0 / fans as f32).sqrt(), count)
                }
                _ => vec![0.0; count],
            }
        })
    }
}
