//! The gradients that training needs: those of the weights, the condition and the text contexts.

use rayon::prelude::*;

use crate::FloatStorage;
use crate::backward::WeightGradients;
use crate::decoder::{CrossAttention, DecoderBlock, FeedForward, SelfAttention};
use crate::decoder::{Decoder, DecoderInput, run_in_pool};
use crate::linear::{Linear, product, rows, rows_mut};
use crate::math;
use crate::norm::LayerNorm;
use crate::stylization::Stylization;
use crate::tape::{RecordMode, Tape};

use faer::Accum;

/// The gradients of a loss with respect to the weights and the inputs of a decoder.
#[derive(Clone, Debug)]
pub struct DecoderGradients {
    /// The gradient of each weight, at the place of the weight. Matrices are stored input by input.
    pub weights: Decoder<Vec<f32>>,
    /// The gradient of the condition, `[batch, condition]`.
    pub condition: Vec<f32>,
    /// For each block, the gradient of the context of the text, `[batch, heads, d, d]`.
    pub text: Vec<Vec<f32>>,
}

/// The number of chunks whose gradients are added to the same sums.
///
/// The groups are small enough to keep many threads busy, and large enough to need few copies of the gradients.
const CHUNKS_PER_GROUP: usize = 8;

impl<S: FloatStorage> Decoder<S> {
    /// Computes all gradients from the gradient of the output, `[batch, frames, features]`.
    ///
    /// The tape must come from [`record_for_training`](Self::record_for_training) with the same input. The gradient past a
    /// motion's length is ignored.
    ///
    /// # Panics
    ///
    /// If the tape belongs to another input, or was not recorded for training.
    pub fn gradients(
        &self,
        input: DecoderInput<'_>,
        tape: Tape,
        gradient: &[f32],
    ) -> DecoderGradients {
        self.check_tape(input, &tape, gradient);
        assert!(
            tape.mode == RecordMode::ForWeights,
            "the tape was not recorded for training"
        );
        run_in_pool(|| {
            let mut groups: Vec<_> = tape
                .chunks
                .par_chunks(CHUNKS_PER_GROUP)
                .map(|_| Some(self.zeros()))
                .collect();
            let mut text = vec![Vec::new(); self.blocks.len()];
            let (modulations, _) =
                self.backpropagate(input, tape, gradient, &mut groups, &mut text);
            let mut weights = sum_groups(groups);
            self.modulation_weight_gradients(
                input.condition,
                &modulations,
                &mut weights.modulations,
            );
            DecoderGradients {
                weights,
                condition: self
                    .modulations
                    .modulate_backward(input.condition, &modulations),
                text,
            }
        })
    }

    /// Creates zeros for all weights except those of the modulations, whose gradients no chunk contributes to.
    fn zeros(&self) -> Decoder<Vec<f32>> {
        let blocks = self.blocks.iter().map(|block| DecoderBlock {
            self_attention: SelfAttention {
                norm: LayerNorm::zeros_like(&block.self_attention.norm),
                query: Linear::zeros_like(&block.self_attention.query),
                key: Linear::zeros_like(&block.self_attention.key),
                value: Linear::zeros_like(&block.self_attention.value),
                output: Stylization::zeros_like(&block.self_attention.output),
            },
            cross_attention: CrossAttention {
                norm: LayerNorm::zeros_like(&block.cross_attention.norm),
                query: Linear::zeros_like(&block.cross_attention.query),
                output: Stylization::zeros_like(&block.cross_attention.output),
            },
            feed_forward: FeedForward {
                expand: Linear::zeros_like(&block.feed_forward.expand),
                contract: Linear::zeros_like(&block.feed_forward.contract),
                output: Stylization::zeros_like(&block.feed_forward.output),
            },
        });
        Decoder {
            heads: self.heads,
            pose_embedding: Linear::zeros_like(&self.pose_embedding),
            frame_embedding: vec![0.0; self.frame_embedding.as_ref().len()],
            modulations: Linear::from_input_major(Vec::new(), Vec::new()),
            blocks: blocks.collect(),
            output: Linear::zeros_like(&self.output),
        }
    }

    /// Computes the gradient of the layer that gives all scales and shifts, from the gradient of the scales and shifts.
    fn modulation_weight_gradients(
        &self,
        condition: &[f32],
        gradient: &[f32],
        out: &mut Linear<Vec<f32>>,
    ) {
        /// The number of outputs that one thread computes at a time.
        const STRIPE_OUTPUTS: usize = 256;
        let (inputs, outputs) = (
            self.modulations.weight.inputs(),
            self.modulations.weight.outputs(),
        );
        let active: Vec<f32> = condition.iter().copied().map(math::silu).collect();
        let starts: Vec<usize> = (0..outputs).step_by(STRIPE_OUTPUTS).collect();
        let stripes: Vec<Vec<f32>> = starts
            .par_iter()
            .map(|&start| {
                let width = STRIPE_OUTPUTS.min(outputs - start);
                let mut stripe = vec![0.0; inputs * width];
                let gradient = rows(gradient, outputs).subcols(start, width);
                let active = rows(&active, inputs).transpose();
                product(
                    active,
                    gradient,
                    rows_mut(&mut stripe, width),
                    Accum::Replace,
                );
                stripe
            })
            .collect();
        let mut numbers = Vec::with_capacity(inputs * outputs);
        for input in 0..inputs {
            for stripe in &stripes {
                let width = stripe.len() / inputs;
                numbers.extend_from_slice(&stripe[input * width..][..width]);
            }
        }
        let mut bias = vec![0.0; outputs];
        math::add_rows(&mut bias, gradient);
        *out = Linear::from_input_major(numbers, bias);
    }
}

/// Sums the gradients of all groups, in the order of the groups.
fn sum_groups(groups: Vec<WeightGradients>) -> Decoder<Vec<f32>> {
    let mut groups: Vec<Decoder<Vec<f32>>> = groups.into_iter().flatten().collect();
    let mut group_weights: Vec<_> = groups.iter_mut().map(Decoder::weights_mut).collect();
    let first = group_weights.remove(0);
    first.into_par_iter().enumerate().for_each(|(index, sum)| {
        for other in &group_weights {
            math::add(sum, &*other[index]);
        }
    });
    groups.swap_remove(0)
}

impl Decoder<Vec<f32>> {
    /// Returns the numbers of all weights, one vector for each weight.
    fn weights_mut(&mut self) -> Vec<&mut Vec<f32>> {
        let mut weights = vec![&mut self.frame_embedding];
        self.pose_embedding.collect_weights(&mut weights);
        self.modulations.collect_weights(&mut weights);
        self.output.collect_weights(&mut weights);
        for block in &mut self.blocks {
            let attention = &mut block.self_attention;
            attention.norm.collect_weights(&mut weights);
            attention.query.collect_weights(&mut weights);
            attention.key.collect_weights(&mut weights);
            attention.value.collect_weights(&mut weights);
            attention.output.collect_weights(&mut weights);
            let attention = &mut block.cross_attention;
            attention.norm.collect_weights(&mut weights);
            attention.query.collect_weights(&mut weights);
            attention.output.collect_weights(&mut weights);
            let layers = &mut block.feed_forward;
            layers.expand.collect_weights(&mut weights);
            layers.contract.collect_weights(&mut weights);
            layers.output.collect_weights(&mut weights);
        }
        weights
    }
}
