//! The encoder from movements to an embedding of the motion.

use burn::module::Module;
use burn::nn::Linear;
use burn::tensor::{Device, Tensor};
use lamogen_model::{NamedParameters, ParameterList};

use super::gru::BiGru;
use super::linear;
use super::projection::Projection;
use crate::EvaluatorConfig;

/// The motion encoder: a recurrent network over movements.
#[derive(Module, Debug)]
pub(crate) struct MotionEncoder {
    input: Linear,
    recurrent: BiGru,
    output: Projection,
}

impl MotionEncoder {
    pub(crate) fn new(config: &EvaluatorConfig, device: &Device) -> Self {
        let hidden = config.dim_motion_hidden;
        MotionEncoder {
            input: linear(config.dim_movement_latent, hidden, device),
            recurrent: BiGru::new(hidden, hidden, device),
            output: Projection::new(hidden, config.dim_coemb_hidden, device),
        }
    }

    /// Embeds motions that are given by their movements. `lengths` are the numbers of movements.
    ///
    /// # Shapes
    ///
    /// - `movements`: `[batch, movements, dim_movement_latent]`
    /// - output: `[batch, dim_coemb_hidden]`
    pub(crate) fn forward(&self, movements: Tensor<3>, lengths: &[usize]) -> Tensor<2> {
        let states = self
            .recurrent
            .final_states(self.input.forward(movements), lengths);
        self.output.forward(states)
    }
}

impl NamedParameters for MotionEncoder {
    fn keys(&mut self, keys: &mut ParameterList) {
        keys.linear("input_emb", &mut self.input);
        keys.flat(&mut self.recurrent);
        keys.nested("output_net", &mut self.output);
    }
}
