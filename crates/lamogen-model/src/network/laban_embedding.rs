//! The embedding of Laban features, which is added to the embeddings of timestep and sentence.

use burn::module::Module;
use burn::nn::{Linear, LinearConfig};
use burn::tensor::activation::silu;
use burn::tensor::{Tensor, TensorData};

use crate::checkpoint::{NamedParameters, ParameterList};
use crate::config::{LABAN_FEATURES, LabanCondition, ModelConfig};

/// Two linear layers after the encoding of the features by a [`LabanCondition`].
#[derive(Module, Debug)]
pub(super) struct LabanEmbedding {
    expand: Linear,
    mix: Linear,
    #[module(skip)]
    condition: LabanCondition,
}

impl LabanEmbedding {
    /// Creates the embedding, or returns `None` for a network that is not conditioned on Laban features.
    pub(super) fn new(config: &ModelConfig, device: &burn::tensor::Device) -> Option<Self> {
        let (latent, width) = (config.latent_dim, config.condition_dim());
        Some(LabanEmbedding {
            condition: config.laban_condition?,
            expand: LinearConfig::new(2 * LABAN_FEATURES, latent).init(device),
            mix: LinearConfig::new(latent, width).init(device),
        })
    }

    /// Computes the vectors that are added to the sentence embeddings, `[motions, d_condition]`. The vector of a motion
    /// without any given feature is 0.
    pub(super) fn forward(&self, means: &[[Option<f32>; LABAN_FEATURES]]) -> Tensor<2> {
        let device = self.expand.weight.device();
        let rows: Vec<f32> = { means.iter() }
            .flat_map(|means| self.condition.encode(means))
            .collect();
        let data = TensorData::new(rows, [means.len(), 2 * LABAN_FEATURES]);
        let embedded = self
            .mix
            .forward(silu(self.expand.forward(Tensor::from_data(data, &device))));
        let given_mask: Vec<f32> = { means.iter() }
            .map(|means| f32::from(u8::from(means.iter().any(Option::is_some))))
            .collect();
        let given_mask =
            Tensor::<2>::from_data(TensorData::new(given_mask, [means.len(), 1]), &device);
        embedded * given_mask
    }
}

impl NamedParameters for LabanEmbedding {
    fn keys(&mut self, keys: &mut ParameterList) {
        keys.linear("0", &mut self.expand);
        keys.linear("2", &mut self.mix);
    }
}
