//! The tape: the results of a forward pass that the backward pass needs.

use crate::attention::{AttentionContext, PartialContext};
use crate::chunk::Chunk;
use crate::decoder::STYLIZATION_LAYERS;
use crate::norm::NormalizedRows;
use crate::stylization::StyleParameters;

/// The recording of one evaluation, from which gradients are computed.
#[derive(Debug)]
pub struct Tape {
    pub(crate) mode: RecordMode,
    pub(crate) chunks: Vec<ChunkState>,
    /// The contexts of the self-attention, `[block][motion]`.
    pub(crate) contexts: Vec<Vec<AttentionContext>>,
    pub(crate) styles: StyleTable,
}

/// The style parameters of all stylization layers, `[motion][block]`, then in the order of the layers.
pub(crate) type StyleTable = Vec<Vec<[StyleParameters; STYLIZATION_LAYERS]>>;

/// The state of a chunk during a pass through the blocks.
#[derive(Debug)]
pub(crate) struct ChunkState {
    pub(crate) chunk: Chunk,
    /// The hidden state between blocks, `[frames, width]`. During the backward pass, the gradient of the hidden state.
    pub(crate) hidden: Vec<f32>,
    /// The pose features, once all blocks have been evaluated.
    pub(crate) output: Vec<f32>,
    /// The summed keys and values of each granule in the current block.
    pub(crate) partial_contexts: Vec<PartialContext>,
    /// The activations of each block, or only those of the current block if nothing is recorded.
    pub(crate) activations: Vec<BlockActivations>,
}

impl ChunkState {
    pub(crate) fn new(chunk: Chunk, width: usize) -> Self {
        ChunkState {
            hidden: vec![0.0; chunk.frames() * width],
            output: Vec::new(),
            partial_contexts: Vec::new(),
            activations: Vec::new(),
            chunk,
        }
    }
}

/// The extent to which an evaluation is recorded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum RecordMode {
    /// Nothing is recorded.
    Nothing,
    /// Records what the gradient with respect to the condition needs.
    ForCondition,
    /// Also records what the gradients of the weights and of the noisy motion need.
    ForWeights,
}

/// The activations of a block that the backward pass needs.
#[derive(Debug, Default)]
pub(crate) struct BlockActivations {
    pub(crate) self_attention: SelfAttentionActivations,
    pub(crate) self_stylization: NormalizedRows,
    pub(crate) cross_norm: NormalizedRows,
    pub(crate) cross_query: Vec<f32>,
    pub(crate) cross_stylization: NormalizedRows,
    /// The hidden state before the feed-forward layers, for the gradients of the weights.
    pub(crate) feed_forward_input: Vec<f32>,
    /// The expanded hidden state before the activation, `[frames, ff_size]`.
    pub(crate) expanded: Vec<f32>,
    pub(crate) feed_forward_stylization: NormalizedRows,
}

/// The activations of a self-attention: queries and keys after their softmax, and values.
#[derive(Debug, Default)]
pub(crate) struct SelfAttentionActivations {
    pub(crate) norm: NormalizedRows,
    pub(crate) query: Vec<f32>,
    pub(crate) key: Vec<f32>,
    pub(crate) value: Vec<f32>,
}
