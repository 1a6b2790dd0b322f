//! A transformer that normalises after each of its parts, as MDM's, and its forward pass.
//!
//! The rows of a motion are its frames and, in an encoder, the conditioning token before them. They are split into chunks. A
//! chunk passes through a layer on one thread; the chunks of a motion meet once a layer, where their rows attend to each other.

mod attention;
mod backward;
mod gradients;

use faer::Accum;
use rayon::prelude::*;

use crate::FloatStorage;
use crate::chunk::Chunk;
use crate::forward::gelu;
use crate::linear::{Linear, product, rows, rows_mut};
use crate::math;
use crate::norm::{LayerNorm, NormalizedRows, scale_and_shift};
use attention::{Heads, Probabilities};
pub use backward::TransformerGradients;
pub use gradients::TransformerWeightGradients;

/// The weights of a transformer.
///
/// It is an encoder, in which the frames and one conditioning token before them attend to each other, or a decoder, in which
/// the frames attend to conditioning tokens, if its layers have a [`text_attention`](TransformerLayer::text_attention).
#[derive(Clone, Debug)]
pub struct Transformer<S> {
    /// The number of heads of each attention layer.
    pub heads: usize,
    /// The layer from pose features to the hidden state.
    pub pose_embedding: Linear<S>,
    /// The layers in the order of their evaluation.
    pub layers: Vec<TransformerLayer<S>>,
    /// The layer from the hidden state to pose features.
    pub output: Linear<S>,
}

/// The weights of a layer.
#[derive(Clone, Debug)]
pub struct TransformerLayer<S> {
    /// The attention of the rows to each other.
    pub self_attention: SoftmaxAttention<S>,
    /// The attention of the frames to the conditioning tokens, in a decoder.
    pub text_attention: Option<SoftmaxAttention<S>>,
    /// The first of the feed-forward layers, before a GELU.
    pub expand: Linear<S>,
    /// The second of the feed-forward layers.
    pub contract: Linear<S>,
    /// The norm after each of the parts, in their order.
    pub norms: Vec<LayerNorm<S>>,
}

/// The weights of an attention with softmax over keys.
#[derive(Clone, Debug)]
pub struct SoftmaxAttention<S> {
    /// The projection to queries, keys and values, in this order.
    pub in_proj: Linear<S>,
    /// The projection after the attention.
    pub out_proj: Linear<S>,
}

/// The input of a transformer.
#[derive(Clone, Copy, Debug)]
pub struct TransformerInput<'a> {
    /// The pose features, `[motions, frames, features]`.
    pub poses: &'a [f32],
    /// The number of frames of each motion, with padding.
    pub frames: usize,
    /// The number of frames of each motion; further frames are padding, whose output is 0.
    pub lengths: &'a [usize],
    /// What is added to the rows at their positions, `[rows, width]`.
    pub positions: &'a [f32],
    /// The conditioning tokens, `[motions, tokens, width]`: one for each motion of an encoder.
    pub tokens: &'a [f32],
    /// What is subtracted from the scores of tokens, `[motions, tokens]`; for decoders.
    pub token_penalty: Option<&'a [f32]>,
    /// What is added for each motion: to gain and bias of each norm of each layer, and then to the tokens at the input of
    /// each layer, `[motions, offsets]`.
    pub offsets: Option<&'a [f32]>,
}

/// The rows of a chunk, as they pass through the layers.
struct RowState {
    chunk: Chunk,
    hidden: Vec<f32>,
    /// Queries, keys and values of the current layer.
    projected: Vec<f32>,
}

/// What the gradient needs of a chunk in one layer.
#[derive(Debug, Default)]
struct LayerActivations {
    projected: Vec<f32>,
    probabilities: Probabilities,
    text_query: Vec<f32>,
    text_probabilities: Probabilities,
    expanded: Vec<f32>,
    norms: Vec<NormalizedRows>,
}

/// The keys and values of each motion in one layer, `[rows, 2 · width]` and `[tokens, 2 · width]`.
#[derive(Debug)]
struct KeysAndValues {
    rows: Vec<Vec<f32>>,
    tokens: Vec<Vec<f32>>,
}

