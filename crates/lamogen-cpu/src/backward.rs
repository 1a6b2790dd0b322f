//! The backward pass, from the gradient of the output to that of the condition, and to those of the weights if they are
//! requested.
//!
//! With `C = softmax(k)ᵀ v` and `y = softmax(q) C`, the gradient of the keys before their softmax is
//! `K ⊙ (v Ċᵀ - r)`, where `K` is the softmax and `rᵢ = Σⱼ Cᵢⱼ Ċᵢⱼ`. The sum over frames that the gradient of the softmax
//! needs is already contained in `C`. So chunks meet only once per block, for `Ċ = softmax(q)ᵀ ẏ`.

use multiversion::multiversion;
use rayon::prelude::*;

use crate::FloatStorage;
use crate::attention::{self, AttentionContext};
use crate::chunk::Chunk;
use crate::decoder::{Decoder, DecoderBlock, DecoderInput, STYLIZATION_LAYERS, run_in_pool};
use crate::forward::gelu;
use crate::math;
use crate::stylization::{ParameterGradients, StyleParameters};
use crate::tape::{BlockActivations, ChunkState, RecordMode, Tape};

/// The gradients that the backward pass of one chunk through the second half of a block computes.
struct ChunkGradients {
    /// The gradients of the scale and shift of each stylization layer, granule by granule.
    modulations: [Vec<f32>; STYLIZATION_LAYERS],
    /// The gradient of the output of the self-attention.
    y: Vec<f32>,
    /// The gradient of the context of the self-attention, for each granule.
    contexts: Vec<Vec<f32>>,
    /// The gradient of the context of the text, for each granule. Empty if no gradients of weights are requested.
    texts: Vec<Vec<f32>>,
}

/// Adjacent chunks and the sums of their weights' gradients.
type ChunkGroup<'a> = (&'a mut [ChunkState], &'a mut WeightGradients);

/// The sums of the weights' gradients, or `None` if they are not requested.
pub(crate) type WeightGradients = Option<Decoder<Vec<f32>>>;

/// The inputs of the backward pass through the first half of a block, the self-attention.
struct PendingSelfAttention {
    /// The contexts of the self-attention, for each motion.
    contexts: Vec<AttentionContext>,
    /// The gradients of the contexts, for each motion.
    context_gradients: Vec<Vec<f32>>,
    /// The gradients from the second half of the block, for each chunk.
    chunk_gradients: Vec<ChunkGradients>,
}

impl<S: FloatStorage> Decoder<S> {
    /// Computes the gradient with respect to the condition, `[batch, condition]`.
    ///
    /// `gradient` is the gradient of the output, `[batch, frames, features]`. The tape must have been recorded with the
    /// same input.
    ///
    /// # Panics
    ///
    /// If the tape belongs to another input.
    pub fn backward(&self, input: DecoderInput<'_>, tape: Tape, gradient: &[f32]) -> Vec<f32> {
        self.check_tape(input, &tape, gradient);
        run_in_pool(|| {
            let modulations = self.modulation_gradient(input, tape, gradient);
            self.modulations
                .modulate_backward(input.condition, &modulations)
        })
    }

    /// Computes the gradient with respect to the scales and shifts of all stylization layers,
    /// `[batch, outputs of the modulations]`.
    ///
    /// The arguments are those of [`backward`](Self::backward).
    ///
    /// # Panics
    ///
    /// In the same cases as [`backward`](Self::backward).
    pub fn backward_to_modulation(
        &self,
        input: DecoderInput<'_>,
        tape: Tape,
        gradient: &[f32],
    ) -> Vec<f32> {
        self.check_tape(input, &tape, gradient);
        run_in_pool(|| self.modulation_gradient(input, tape, gradient))
    }

    fn modulation_gradient(
        &self,
        input: DecoderInput<'_>,
        tape: Tape,
        gradient: &[f32],
    ) -> Vec<f32> {
        let mut no_weights: Vec<WeightGradients> = tape.chunks.iter().map(|_| None).collect();
        self.backpropagate(input, tape, gradient, &mut no_weights, &mut [])
            .0
    }

