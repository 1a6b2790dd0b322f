//! The gradient of a transformer's output with respect to the conditioning tokens and the offsets.

use rayon::prelude::*;

use super::{
    KeysAndValues, LayerActivations, LayerOffsets, Transformer, TransformerInput, TransformerTape,
    norm_weights,
};
use crate::FloatStorage;
use crate::backward::gelu_backward;
use crate::chunk::Chunk;
use crate::linear::rows;
use crate::math;
use crate::norm::{LayerNorm, NormalizedRows};

/// The gradients of an evaluation.
#[derive(Clone, Debug)]
pub struct TransformerGradients {
    /// With respect to the conditioning tokens, `[motions, tokens, width]`.
    pub tokens: Vec<f32>,
    /// With respect to the offsets, `[motions, offsets]`, whether the input had any or not.
    pub offsets: Vec<f32>,
}

/// The gradients of all weights, summed over a group of chunks; `None` if nobody asks for them.
pub(super) type WeightGradients = Option<Transformer<Vec<f32>>>;

/// The gradients of a chunk on its way through a layer.
struct ChunkGradient {
    /// Of the rows.
    hidden: Vec<f32>,
    /// Of the queries of the attention to each other.
    query: Vec<f32>,
    /// Of the keys and values of all rows of the motion.
    rows: Vec<f32>,
    /// Of the keys and values of the tokens.
    tokens: Vec<f32>,
    /// Of the gains and biases of the layer's norms.
    norms: Vec<f32>,
}

impl<S: FloatStorage> Transformer<S> {
    /// Computes the gradients of a recorded evaluation from the gradient of its output.
    ///
    /// # Panics
    ///
    /// If the sizes do not match.
    pub fn backward(
        &self,
        input: TransformerInput<'_>,
        tape: &TransformerTape,
        gradient: &[f32],
    ) -> TransformerGradients {
        let mut none: Vec<WeightGradients> = vec![None; tape.chunks.len()];
        self.backpropagate(input, tape, gradient, 1, &mut none)
    }

    /// Computes the gradients of a recorded evaluation, and adds those of the weights to those of the groups that ask for them.
    /// A group has `group` chunks.
    pub(super) fn backpropagate(
        &self,
        input: TransformerInput<'_>,
        tape: &TransformerTape,
        gradient: &[f32],
        group: usize,
        weights: &mut [WeightGradients],
    ) -> TransformerGradients {
        let (width, before) = (self.width(), self.rows_before());
        let [norm_count, token_offsets] = self.offset_counts();
        let offset_count = norm_count + token_offsets;
        let motions = input.lengths.len();
        let mut gradients = TransformerGradients {
            tokens: vec![0.0; input.tokens.len()],
            offsets: vec![0.0; motions * offset_count],
        };
        let mut states: Vec<ChunkGradient> = { tape.chunks.par_chunks(group) }
            .zip(weights.par_iter_mut())
            .flat_map_iter(|(chunks, weights)| {
                let of_chunk = |(chunk, activations): &(Chunk, Vec<LayerActivations>)| {
                    self.output_backward((chunk, activations), input, gradient, weights)
                };
                chunks.iter().map(of_chunk).collect::<Vec<_>>()
            })
            .collect();
        for (index, shared) in tape.keys_and_values.iter().enumerate().rev() {
            for_each_chunk(
                &mut states,
                tape,
                group,
                weights,
                |state, chunk, activations, weights| {
                    let offsets = self.layer_offsets(input, chunk.motion, index);
                    let layer = (chunk, &activations[index]);
                    self.begin_layer_backward(state, index, layer, shared, offsets, weights);
                    if let Some(weights) = weights {
                        self.add_text_gradients(state, index, chunk, input, weights);
                    }
                },
            );
            let row_gradients = self.sum_over_chunks(&states, tape, motions);
            for_each_chunk(
                &mut states,
                tape,
                group,
                weights,
                |state, chunk, activations, weights| {
                    let own = &row_gradients[chunk.motion];
                    let own = &own[chunk.first * 2 * width..][..chunk.frames() * 2 * width];
                    if let Some(weights) = weights {
                        let x = self.layer_input(index, (chunk, activations), input);
                        let in_proj = &mut weights.layers[index].self_attention.in_proj;
                        in_proj.add_gradients_of_part(&x, &state.query, 0..width);
                        in_proj.add_gradients_of_part(&x, own, width..3 * width);
                    }
                    self.finish_layer_backward(state, index, own);
                },
            );
            let of_layer = self.layers[index].norms.len() * 2 * width;
            let token_place = norm_count + index * width;
            for (state, (chunk, _)) in states.iter().zip(&tape.chunks) {
                let offsets = &mut gradients.offsets[chunk.motion * offset_count..][..offset_count];
                math::add(&mut offsets[index * of_layer..][..of_layer], &state.norms);
                if before > 0 && chunk.first == 0 {
                    math::add(&mut offsets[token_place..][..width], &state.hidden[..width]);
                }
                if let Some(attention) = &self.layers[index].text_attention {
                    let count = self.token_count(input) * width;
                    let mut tokens = vec![0.0; count];
                    let range = width..3 * width;
                    { &attention.in_proj }.backward_part(&state.tokens, range, &mut tokens);
                    math::add_rows(&mut offsets[token_place..][..width], &tokens);
                    let all = &mut gradients.tokens[chunk.motion * count..][..count];
                    math::add(all, &tokens);
                }
            }
        }
        for_each_chunk(
            &mut states,
            tape,
            group,
            weights,
            |state, chunk, _, weights| {
                if let Some(weights) = weights {
                    let range = self.pose_range(chunk, input);
                    let frames = range.len() / self.pose_embedding.weight.inputs();
                    let gradient = &state.hidden[(chunk.frames() - frames) * width..];
                    { &mut weights.pose_embedding }.add_gradients(&input.poses[range], gradient);
                }
            },
        );
        if before > 0 {
            for (state, (chunk, _)) in states.iter().zip(&tape.chunks) {
                if chunk.first == 0 {
                    let token = &mut gradients.tokens[chunk.motion * width..][..width];
                    token.copy_from_slice(&state.hidden[..width]);
                }
            }
        }
        gradients
    }

