//! From the gradient of the output to that of the condition.
//!
//! With `C = softmax(k)ᵀ v` and `y = softmax(q) C`, the gradient of the keys before their softmax is
//! `K ⊙ (v Ċᵀ - r)` with `K` the softmax and `rᵢ = Σⱼ Cᵢⱼ Ċᵢⱼ`: the sum over frames that the softmax asks
//! for is already in `C`, so that chunks meet only once a block, for `Ċ = softmax(q)ᵀ ẏ`.

use multiversion::multiversion;
use rayon::prelude::*;

use crate::Numbers;
use crate::attention::{self, Context};
use crate::decoder::{Decoder, Input, LAYERS, on_the_pool};
use crate::math;
use crate::stylization::Style;
use crate::tape::{Passage, Record, Tape};

/// What the way back through a block leaves for others.
struct Trace {
    /// Gradients of scale and shift of each layer, granule after granule.
    modulations: [Vec<f32>; LAYERS],
    /// Gradient of the self-attention's output.
    y: Vec<f32>,
    /// Gradient of its context, for each granule.
    contexts: Vec<Vec<f32>>,
}

/// All that the first half of a block needs on the way back.
struct After {
    contexts: Vec<Context>,
    /// For each motion.
    context_gradients: Vec<Vec<f32>>,
    /// For each chunk.
    traces: Vec<Trace>,
}

impl<S: Numbers> Decoder<S> {
    /// The gradient with respect to the condition, `[batch, condition]`, from the gradient of the
    /// output, `[batch, frames, features]`, of the evaluation that was recorded with the same input.
    ///
    /// # Panics
    ///
    /// If the tape is of another input.
    pub fn backward(&self, input: Input<'_>, tape: Tape, gradient: &[f32]) -> Vec<f32> {
        self.check(input);
        let mut lengths = vec![0; input.lengths.len()];
        for passage in &tape.passages {
            lengths[passage.chunk.motion] += passage.chunk.frames();
        }
        assert!(
            lengths == input.lengths && tape.contexts.len() == self.blocks.len(),
            "the tape is of another input"
        );
        let features = self.output.weight.outputs();
        assert_eq!(
            gradient.len(),
            input.lengths.len() * input.frames * features,
            "expected a gradient for every output"
        );
        on_the_pool(|| self.unroll(input, tape, gradient))
    }

    fn unroll(&self, input: Input<'_>, tape: Tape, gradient: &[f32]) -> Vec<f32> {
        let Tape {
            mut passages,
            mut contexts,
            styles,
        } = tape;
        let motions = input.lengths.len();
        let mut modulations = vec![0.0; motions * self.modulations.weight.outputs()];
        // What the block after left for this one; the last has none after it.
        let mut after: Option<After> = None;
        for block in (0..self.blocks.len()).rev() {
            let traces: Vec<Trace> = passages
                .par_iter_mut()
                .enumerate()
                .map(|(place, passage)| {
                    match &after {
                        None => self.leave_backward(passage, input, gradient),
                        Some(after) => self.attend_backward(passage, block + 1, after, place),
                    }
                    let motion = passage.chunk.motion;
                    let text = input.text(block, motion);
                    self.finish_backward(passage, block, text, &styles[motion][block])
                })
                .collect();
            self.gather(&passages, &traces, block, &mut modulations);
            after = Some(After {
                contexts: contexts.pop().expect("one a block"),
                context_gradients: self.context_gradients(&passages, &traces, motions),
                traces,
            });
        }
        // On the first block's attention the condition has no influence.
        self.modulations
            .modulate_backward(input.condition, &modulations)
    }

    fn leave_backward(&self, passage: &mut Passage, input: Input<'_>, gradient: &[f32]) {
        let gradient = &gradient[self.place(&passage.chunk, input)];
        self.output.weight.pull(gradient, &mut passage.hidden);
    }

