//! The forward pass, from noisy motions to the network's output.

use multiversion::multiversion;
use rayon::prelude::*;

use crate::FloatStorage;
use crate::attention::AttentionContext;
use crate::chunk::Chunk;
use crate::decoder::{Decoder, DecoderInput, STYLIZATION_LAYERS};
use crate::math;
use crate::stylization::StyleParameters;
use crate::tape::{BlockActivations, ChunkState, RecordMode, StyleTable, Tape};

impl<S: FloatStorage> Decoder<S> {
    /// Computes the output and the tape. The tape can be used only for the gradients that `mode` records for.
    pub(crate) fn forward(
        &self,
        input: DecoderInput<'_>,
        chunks: Vec<Chunk>,
        mode: RecordMode,
    ) -> (Vec<f32>, Tape) {
        let mut states: Vec<ChunkState> = chunks
            .into_iter()
            .map(|chunk| ChunkState::new(chunk, self.width()))
            .collect();
        // The self-attention of the first block does not need the styles. It is computed while the many weights of the
        // modulations are read.
        let begin_first_block = |state: &mut ChunkState| {
            self.embed_poses(state, input);
            self.begin_block(state, 0, mode);
        };
        let (styles, ()) = rayon::join(
            || self.style_table(input),
            || states.par_iter_mut().for_each(begin_first_block),
        );
        let mut contexts = Vec::new();
        for (block, _) in self.blocks.iter().enumerate() {
            let block_contexts = self.contexts(&states, input.lengths.len());
            states.par_iter_mut().for_each(|state| {
                let motion = state.chunk.motion;
                let text = input.text(block, motion);
                let style = &styles[motion][block];
                self.finish_block(state, block, &block_contexts[motion], text, style, mode);
                if mode != RecordMode::Nothing {
                    self.normalize_keys(state, &block_contexts[motion]);
                }
                match block + 1 == self.blocks.len() {
                    true => self.project_output(state),
                    false => self.begin_block(state, block + 1, mode),
                }
            });
            contexts.push(block_contexts);
        }
        let out = self.output(&states, input);
        let tape = Tape {
            mode,
            chunks: states,
            contexts,
            styles,
        };
        (out, tape)
    }

    /// Computes the style parameters of all stylization layers for each motion.
    fn style_table(&self, input: DecoderInput<'_>) -> StyleTable {
        let mut modulations = match input.modulated {
            Some(modulated) => modulated.to_vec(),
            None => self.modulations.modulate(input.condition),
        };
        if let Some(added) = input.modulation {
            math::add(&mut modulations, added);
        }
        let motions = modulations.chunks_exact(self.modulations.weight.outputs());
        let of_motion = |modulations: &[f32]| {
            let mut layers = modulations.chunks_exact(2 * self.width());
            let mut style = |norm| StyleParameters::new(norm, layers.next().expect("one a layer"));
            let blocks = self.blocks.iter();
            blocks
                .map(|block| block.stylization_norms().map(&mut style))
                .collect()
        };
        motions.map(of_motion).collect()
    }

    /// Computes the hidden state from the pose features.
    fn embed_poses(&self, state: &mut ChunkState, input: DecoderInput<'_>) {
        let x_t = &input.x_t[self.batch_range(&state.chunk, input)];
        self.pose_embedding.forward(x_t, &mut state.hidden);
        let first = state.chunk.first * self.width();
        let embedding = &self.frame_embedding.as_ref()[first..];
        math::add(&mut state.hidden, embedding);
    }

    /// Computes the first half of a block: the queries, and the summed keys and values.
    fn begin_block(&self, state: &mut ChunkState, block: usize, mode: RecordMode) {
        let ChunkState {
            chunk,
            hidden,
            partial_contexts,
            activations,
            ..
        } = state;
        if mode != RecordMode::Nothing || activations.is_empty() {
            activations.push(BlockActivations::default());
        }
        let self_attention = &mut activations.last_mut().expect("just pushed").self_attention;
        let attention = &self.blocks[block].self_attention;
        let mut normed = vec![0.0; hidden.len()];
        attention
            .norm
            .forward(hidden, &mut self_attention.norm, &mut normed);
        for (layer, out) in [
            (&attention.query, &mut self_attention.query),
            (&attention.key, &mut self_attention.key),
            (&attention.value, &mut self_attention.value),
        ] {
            out.resize(hidden.len(), 0.0);
            layer.forward(&normed, out);
        }
        let heads = self.heads();
        heads.softmax(&mut self_attention.query);
        *partial_contexts = chunk
            .granule_ranges(heads.width)
            .map(|range| {
                heads.partial_context(
                    &mut self_attention.key[range.clone()],
                    &self_attention.value[range],
                )
            })
            .collect();
    }