    /// Computes the gradient of the rows after the last layer.
    fn output_backward(
        &self,
        (chunk, activations): (&Chunk, &[LayerActivations]),
        input: TransformerInput<'_>,
        gradient: &[f32],
        weights: &mut WeightGradients,
    ) -> ChunkGradient {
        let (width, range) = (self.width(), self.pose_range(chunk, input));
        let frames = range.len() / self.output.weight.outputs();
        let start = (chunk.frames() - frames) * width;
        let mut hidden = vec![0.0; chunk.frames() * width];
        let gradient = &gradient[range];
        self.output.weight.backward(gradient, &mut hidden[start..]);
        if let Some(weights) = weights {
            let x = self.layer_input(self.layers.len(), (chunk, activations), input);
            weights.output.add_gradients(&x[start..], gradient);
        }
        ChunkGradient {
            hidden,
            query: Vec::new(),
            rows: Vec::new(),
            tokens: Vec::new(),
            norms: Vec::new(),
        }
    }

    /// Computes the gradients of a layer up to its attention of rows to each other.
    fn begin_layer_backward(
        &self,
        state: &mut ChunkGradient,
        index: usize,
        (chunk, activations): (&Chunk, &LayerActivations),
        shared: &KeysAndValues,
        offsets: Option<LayerOffsets<'_>>,
        weights: &mut WeightGradients,
    ) {
        let (width, heads, layer) = (self.width(), self.heads(), &self.layers[index]);
        state.norms = vec![0.0; layer.norms.len() * 2 * width];
        let norms = layer.norms.iter().zip(&activations.norms).enumerate();
        let mut norms = norms.rev();
        let mut back = |gradient: &mut Vec<f32>, norm_gradients: &mut [f32]| {
            let (place, (norm, normalized)) = norms.next().expect("a norm for each part");
            let own = &mut norm_gradients[place * 2 * width..][..2 * width];
            norm_backward(norm, normalized, offsets, place, gradient, own);
        };

        back(&mut state.hidden, &mut state.norms);
        let mut inner = vec![0.0; activations.expanded.len()];
        layer.contract.weight.backward(&state.hidden, &mut inner);
        gelu_backward(&activations.expanded, &mut inner);
        if let Some(weights) = weights {
            let gradients = [&inner[..], &state.hidden];
            self.add_feed_forward_gradients(index, activations, gradients, weights);
        }
        let expand = &layer.expand.weight;
        expand.backward_accumulate(&inner, &mut state.hidden);

        let mut y = vec![0.0; state.hidden.len()];
        if let Some(attention) = &layer.text_attention {
            back(&mut state.hidden, &mut state.norms);
            attention.out_proj.weight.backward(&state.hidden, &mut y);
            let keys_and_values = &shared.tokens[chunk.motion];
            let own =
                { weights.as_mut() }.and_then(|all| all.layers[index].text_attention.as_mut());
            if let Some(own) = own {
                let probabilities = &activations.text_probabilities;
                let gradient = &state.hidden;
                heads.add_projection_gradients(
                    keys_and_values,
                    probabilities,
                    gradient,
                    &mut own.out_proj,
                );
            }
            state.tokens = vec![0.0; keys_and_values.len()];
            let query = heads.backward(
                rows(&activations.text_query, width),
                keys_and_values,
                &activations.text_probabilities,
                &y,
                &mut state.tokens,
            );
            if let Some(own) =
                { weights.as_mut() }.and_then(|all| all.layers[index].text_attention.as_mut())
            {
                let x = self.norm_output(index, 0, activations);
                own.in_proj.add_gradients_of_part(&x, &query, 0..width);
            }
            { &attention.in_proj }.backward_part(&query, 0..width, &mut state.hidden);
        }

        back(&mut state.hidden, &mut state.norms);
        let attention = &layer.self_attention;
        attention.out_proj.weight.backward(&state.hidden, &mut y);
        let keys_and_values = &shared.rows[chunk.motion];
        if let Some(weights) = weights {
            let own = &mut weights.layers[index];
            let (probabilities, gradient) = (&activations.probabilities, &state.hidden);
            let projection = &mut own.self_attention.out_proj;
            heads.add_projection_gradients(keys_and_values, probabilities, gradient, projection);
            let of_norms = state.norms.chunks_exact(2 * width);
            for (own, gradient) in own.norms.iter_mut().zip(of_norms) {
                math::add(&mut own.gamma, &gradient[..width]);
                math::add(&mut own.beta, &gradient[width..]);
            }
        }
        state.rows = vec![0.0; keys_and_values.len()];
        state.query = heads.backward(
            rows(&activations.projected, 3 * width).subcols(0, width),
            keys_and_values,
            &activations.probabilities,
            &y,
            &mut state.rows,
        );
    }