    /// Back to the output of the self-attention.
    fn finish_backward(
        &self,
        passage: &mut Passage,
        block: usize,
        text: &[f32],
        [first, second, third]: &[Style; LAYERS],
    ) -> Trace {
        let heads = self.heads();
        let weights = &self.blocks[block];
        let Passage {
            chunk,
            hidden: gradient,
            records,
            ..
        } = passage;
        let record = records.last_mut().expect("one a block");
        let mut modulations =
            [(); LAYERS].map(|()| vec![0.0; chunk.granules.len() * 2 * heads.width]);
        let [in_first, in_second, in_third] = &mut modulations;
        let mut y = vec![0.0; gradient.len()];

        let layers = &weights.feed_forward;
        let style = &record.feed_forward_style;
        layers
            .output
            .backward(gradient, third, style, &mut y, chunk, in_third);
        let mut wide = vec![0.0; record.expanded.len()];
        layers.contract.weight.pull(&y, &mut wide);
        gelu_backward(&record.expanded, &mut wide);
        layers.expand.weight.pull_accumulate(&wide, gradient);

        let attention = &weights.cross_attention;
        let style = &record.cross_style;
        attention
            .output
            .backward(gradient, second, style, &mut y, chunk, in_second);
        let mut query = vec![0.0; gradient.len()];
        heads.apply_transposed(&y, text, &mut query);
        heads.softmax_backward(&record.cross_query, &mut query);
        attention.query.weight.pull(&query, &mut y);
        attention
            .norm
            .backward(&mut y, &record.cross_norm, gradient);

        let style = &record.self_style;
        let output = &weights.self_attention.output;
        output.backward(gradient, first, style, &mut y, chunk, in_first);
        let contexts = match block {
            0 => Vec::new(),
            _ => chunk
                .granules(heads.width)
                .map(|range| {
                    let mut out = vec![0.0; heads.width * heads.channels];
                    heads.outer(
                        &record.self_attention.query[range.clone()],
                        &y[range],
                        &mut out,
                    );
                    out
                })
                .collect(),
        };
        Trace {
            modulations,
            y,
            contexts,
        }
    }

    /// Back through queries, keys and values to the block's input.
    fn attend_backward(&self, passage: &mut Passage, block: usize, after: &After, place: usize) {
        let heads = self.heads();
        let attention = &self.blocks[block].self_attention;
        let motion = passage.chunk.motion;
        let context = &after.contexts[motion].values;
        let context_gradient = &after.context_gradients[motion];
        let y = &after.traces[place].y;
        let Record { self_attention, .. } = passage.records.pop().expect("one a block");
        let mut query = vec![0.0; y.len()];
        heads.apply_transposed(y, context, &mut query);
        heads.softmax_backward(&self_attention.query, &mut query);

        let mut key = vec![0.0; y.len()];
        heads.apply_transposed(&self_attention.value, context_gradient, &mut key);
        let rows = context.chunks_exact(heads.channels);
        let means: Vec<f32> = rows
            .zip(context_gradient.chunks_exact(heads.channels))
            .map(|(context, gradient)| math::dot(context, gradient))
            .collect();
        attention::keys_backward(&self_attention.key, &means, &mut key);

        let mut value = vec![0.0; y.len()];
        heads.apply(&self_attention.key, context_gradient, &mut value);

        let mut normed = vec![0.0; query.len()];
        attention.query.weight.pull(&query, &mut normed);
        attention.key.weight.pull_accumulate(&key, &mut normed);
        attention.value.weight.pull_accumulate(&value, &mut normed);
        attention
            .norm
            .backward(&mut normed, &self_attention.norm, &mut passage.hidden);
    }

    /// Gradients of the contexts, for each motion.
    fn context_gradients(
        &self,
        passages: &[Passage],
        traces: &[Trace],
        motions: usize,
    ) -> Vec<Vec<f32>> {
        let heads = self.heads();
        let mut gradients = vec![vec![0.0; heads.width * heads.channels]; motions];
        for (passage, trace) in passages.iter().zip(traces) {
            for part in &trace.contexts {
                math::add(&mut gradients[passage.chunk.motion], part);
            }
        }
        gradients
    }

    /// Sums up a block's gradients of scales and shifts over frames, `[motion, block, layer]`.
    fn gather(
        &self,
        passages: &[Passage],
        traces: &[Trace],
        block: usize,
        modulations: &mut [f32],
    ) {
        let size = 2 * self.width();
        for (passage, trace) in passages.iter().zip(traces) {
            for (layer, parts) in trace.modulations.iter().enumerate() {
                let place = passage.chunk.motion * self.blocks.len() + block;
                let out = &mut modulations[(place * LAYERS + layer) * size..][..size];
                for part in parts.chunks_exact(size) {
                    math::add(out, part);
                }
            }
        }
    }
}

/// Turns the gradient of GELU into that of its argument.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2+fma"))]
fn gelu_backward(x: &[f32], gradient: &mut [f32]) {
    for (g, x) in gradient.iter_mut().zip(x) {
        *g *= math::normal_cdf(*x) + x * math::normal_pdf(*x);
    }
}