/// What the gradient needs of an evaluation.
#[derive(Debug)]
pub struct TransformerTape {
    /// The chunks, each with its activations layer by layer.
    chunks: Vec<(Chunk, Vec<LayerActivations>)>,
    /// One for each layer.
    keys_and_values: Vec<KeysAndValues>,
}

/// The offsets of one motion in one layer.
#[derive(Clone, Copy)]
struct LayerOffsets<'a> {
    /// The gain and then the bias of each norm.
    norms: &'a [f32],
    token: &'a [f32],
}

impl<S: FloatStorage> Transformer<S> {
    /// Computes the output, `[motions, frames, features]`.
    ///
    /// # Panics
    ///
    /// If the sizes of weights and input do not match.
    pub fn evaluate(&self, input: TransformerInput<'_>) -> Vec<f32> {
        self.forward(input, false).0
    }

    /// Computes the output and what [`backward`](Self::backward) needs.
    ///
    /// # Panics
    ///
    /// If the sizes of weights and input do not match.
    pub fn record(&self, input: TransformerInput<'_>) -> (Vec<f32>, TransformerTape) {
        self.forward(input, true)
    }

    fn width(&self) -> usize {
        self.pose_embedding.weight.outputs()
    }

    fn heads(&self) -> Heads {
        Heads {
            count: self.heads,
            width: self.width(),
        }
    }

    fn is_encoder(&self) -> bool {
        { self.layers.iter() }.all(|layer| layer.text_attention.is_none())
    }

    /// Returns the number of rows before the frames.
    fn rows_before(&self) -> usize {
        usize::from(self.is_encoder())
    }

    /// Returns the number of tokens of each motion.
    fn token_count(&self, input: TransformerInput<'_>) -> usize {
        input.tokens.len() / (input.lengths.len() * self.width()).max(1)
    }

    /// Returns the number of offsets of each motion: of the norms, and of the tokens.
    fn offset_counts(&self) -> [usize; 2] {
        let norms: usize = self.layers.iter().map(|layer| layer.norms.len()).sum();
        [norms * 2 * self.width(), self.layers.len() * self.width()]
    }