    /// Adds the gradients of the projection of the tokens to keys and values, in a decoder.
    fn add_text_gradients(
        &self,
        state: &ChunkGradient,
        index: usize,
        chunk: &Chunk,
        input: TransformerInput<'_>,
        weights: &mut Transformer<Vec<f32>>,
    ) {
        let Some(attention) = &mut weights.layers[index].text_attention else {
            return;
        };
        let (width, count) = (self.width(), self.token_count(input) * self.width());
        let tokens = &input.tokens[chunk.motion * count..][..count];
        { &mut attention.in_proj }.add_gradients_of_part(tokens, &state.tokens, width..3 * width);
    }

    /// Sums the gradients of keys and values over the chunks of each motion.
    fn sum_over_chunks(
        &self,
        states: &[ChunkGradient],
        tape: &TransformerTape,
        motions: usize,
    ) -> Vec<Vec<f32>> {
        let of_motion = |motion: usize| {
            let own = states.iter().zip(&tape.chunks);
            let mut own = own.filter(|(_, (chunk, _))| chunk.motion == motion);
            let mut sum = own
                .next()
                .map_or(Vec::new(), |(state, _)| state.rows.clone());
            own.for_each(|(state, _)| math::add(&mut sum, &state.rows));
            sum
        };
        (0..motions).into_par_iter().map(of_motion).collect()
    }

    /// Computes the gradient of the rows before a layer. `own` is the gradient of the keys and values of these rows.
    fn finish_layer_backward(&self, state: &mut ChunkGradient, index: usize, own: &[f32]) {
        let width = self.width();
        let in_proj = &self.layers[index].self_attention.in_proj;
        in_proj.backward_part(&state.query, 0..width, &mut state.hidden);
        in_proj.backward_part(own, width..3 * width, &mut state.hidden);
    }
}

/// Calls a function for every chunk, in parallel for the groups of chunks.
fn for_each_chunk(
    states: &mut [ChunkGradient],
    tape: &TransformerTape,
    group: usize,
    weights: &mut [WeightGradients],
    step: impl Fn(&mut ChunkGradient, &Chunk, &[LayerActivations], &mut WeightGradients) + Sync,
) {
    { states.par_chunks_mut(group) }
        .zip(tape.chunks.par_chunks(group))
        .zip(weights)
        .for_each(|((states, chunks), weights)| {
            for (state, (chunk, activations)) in states.iter_mut().zip(chunks) {
                step(state, chunk, activations, weights);
            }
        });
}

/// Turns the gradient of a norm's output into that of its input, and adds those of its gain and bias.
fn norm_backward<S: FloatStorage>(
    norm: &LayerNorm<S>,
    normalized: &NormalizedRows,
    offsets: Option<LayerOffsets<'_>>,
    place: usize,
    gradient: &mut [f32],
    weight_gradients: &mut [f32],
) {
    let width = norm.width();
    let (gain_gradient, bias_gradient) = weight_gradients.split_at_mut(width);
    math::add_products(gain_gradient, gradient, &normalized.rows);
    math::add_rows(bias_gradient, gradient);
    let [gain, _] = norm_weights(norm, offsets, place);
    math::scale(gradient, &gain);
    normalized.backward(gradient, width);
}
