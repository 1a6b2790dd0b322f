//! The gradients that training needs: those of the weights and of the conditioning tokens.

use rayon::prelude::*;

use super::attention::Heads;
use super::{LayerActivations, SoftmaxAttention, Transformer, TransformerInput, TransformerTape};
use crate::FloatStorage;
use crate::chunk::Chunk;
use crate::forward::gelu;
use crate::linear::{Linear, product, rows, rows_mut};
use crate::math;
use crate::norm::LayerNorm;

use faer::Accum;

/// The gradients of a loss with respect to the weights and the conditioning tokens of a transformer.
#[derive(Clone, Debug)]
pub struct TransformerWeightGradients {
    /// The gradient of each weight, at the place of the weight. Matrices are stored input by input.
    pub weights: Transformer<Vec<f32>>,
    /// The gradient of the conditioning tokens, `[motions, tokens, width]`.
    pub tokens: Vec<f32>,
}

/// The number of chunks whose gradients are added to the same sums.
const CHUNKS_PER_GROUP: usize = 8;

impl<S: FloatStorage> Transformer<S> {
    /// Computes the gradients of all weights and of the conditioning tokens from the gradient of the output of a recorded
    /// evaluation.
    ///
    /// # Panics
    ///
    /// If the sizes do not match, or if the input has offsets.
    pub fn gradients(
        &self,
        input: TransformerInput<'_>,
        tape: &TransformerTape,
        gradient: &[f32],
    ) -> TransformerWeightGradients {
        assert!(input.offsets.is_none(), "training adds no offsets");
        let groups = tape.chunks.len().div_ceil(CHUNKS_PER_GROUP);
        let mut groups: Vec<_> = (0..groups)
            .into_par_iter()
            .map(|_| Some(self.zeros()))
            .collect();
        let gradients = self.backpropagate(input, tape, gradient, CHUNKS_PER_GROUP, &mut groups);
        TransformerWeightGradients {
            weights: sum_groups(groups),
            tokens: gradients.tokens,
        }
    }

    fn zeros(&self) -> Transformer<Vec<f32>> {
        Transformer {
            heads: self.heads,
            pose_embedding: Linear::zeros_like(&self.pose_embedding),
            layers: { self.layers.iter() }
                .map(|layer| super::TransformerLayer {
                    self_attention: SoftmaxAttention::zeros_like(&layer.self_attention),
                    text_attention: { layer.text_attention.as_ref() }
                        .map(SoftmaxAttention::zeros_like),
                    expand: Linear::zeros_like(&layer.expand),
                    contract: Linear::zeros_like(&layer.contract),
                    norms: layer.norms.iter().map(LayerNorm::zeros_like).collect(),
                })
                .collect(),
            output: Linear::zeros_like(&self.output),
        }
    }

    /// Computes the rows of a chunk before a layer.
    pub(super) fn layer_input(
        &self,
        index: usize,
        (chunk, activations): (&Chunk, &[LayerActivations]),
        input: TransformerInput<'_>,
    ) -> Vec<f32> {
        match index.checked_sub(1) {
            None => self.embed(chunk.clone(), input).hidden,
            Some(before) => {
                let place = self.layers[before].norms.len() - 1;
                self.norm_output(before, place, &activations[before])
            }
        }
    }

    /// Computes the rows after a norm of a layer.
    pub(super) fn norm_output(
        &self,
        index: usize,
        place: usize,
        activations: &LayerActivations,
    ) -> Vec<f32> {
        let normalized = &activations.norms[place];
        let mut hidden = vec![0.0; normalized.rows.len()];
        normalized.scale_and_shift(&self.layers[index].norms[place], &mut hidden);
        hidden
    }

    /// Adds the gradients of the feed-forward layers. `gradient` is that of their result and `inner` that of the rows between
    /// them before the GELU.
    pub(super) fn add_feed_forward_gradients(
        &self,
        index: usize,
        activations: &LayerActivations,
        [inner, gradient]: [&[f32]; 2],
        weights: &mut Transformer<Vec<f32>>,
    ) {
        let layer = &mut weights.layers[index];
        let mut active = vec![0.0; activations.expanded.len()];
        gelu(&activations.expanded, &mut active);
        layer.contract.add_gradients(&active, gradient);
        let x = self.norm_output(index, activations.norms.len() - 2, activations);
        layer.expand.add_gradients(&x, inner);
    }
}

impl Heads {
    /// Adds the gradients of the projection after an attention, whose values are weighted once more. `gradient` is that of the
    /// projection's result.
    pub(super) fn add_projection_gradients(
        self,
        keys_and_values: &[f32],
        probabilities: &super::Probabilities,
        gradient: &[f32],
        projection: &mut Linear<Vec<f32>>,
    ) {
        let mut attended = vec![0.0; gradient.len()];
        self.weigh_values(keys_and_values, probabilities, &mut attended);
        projection.add_gradients(&attended, gradient);
    }
}

impl SoftmaxAttention<Vec<f32>> {
    fn zeros_like<S: FloatStorage>(attention: &SoftmaxAttention<S>) -> Self {
        SoftmaxAttention {
            in_proj: Linear::zeros_like(&attention.in_proj),
            out_proj: Linear::zeros_like(&attention.out_proj),
        }
    }

    fn collect_weights<'a>(&'a mut self, list: &mut Vec<&'a mut Vec<f32>>) {
        self.in_proj.collect_weights(list);
        self.out_proj.collect_weights(list);
    }
}

impl Linear<Vec<f32>> {
    /// Adds the gradients of the weights and biases of some of the outputs, given the gradient of these outputs.
    pub(super) fn add_gradients_of_part(
        &mut self,
        x: &[f32],
        gradient: &[f32],
        outputs: std::ops::Range<usize>,
    ) {
        let (inputs, all) = (self.weight.inputs(), self.weight.outputs());
        let weights = rows_mut(self.weight.numbers_mut(), all);
        product(
            rows(x, inputs).transpose(),
            rows(gradient, outputs.len()),
            weights.subcols_mut(outputs.start, outputs.len()),
            Accum::Add,
        );
        math::add_rows(&mut self.bias[outputs], gradient);
    }
}

/// Sums the gradients of all groups, in the order of the groups.
fn sum_groups(groups: Vec<Option<Transformer<Vec<f32>>>>) -> Transformer<Vec<f32>> {
    let mut groups: Vec<Transformer<Vec<f32>>> = groups.into_iter().flatten().collect();
    let mut group_weights: Vec<_> = groups.iter_mut().map(Transformer::weights_mut).collect();
    let first = group_weights.remove(0);
    first.into_par_iter().enumerate().for_each(|(index, sum)| {
        for other in &group_weights {
            math::add(sum, &*other[index]);
        }
    });
    groups.swap_remove(0)
}

impl Transformer<Vec<f32>> {
    /// Returns the numbers of all weights, one vector for each weight.
    fn weights_mut(&mut self) -> Vec<&mut Vec<f32>> {
        let mut weights = Vec::new();
        self.pose_embedding.collect_weights(&mut weights);
        self.output.collect_weights(&mut weights);
        for layer in &mut self.layers {
            layer.self_attention.collect_weights(&mut weights);
            if let Some(attention) = &mut layer.text_attention {
                attention.collect_weights(&mut weights);
            }
            layer.expand.collect_weights(&mut weights);
            layer.contract.collect_weights(&mut weights);
            for norm in &mut layer.norms {
                norm.collect_weights(&mut weights);
            }
        }
        weights
    }
}