    /// Computes the gradient with respect to the noisy motion, `[batch, frames, features]`, which is 0 past a motion's
    /// length.
    ///
    /// The arguments are those of [`backward`](Self::backward), but the tape must come from
    /// [`record_for_training`](Self::record_for_training).
    ///
    /// # Panics
    ///
    /// If the tape belongs to another input, or was not recorded for training.
    pub fn backward_to_motion(
        &self,
        input: DecoderInput<'_>,
        tape: Tape,
        gradient: &[f32],
    ) -> Vec<f32> {
        self.check_tape(input, &tape, gradient);
        assert!(
            tape.mode == RecordMode::ForWeights,
            "the tape was not recorded for training"
        );
        run_in_pool(|| {
            let mut no_weights: Vec<WeightGradients> = tape.chunks.iter().map(|_| None).collect();
            let (_, states) = self.backpropagate(input, tape, gradient, &mut no_weights, &mut []);
            let motion_gradients = states.par_iter().map(|state| {
                let range = self.batch_range(&state.chunk, input);
                let mut gradient = vec![0.0; range.len()];
                self.pose_embedding
                    .weight
                    .backward(&state.hidden, &mut gradient);
                (range, gradient)
            });
            let motion_gradients: Vec<_> = motion_gradients.collect();
            let mut out = vec![0.0; input.x_t.len()];
            for (range, gradient) in motion_gradients {
                out[range].copy_from_slice(&gradient);
            }
            out
        })
    }