    fn layer_offsets<'a>(
        &self,
        input: TransformerInput<'a>,
        motion: usize,
        layer: usize,
    ) -> Option<LayerOffsets<'a>> {
        let (width, [norms, tokens]) = (self.width(), self.offset_counts());
        let all = &input.offsets?[motion * (norms + tokens)..][..norms + tokens];
        let of_layer = self.layers[layer].norms.len() * 2 * width;
        Some(LayerOffsets {
            norms: &all[layer * of_layer..][..of_layer],
            token: &all[norms + layer * width..][..width],
        })
    }

    fn forward(&self, input: TransformerInput<'_>, records: bool) -> (Vec<f32>, TransformerTape) {
        let before = self.rows_before();
        let lengths: Vec<usize> = input.lengths.iter().map(|length| length + before).collect();
        // One granule a chunk, so that sums over chunks do not depend on the number of threads.
        let chunks = Chunk::split(&lengths, usize::MAX);
        let mut states: Vec<RowState> = { chunks.into_par_iter() }
            .map(|chunk| self.embed(chunk, input))
            .collect();
        let mut activations: Vec<Vec<LayerActivations>> =
            states.iter().map(|_| Vec::new()).collect();
        let mut keys_and_values = Vec::new();
        for (index, layer) in self.layers.iter().enumerate() {
            states.par_iter_mut().for_each(|state| {
                let offsets = self.layer_offsets(input, state.chunk.motion, index);
                if let (Some(offsets), true) = (offsets, before > 0 && state.chunk.first == 0) {
                    math::add(&mut state.hidden[..self.width()], offsets.token);
                }
                let count = layer.self_attention.in_proj.weight.outputs();
                state.projected.resize(state.chunk.frames() * count, 0.0);
                { &layer.self_attention.in_proj }.forward(&state.hidden, &mut state.projected);
            });
            let shared = KeysAndValues {
                rows: self.gather_keys_and_values(&states, &lengths),
                tokens: self.project_tokens(input, index),
            };
            let finished: Vec<LayerActivations> = { states.par_iter_mut() }
                .map(|state| self.finish_layer(state, index, &shared, input, records))
                .collect();
            if records {
                for (all, one) in activations.iter_mut().zip(finished) {
                    all.push(one);
                }
                keys_and_values.push(shared);
            }
        }
        let output = self.output(&states, input);
        let chunks = states.into_iter().map(|state| state.chunk);
        let tape = TransformerTape {
            chunks: chunks.zip(activations).collect(),
            keys_and_values,
        };
        (output, tape)
    }

    /// Computes the rows before the first layer.
    fn embed(&self, chunk: Chunk, input: TransformerInput<'_>) -> RowState {
        let (width, before) = (self.width(), self.rows_before());
        let mut hidden = vec![0.0; chunk.frames() * width];
        let range = self.pose_range(&chunk, input);
        let frames = range.len() / self.pose_embedding.weight.inputs();
        let (token, motion) = hidden.split_at_mut((chunk.frames() - frames) * width);
        if before > 0 && !token.is_empty() {
            token.copy_from_slice(&input.tokens[chunk.motion * width..][..width]);
        }
        self.pose_embedding.forward(&input.poses[range], motion);
        let positions = &input.positions[chunk.first * width..][..hidden.len()];
        math::add(&mut hidden, positions);
        RowState {
            chunk,
            hidden,
            projected: Vec::new(),
        }
    }

    /// Returns the place of a chunk's frames among the pose features.
    fn pose_range(&self, chunk: &Chunk, input: TransformerInput<'_>) -> std::ops::Range<usize> {
        let (before, features) = (self.rows_before(), self.pose_embedding.weight.inputs());
        let first = chunk.first.saturating_sub(before);
        let last = chunk.first + chunk.frames() - before;
        let start = chunk.motion * input.frames;
        (start + first) * features..(start + last) * features
    }

    /// Copies the keys and values of all rows of each motion.
    fn gather_keys_and_values(&self, states: &[RowState], lengths: &[usize]) -> Vec<Vec<f32>> {
        let width = self.width();
        let of_motion = |motion: usize| {
            let mut gathered = Vec::with_capacity(lengths[motion] * 2 * width);
            for state in states.iter().filter(|state| state.chunk.motion == motion) {
                for row in state.projected.chunks_exact(3 * width) {
                    gathered.extend_from_slice(&row[width..]);
                }
            }
            gathered
        };
        (0..lengths.len()).into_par_iter().map(of_motion).collect()
    }

    /// Computes the keys and values of the tokens of each motion; none in an encoder.
    fn project_tokens(&self, input: TransformerInput<'_>, layer: usize) -> Vec<Vec<f32>> {
        let Some(attention) = &self.layers[layer].text_attention else {
            return Vec::new();
        };
        let (width, count) = (self.width(), self.token_count(input));
        let of_motion = |motion: usize| {
            let mut tokens = input.tokens[motion * count * width..][..count * width].to_vec();
            if let Some(offsets) = self.layer_offsets(input, motion, layer) {
                for token in tokens.chunks_exact_mut(width) {
                    math::add(token, offsets.token);
                }
            }
            let mut projected = vec![0.0; count * 2 * width];
            attention
                .in_proj
                .forward_part(&tokens, width..3 * width, &mut projected);
            projected
        };
        let motions = 0..input.lengths.len();
        motions.into_par_iter().map(of_motion).collect()
    }

    /// Computes all of a layer but the projection to queries, keys and values.
    fn finish_layer(
        &self,
        state: &mut RowState,
        index: usize,
        shared: &KeysAndValues,
        input: TransformerInput<'_>,
        records: bool,
    ) -> LayerActivations {
        let (width, heads, layer) = (self.width(), self.heads(), &self.layers[index]);
        let motion = state.chunk.motion;
        let offsets = self.layer_offsets(input, motion, index);
        let mut activations = LayerActivations::default();
        let (mut y, mut sum) = (vec![0.0; state.hidden.len()], vec![0.0; state.hidden.len()]);
        let mut norms = layer.norms.iter().enumerate();
        let mut add =
            |hidden: &mut Vec<f32>, part: &mut [f32], activations: &mut LayerActivations| {
                math::add(part, hidden);
                let (place, norm) = norms.next().expect("a norm for each part");
                let mut normalized = NormalizedRows::default();
                normalized.normalize(part, width, norm.epsilon);
                let [gain, bias] = norm_weights(norm, offsets, place);
                scale_and_shift(&normalized.rows, &gain, &bias, hidden);
                if records {
                    activations.norms.push(normalized);
                }
            };

        let query = rows(&state.projected, 3 * width).subcols(0, width);
        let keys_and_values = &shared.rows[motion];
        activations.probabilities = heads.attend(query, keys_and_values, None, &mut y, records);
        layer.self_attention.out_proj.forward(&y, &mut sum);
        add(&mut state.hidden, &mut sum, &mut activations);

        if let Some(attention) = &layer.text_attention {
            let mut query = vec![0.0; state.hidden.len()];
            attention
                .in_proj
                .forward_part(&state.hidden, 0..width, &mut query);
            let count = self.token_count(input);
            let penalty = { input.token_penalty }.map(|all| &all[motion * count..][..count]);
            let tokens = &shared.tokens[motion];
            activations.text_probabilities =
                heads.attend(rows(&query, width), tokens, penalty, &mut y, records);
            attention.out_proj.forward(&y, &mut sum);
            add(&mut state.hidden, &mut sum, &mut activations);
            if records {
                activations.text_query = query;
            }
        }

        let mut expanded = vec![0.0; state.chunk.frames() * layer.expand.weight.outputs()];
        layer.expand.forward(&state.hidden, &mut expanded);
        let mut active = vec![0.0; expanded.len()];
        gelu(&expanded, &mut active);
        layer.contract.forward(&active, &mut sum);
        add(&mut state.hidden, &mut sum, &mut activations);
        if records {
            activations.expanded = expanded;
            activations.projected = std::mem::take(&mut state.projected);
        }
        activations
    }

    /// Computes the pose features of all chunks and copies them to their places.
    fn output(&self, states: &[RowState], input: TransformerInput<'_>) -> Vec<f32> {
        let (width, features) = (self.width(), self.output.weight.outputs());
        let parts: Vec<Vec<f32>> = { states.par_iter() }
            .map(|state| {
                let frames = self.pose_range(&state.chunk, input).len() / features;
                let hidden = &state.hidden[(state.chunk.frames() - frames) * width..];
                let mut out = vec![0.0; frames * features];
                self.output.forward(hidden, &mut out);
                out
            })
            .collect();
        let mut out = vec![0.0; input.lengths.len() * input.frames * features];
        for (state, part) in states.iter().zip(parts) {
            out[self.pose_range(&state.chunk, input)].copy_from_slice(&part);
        }
        out
    }
}