    /// Merges the partial contexts of each motion.
    fn contexts(&self, states: &[ChunkState], motions: usize) -> Vec<AttentionContext> {
        let of_motion = |motion| {
            let own = states.iter().filter(|state| state.chunk.motion == motion);
            AttentionContext::merge(own.flat_map(|state| &state.partial_contexts))
        };
        (0..motions).map(of_motion).collect()
    }

    /// Computes the rest of a block.
    fn finish_block(
        &self,
        state: &mut ChunkState,
        block: usize,
        context: &AttentionContext,
        text: &[f32],
        [first, second, third]: &[StyleParameters; STYLIZATION_LAYERS],
        mode: RecordMode,
    ) {
        let heads = self.heads();
        let weights = &self.blocks[block];
        let ChunkState {
            hidden,
            activations,
            ..
        } = state;
        let block_activations = activations.last_mut().expect("attention came first");
        let mut y = vec![0.0; hidden.len()];

        heads.apply(
            &block_activations.self_attention.query,
            &context.values,
            &mut y,
        );
        let output = &weights.self_attention.output;
        output.forward(
            &mut y,
            first,
            &mut block_activations.self_stylization,
            hidden,
        );

        let attention = &weights.cross_attention;
        attention
            .norm
            .forward(hidden, &mut block_activations.cross_norm, &mut y);
        block_activations.cross_query.resize(hidden.len(), 0.0);
        attention
            .query
            .forward(&y, &mut block_activations.cross_query);
        heads.softmax(&mut block_activations.cross_query);
        heads.apply(&block_activations.cross_query, text, &mut y);
        attention.output.forward(
            &mut y,
            second,
            &mut block_activations.cross_stylization,
            hidden,
        );

        if mode == RecordMode::ForWeights {
            block_activations.feed_forward_input.clone_from(hidden);
        }
        let layers = &weights.feed_forward;
        let ff_size = layers.expand.weight.outputs();
        block_activations
            .expanded
            .resize(hidden.len() / heads.width * ff_size, 0.0);
        layers
            .expand
            .forward(hidden, &mut block_activations.expanded);
        let mut active = vec![0.0; block_activations.expanded.len()];
        gelu(&block_activations.expanded, &mut active);
        layers.contract.forward(&active, &mut y);
        layers.output.forward(
            &mut y,
            third,
            &mut block_activations.feed_forward_stylization,
            hidden,
        );
    }

    /// Turns the recorded keys of the current block into their softmax over frames.
    fn normalize_keys(&self, state: &mut ChunkState, context: &AttentionContext) {
        let width = self.width();
        let ChunkState {
            chunk, activations, ..
        } = state;
        let block_activations = activations.last_mut().expect("attention came first");
        let softmax_factors = &context.softmax_factors[chunk.first_granule..];
        for (range, factor) in chunk.granule_ranges(width).zip(softmax_factors) {
            math::scale(&mut block_activations.self_attention.key[range], factor);
        }
    }

    /// Computes the pose features from the hidden state.
    fn project_output(&self, state: &mut ChunkState) {
        let rows = state.chunk.frames();
        state.output = vec![0.0; rows * self.output.weight.outputs()];
        self.output.forward(&state.hidden, &mut state.output);
    }

    /// Copies the outputs of all chunks to their places in the batch.
    fn output(&self, states: &[ChunkState], input: DecoderInput<'_>) -> Vec<f32> {
        let features = self.output.weight.outputs();
        let mut out = vec![0.0; input.lengths.len() * input.frames * features];
        for state in states {
            out[self.batch_range(&state.chunk, input)].copy_from_slice(&state.output);
        }
        out
    }
}

/// Computes the GELU `x · Φ(x)`, where `Φ` is the standard normal distribution function.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2+fma"))]
pub(crate) fn gelu(x: &[f32], out: &mut [f32]) {
    for (out, x) in out.iter_mut().zip(x) {
        *out = x * math::normal_cdf(*x);
    }
}
