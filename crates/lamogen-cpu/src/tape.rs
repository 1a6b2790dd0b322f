//! What a forward pass leaves for its gradient.

use crate::attention::{Context, Part};
use crate::chunk::Chunk;
use crate::decoder::LAYERS;
use crate::norm::Normalized;
use crate::stylization::Style;

/// The record of one evaluation, from which gradients are computed.
#[derive(Debug)]
pub struct Tape {
    pub(crate) keep: Keep,
    pub(crate) passages: Vec<Passage>,
    /// What frames attend to: `[block][motion]`.
    pub(crate) contexts: Vec<Vec<Context>>,
    pub(crate) styles: Styles,
}

/// Styles of all stylization layers: `[motion][block]`, in the order of the layers.
pub(crate) type Styles = Vec<Vec<[Style; LAYERS]>>;

/// A chunk on its way through the blocks.
#[derive(Debug)]
pub(crate) struct Passage {
    pub(crate) chunk: Chunk,
    /// The hidden state between blocks, `[frames, width]`; on the way back its gradient.
    pub(crate) hidden: Vec<f32>,
    /// Pose features, once all blocks are passed.
    pub(crate) output: Vec<f32>,
    /// Keys and values of each granule, summed up, for the block whose attention is under way.
    pub(crate) parts: Vec<Part>,
    /// One record for each block; only the current one where nothing is to be remembered.
    pub(crate) records: Vec<Record>,
}

impl Passage {
    pub(crate) fn new(chunk: Chunk, width: usize) -> Self {
        Passage {
            hidden: vec![0.0; chunk.frames() * width],
            output: Vec::new(),
            parts: Vec::new(),
            records: Vec::new(),
            chunk,
        }
    }
}

/// How much of an evaluation is remembered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Keep {
    Nothing,
    /// What the gradient with respect to the condition needs.
    ForCondition,
    /// What the gradients of weights and of the noisy motion need as well.
    ForWeights,
}

/// What is remembered of a block.
#[derive(Debug, Default)]
pub(crate) struct Record {
    pub(crate) self_attention: SelfAttentionRecord,
    pub(crate) self_style: Normalized,
    pub(crate) cross_norm: Normalized,
    pub(crate) cross_query: Vec<f32>,
    pub(crate) cross_style: Normalized,
    /// The hidden state before the feed-forward layers, for gradients of weights.
    pub(crate) feed_forward_input: Vec<f32>,
    /// Before the activation, `[frames, ff_size]`.
    pub(crate) expanded: Vec<f32>,
    pub(crate) feed_forward_style: Normalized,
}

/// Queries and keys after their softmax, and values.
#[derive(Debug, Default)]
pub(crate) struct SelfAttentionRecord {
    pub(crate) norm: Normalized,
    pub(crate) query: Vec<f32>,
    pub(crate) key: Vec<f32>,
    pub(crate) value: Vec<f32>,
}