    /// Panics if the tape or the gradient does not belong to this input.
    pub(crate) fn check_tape(&self, input: DecoderInput<'_>, tape: &Tape, gradient: &[f32]) {
        self.check(input);
        let mut lengths = vec![0; input.lengths.len()];
        for state in &tape.chunks {
            lengths[state.chunk.motion] += state.chunk.frames();
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
    }

    /// Runs the backward pass through all blocks.
    ///
    /// Returns the gradients of all scales and shifts, `[batch, outputs of the modulations]`, and the states of the chunks.
    /// If the tape was recorded for training, the states then hold the gradient of the first block's input.
    ///
    /// Each element of `weight_gradients` is shared by a group of adjacent chunks, whose gradients are added in the order of
    /// the chunks. `texts` is either empty or has one vector for each block, to which the gradient of the block's text
    /// context is written.
    pub(crate) fn backpropagate(
        &self,
        input: DecoderInput<'_>,
        tape: Tape,
        gradient: &[f32],
        weight_gradients: &mut [WeightGradients],
        texts: &mut [Vec<f32>],
    ) -> (Vec<f32>, Vec<ChunkState>) {
        let Tape {
            chunks: mut states,
            mut contexts,
            styles,
            mode,
        } = tape;
        let motions = input.lengths.len();
        let mut modulations = vec![0.0; motions * self.modulations.weight.outputs()];
        let group_size = states.len().div_ceil(weight_gradients.len());
        // The self-attention of the following block, which is still to be differentiated. The last block has no following
        // block.
        let mut pending: Option<PendingSelfAttention> = None;
        for block in (0..self.blocks.len()).rev() {
            let of_group = |(group, (states, weight_gradients)): (usize, ChunkGroup<'_>)| {
                let states = states.iter_mut().enumerate();
                let chunk_gradients = states.map(|(index, state)| {
                    match &pending {
                        None => {
                            self.project_output_backward(state, input, gradient, weight_gradients)
                        }
                        Some(pending) => {
                            let gradients = &pending.chunk_gradients[group * group_size + index];
                            self.begin_block_backward(
                                state,
                                block + 1,
                                pending,
                                gradients,
                                weight_gradients,
                            );
                        }
                    }
                    let motion = state.chunk.motion;
                    let text = input.text(block, motion);
                    let styles = &styles[motion][block];
                    self.finish_block_backward(state, (block, mode), text, styles, weight_gradients)
                });
                chunk_gradients.collect::<Vec<ChunkGradients>>()
            };
            let chunk_gradients: Vec<Vec<ChunkGradients>> = states
                .par_chunks_mut(group_size)
                .zip(weight_gradients.par_iter_mut())
                .enumerate()
                .map(of_group)
                .collect();
            let chunk_gradients: Vec<ChunkGradients> =
                chunk_gradients.into_iter().flatten().collect();
            self.sum_modulation_gradients(&states, &chunk_gradients, block, &mut modulations);
            if let Some(text) = texts.get_mut(block) {
                *text = self.sum_text_gradients(&states, &chunk_gradients, motions);
            }
            pending = Some(PendingSelfAttention {
                contexts: contexts.pop().expect("one a block"),
                context_gradients: self.sum_context_gradients(&states, &chunk_gradients, motions),
                chunk_gradients,
            });
        }
        // The condition has no influence on the self-attention of the first block.
        if let (RecordMode::ForWeights, Some(pending)) = (mode, &pending) {
            states
                .par_chunks_mut(group_size)
                .zip(weight_gradients.par_iter_mut())
                .enumerate()
                .for_each(|(group, (states, weight_gradients))| {
                    for (index, state) in states.iter_mut().enumerate() {
                        let gradients = &pending.chunk_gradients[group * group_size + index];
                        self.begin_block_backward(state, 0, pending, gradients, weight_gradients);
                        self.embed_poses_backward(state, input, weight_gradients);
                    }
                });
        }
        (modulations, states)
    }

    fn project_output_backward(
        &self,
        state: &mut ChunkState,
        input: DecoderInput<'_>,
        gradient: &[f32],
        weight_gradients: &mut WeightGradients,
    ) {
        let gradient = &gradient[self.batch_range(&state.chunk, input)];
        if let Some(weight_gradients) = weight_gradients {
            weight_gradients
                .output
                .add_gradients(&state.hidden, gradient);
        }
        self.output.weight.backward(gradient, &mut state.hidden);
    }

    fn embed_poses_backward(
        &self,
        state: &ChunkState,
        input: DecoderInput<'_>,
        weight_gradients: &mut WeightGradients,
    ) {
        let ChunkState { chunk, hidden, .. } = state;
        if let Some(weight_gradients) = weight_gradients {
            let x_t = &input.x_t[self.batch_range(chunk, input)];
            weight_gradients.pose_embedding.add_gradients(x_t, hidden);
            let first = chunk.first * self.width();
            math::add(&mut weight_gradients.frame_embedding[first..], hidden);
        }
    }

    /// Differentiates the second half of a block, back to the output of the self-attention.
    fn finish_block_backward(
        &self,
        state: &mut ChunkState,
        (block, mode): (usize, RecordMode),
        text: &[f32],
        [first, second, third]: &[StyleParameters; STYLIZATION_LAYERS],
        weight_gradients: &mut WeightGradients,
    ) -> ChunkGradients {
        let heads = self.heads();
        let weights = &self.blocks[block];
        let ChunkState {
            chunk,
            hidden: gradient,
            activations,
            ..
        } = state;
        let block_activations = activations.last_mut().expect("one a block");
        let mut block_gradients = weight_gradients
            .as_mut()
            .map(|weight_gradients| &mut weight_gradients.blocks[block]);
        let mut modulations = [(); STYLIZATION_LAYERS]
            .map(|()| vec![0.0; chunk.granule_lengths.len() * 2 * heads.width]);
        let [first_modulation, second_modulation, third_modulation] = &mut modulations;
        let mut y = vec![0.0; gradient.len()];

        let layers = &weights.feed_forward;
        let style = &block_activations.feed_forward_stylization;
        let parameter_gradients = ParameterGradients {
            modulation: third_modulation,
            weights: block_gradients
                .as_mut()
                .map(|block| &mut block.feed_forward.output),
        };
        layers
            .output
            .backward(gradient, third, style, &mut y, chunk, parameter_gradients);
        let mut expanded_gradient = vec![0.0; block_activations.expanded.len()];
        if let Some(DecoderBlock { feed_forward, .. }) = &mut block_gradients {
            gelu(&block_activations.expanded, &mut expanded_gradient);
            feed_forward.contract.add_gradients(&expanded_gradient, &y);
        }
        layers.contract.weight.backward(&y, &mut expanded_gradient);
        gelu_backward(&block_activations.expanded, &mut expanded_gradient);
        if let Some(DecoderBlock { feed_forward, .. }) = &mut block_gradients {
            let input = &block_activations.feed_forward_input;
            feed_forward.expand.add_gradients(input, &expanded_gradient);
        }
        layers
            .expand
            .weight
            .backward_accumulate(&expanded_gradient, gradient);

        let attention = &weights.cross_attention;
        let style = &block_activations.cross_stylization;
        let parameter_gradients = ParameterGradients {
            modulation: second_modulation,
            weights: block_gradients
                .as_mut()
                .map(|block| &mut block.cross_attention.output),
        };
        attention
            .output
            .backward(gradient, second, style, &mut y, chunk, parameter_gradients);
        let texts = match &block_gradients {
            None => Vec::new(),
            Some(_) => self.outer_products(chunk, &block_activations.cross_query, &y),
        };
        let mut query = vec![0.0; gradient.len()];
        heads.apply_transposed(&y, text, &mut query);
        heads.softmax_backward(&block_activations.cross_query, &mut query);
        if let Some(DecoderBlock {
            cross_attention, ..
        }) = &mut block_gradients
        {
            block_activations
                .cross_norm
                .scale_and_shift(&attention.norm, &mut y);
            cross_attention.query.add_gradients(&y, &query);
        }
        attention.query.weight.backward(&query, &mut y);
        if let Some(DecoderBlock {
            cross_attention, ..
        }) = &mut block_gradients
        {
            cross_attention
                .norm
                .add_gradients(&y, &block_activations.cross_norm);
        }
        attention
            .norm
            .backward(&mut y, &block_activations.cross_norm, gradient);

        let style = &block_activations.self_stylization;
        let parameter_gradients = ParameterGradients {
            modulation: first_modulation,
            weights: block_gradients
                .as_mut()
                .map(|block| &mut block.self_attention.output),
        };
        let output = &weights.self_attention.output;
        output.backward(gradient, first, style, &mut y, chunk, parameter_gradients);
        let contexts = match (block, mode) {
            // The condition has no influence on the self-attention of the first block.
            (0, RecordMode::ForCondition) => Vec::new(),
            _ => self.outer_products(chunk, &block_activations.self_attention.query, &y),
        };
        ChunkGradients {
            modulations,
            y,
            contexts,
            texts,
        }
    }

    /// Computes the gradient of the context that the frames attend to, summed over the frames of each granule.
    fn outer_products(&self, chunk: &Chunk, query: &[f32], y: &[f32]) -> Vec<Vec<f32>> {
        let heads = self.heads();
        chunk
            .granule_ranges(heads.width)
            .map(|range| {
                let mut out = vec![0.0; heads.width * heads.channels];
                heads.outer(&query[range.clone()], &y[range], &mut out);
                out
            })
            .collect()
    }

    /// Differentiates the first half of a block, through queries, keys and values back to the block's input.
    fn begin_block_backward(
        &self,
        state: &mut ChunkState,
        block: usize,
        pending: &PendingSelfAttention,
        gradients: &ChunkGradients,
        weight_gradients: &mut WeightGradients,
    ) {
        let heads = self.heads();
        let attention = &self.blocks[block].self_attention;
        let motion = state.chunk.motion;
        let context = &pending.contexts[motion].values;
        let context_gradient = &pending.context_gradients[motion];
        let y = &gradients.y;
        let BlockActivations { self_attention, .. } = state.activations.pop().expect("one a block");
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
        let mut block_gradients = weight_gradients
            .as_mut()
            .map(|weight_gradients| &mut weight_gradients.blocks[block].self_attention);
        if let Some(block_gradients) = &mut block_gradients {
            self_attention
                .norm
                .scale_and_shift(&attention.norm, &mut normed);
            block_gradients.query.add_gradients(&normed, &query);
            block_gradients.key.add_gradients(&normed, &key);
            block_gradients.value.add_gradients(&normed, &value);
        }
        attention.query.weight.backward(&query, &mut normed);
        attention.key.weight.backward_accumulate(&key, &mut normed);
        attention
            .value
            .weight
            .backward_accumulate(&value, &mut normed);
        if let Some(block_gradients) = &mut block_gradients {
            block_gradients
                .norm
                .add_gradients(&normed, &self_attention.norm);
        }
        attention
            .norm
            .backward(&mut normed, &self_attention.norm, &mut state.hidden);
    }

    /// Sums up the gradients of the contexts of the self-attention for each motion.
    fn sum_context_gradients(
        &self,
        states: &[ChunkState],
        chunk_gradients: &[ChunkGradients],
        motions: usize,
    ) -> Vec<Vec<f32>> {
        let heads = self.heads();
        let mut sums = vec![vec![0.0; heads.width * heads.channels]; motions];
        for (state, gradients) in states.iter().zip(chunk_gradients) {
            for part in &gradients.contexts {
                math::add(&mut sums[state.chunk.motion], part);
            }
        }
        sums
    }

    /// Sums up the gradients of a block's text context for each motion, `[batch, heads, d, d]`.
    fn sum_text_gradients(
        &self,
        states: &[ChunkState],
        chunk_gradients: &[ChunkGradients],
        motions: usize,
    ) -> Vec<f32> {
        let heads = self.heads();
        let size = heads.width * heads.channels;
        let mut sums = vec![0.0; motions * size];
        for (state, gradients) in states.iter().zip(chunk_gradients) {
            for part in &gradients.texts {
                math::add(&mut sums[state.chunk.motion * size..][..size], part);
            }
        }
        sums
    }

    /// Adds the gradients of a block's scales and shifts, summed over frames, to `modulations`, `[motion, block, layer]`.
    fn sum_modulation_gradients(
        &self,
        states: &[ChunkState],
        chunk_gradients: &[ChunkGradients],
        block: usize,
        modulations: &mut [f32],
    ) {
        let size = 2 * self.width();
        for (state, gradients) in states.iter().zip(chunk_gradients) {
            for (layer, parts) in gradients.modulations.iter().enumerate() {
                let index = state.chunk.motion * self.blocks.len() + block;
                let out = &mut modulations[(index * STYLIZATION_LAYERS + layer) * size..][..size];
                for part in parts.chunks_exact(size) {
                    math::add(out, part);
                }
            }
        }
    }
}

/// Turns the gradient of the GELU into the gradient of its argument.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2+fma"))]
pub(crate) fn gelu_backward(x: &[f32], gradient: &mut [f32]) {
    for (g, x) in gradient.iter_mut().zip(x) {
        *g *= math::normal_cdf(*x) + x * math::normal_pdf(*x);
    }
}
