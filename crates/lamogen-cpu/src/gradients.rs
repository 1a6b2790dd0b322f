//! DecoderGradients of everything that training moves.

use rayon::prelude::*;

use crate::FloatStorage;
use crate::backward::Ledger;
use crate::decoder::{CrossAttention, DecoderBlock, FeedForward, SelfAttention};
use crate::decoder::{Decoder, DecoderInput, on_the_pool};
use crate::linear::{Linear, product, rows, rows_mut};
use crate::math;
use crate::norm::LayerNorm;
use crate::stylization::Stylization;
use crate::tape::{Keep, Tape};

use faer::Accum;

/// The gradient of a loss with respect to all that a decoder computed its output from.
#[derive(Clone, Debug)]
pub struct DecoderGradients {
    /// Of each weight, in the place of the weight, input by input.
    pub weights: Decoder<Vec<f32>>,
    /// Of the condition, `[batch, condition]`.
    pub condition: Vec<f32>,
    /// Of what each block attends to in the text, `[batch, heads, d, d]`.
    pub text: Vec<Vec<f32>>,
}

/// Passages that share a ledger: few enough to keep many threads busy, enough for ledgers to be few.
const SHARING: usize = 8;

impl<S: FloatStorage> Decoder<S> {
    /// The gradients from that of the output, `[batch, frames, features]`, of the evaluation that was
    /// [recorded](Self::record_for_training) with the same input. What stands past a motion's length does not count.
    ///
    /// # Panics
    ///
    /// If the tape is of another input, or was not recorded for training.
    pub fn gradients(
        &self,
        input: DecoderInput<'_>,
        tape: Tape,
        gradient: &[f32],
    ) -> DecoderGradients {
        self.check_tape(input, &tape, gradient);
        assert!(
            tape.keep == Keep::ForWeights,
            "the tape was not recorded for training"
        );
        on_the_pool(|| {
            let mut ledgers: Vec<_> = tape
                .passages
                .par_chunks(SHARING)
                .map(|_| Some(self.zeros()))
                .collect();
            let mut text = vec![Vec::new(); self.blocks.len()];
            let (modulations, _) = self.unroll(input, tape, gradient, &mut ledgers, &mut text);
            let mut weights = total(ledgers);
            self.gather_modulations(input.condition, &modulations, &mut weights.modulations);
            DecoderGradients {
                weights,
                condition: self
                    .modulations
                    .modulate_backward(input.condition, &modulations),
                text,
            }
        })
    }

    /// Zeros, one for each weight; none for those of the modulations, which no passage has to do with.
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
            modulations: Linear::by_input(Vec::new(), Vec::new()),
            blocks: blocks.collect(),
            output: Linear::zeros_like(&self.output),
        }
    }

    /// The gradient of the layer behind all scales and shifts, from theirs.
    fn gather_modulations(&self, condition: &[f32], gradient: &[f32], out: &mut Linear<Vec<f32>>) {
        /// Outputs that one thread computes at a time.
        const STRIPE: usize = 256;
        let (inputs, outputs) = (
            self.modulations.weight.inputs(),
            self.modulations.weight.outputs(),
        );
        let active: Vec<f32> = condition.iter().copied().map(math::silu).collect();
        let starts: Vec<usize> = (0..outputs).step_by(STRIPE).collect();
        let stripes: Vec<Vec<f32>> = starts
            .par_iter()
            .map(|&start| {
                let width = STRIPE.min(outputs - start);
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
        *out = Linear::by_input(numbers, bias);
    }
}

/// The sum of all ledgers, in their order.
fn total(ledgers: Vec<Ledger>) -> Decoder<Vec<f32>> {
    let mut ledgers: Vec<Decoder<Vec<f32>>> = ledgers.into_iter().flatten().collect();
    let mut lists: Vec<_> = ledgers.iter_mut().map(Decoder::parts).collect();
    let first = lists.remove(0);
    first.into_par_iter().enumerate().for_each(|(place, sum)| {
        for other in &lists {
            math::add(sum, &*other[place]);
        }
    });
    ledgers.swap_remove(0)
}

impl Decoder<Vec<f32>> {
    /// All numbers, those of one weight each.
    fn parts(&mut self) -> Vec<&mut Vec<f32>> {
        let mut parts = vec![&mut self.frame_embedding];
        self.pose_embedding.parts(&mut parts);
        self.modulations.parts(&mut parts);
        self.output.parts(&mut parts);
        for block in &mut self.blocks {
            let attention = &mut block.self_attention;
            attention.norm.parts(&mut parts);
            attention.query.parts(&mut parts);
            attention.key.parts(&mut parts);
            attention.value.parts(&mut parts);
            attention.output.parts(&mut parts);
            let attention = &mut block.cross_attention;
            attention.norm.parts(&mut parts);
            attention.query.parts(&mut parts);
            attention.output.parts(&mut parts);
            let layers = &mut block.feed_forward;
            layers.expand.parts(&mut parts);
            layers.contract.parts(&mut parts);
            layers.output.parts(&mut parts);
        }
        parts
    }
}