/// Returns the gain and the bias of a norm with what is added to them.
fn norm_weights<S: FloatStorage>(
    norm: &LayerNorm<S>,
    offsets: Option<LayerOffsets<'_>>,
    place: usize,
) -> [Vec<f32>; 2] {
    let mut weights = [&norm.gamma, &norm.beta].map(|weights| weights.as_ref().to_vec());
    if let Some(offsets) = offsets {
        let width = norm.width();
        let own = offsets.norms[place * 2 * width..].chunks_exact(width);
        for (weights, offset) in weights.iter_mut().zip(own) {
            math::add(weights, offset);
        }
    }
    weights
}

impl<S: FloatStorage> Linear<S> {
    /// Computes some of the outputs, `out = x · W + b`.
    fn forward_part(&self, x: &[f32], outputs: std::ops::Range<usize>, out: &mut [f32]) {
        let bias = &self.bias.as_ref()[outputs.clone()];
        for row in out.chunks_exact_mut(bias.len()) {
            row.copy_from_slice(bias);
        }
        let weight = self.weight.view().subcols(outputs.start, outputs.len());
        let x = rows(x, self.weight.inputs());
        product(x, weight, rows_mut(out, outputs.len()), Accum::Add);
    }

    /// Computes `out += g · Wᵀ` for the gradient of some of the outputs.
    fn backward_part(&self, gradient: &[f32], outputs: std::ops::Range<usize>, out: &mut [f32]) {
        let weight = self.weight.view().subcols(outputs.start, outputs.len());
        let gradient = rows(gradient, outputs.len());
        let out = rows_mut(out, self.weight.inputs());
        product(gradient, weight.transpose(), out, Accum::Add);
    }
}
