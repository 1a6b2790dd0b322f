//! The weights of a decoder, its input, and its evaluation.

use crate::FloatStorage;
use crate::attention::HeadLayout;
use crate::chunk::Chunk;
use crate::linear::Linear;
use crate::norm::LayerNorm;
use crate::stylization::Stylization;
use crate::tape::{RecordMode, Tape};

/// The weights of a decoder.
#[derive(Clone, Debug)]
pub struct Decoder<S> {
    /// The number of heads of each attention layer.
    pub heads: usize,
    /// The layer from pose features to the hidden state.
    pub pose_embedding: Linear<S>,
    /// The embedding of each frame's position, added to the hidden state, `[frames, width]`.
    pub frame_embedding: S,
    /// The layer from the condition to the scales and shifts of all stylization layers, in the order of blocks and layers.
    pub modulations: Linear<S>,
    /// The blocks in the order of their evaluation.
    pub blocks: Vec<DecoderBlock<S>>,
    /// The layer from the hidden state to pose features.
    pub output: Linear<S>,
}

/// The weights of one decoder block.
#[derive(Clone, Debug)]
pub struct DecoderBlock<S> {
    /// The attention of the frames to each other.
    pub self_attention: SelfAttention<S>,
    /// The attention of the frames to the text.
    pub cross_attention: CrossAttention<S>,
    /// The feed-forward layers, which treat each frame separately.
    pub feed_forward: FeedForward<S>,
}

/// The weights of the attention of the frames to each other.
#[derive(Clone, Debug)]
pub struct SelfAttention<S> {
    /// The normalization before the projections.
    pub norm: LayerNorm<S>,
    /// The projection to queries, whose softmax is taken over channels.
    pub query: Linear<S>,
    /// The projection to keys, whose softmax is taken over frames.
    pub key: Linear<S>,
    /// The projection to values.
    pub value: Linear<S>,
    /// The stylization after the attention.
    pub output: Stylization<S>,
}

/// The weights of the attention of the frames to the text.
///
/// The keys and values of the text are not computed here: their context is part of the [`DecoderInput`].
#[derive(Clone, Debug)]
pub struct CrossAttention<S> {
    /// The normalization before the projection.
    pub norm: LayerNorm<S>,
    /// The projection to queries, whose softmax is taken over channels.
    pub query: Linear<S>,
    /// The stylization after the attention.
    pub output: Stylization<S>,
}

/// The weights of the feed-forward layers: two linear layers with a GELU between them.
#[derive(Clone, Debug)]
pub struct FeedForward<S> {
    /// The linear layer to more channels.
    pub expand: Linear<S>,
    /// The linear layer back to the width of the hidden state.
    pub contract: Linear<S>,
    /// The stylization after both linear layers.
    pub output: Stylization<S>,
}

/// The input of a decoder.
#[derive(Clone, Copy, Debug)]
pub struct DecoderInput<'a> {
    /// The noisy motions, `[batch, frames, features]`.
    pub x_t: &'a [f32],
    /// The embedded timestep plus the sentence embedding, `[batch, condition]`.
    pub condition: &'a [f32],
    /// What [`Decoder::modulate`] makes of the condition, if it is known, `[batch, outputs of the modulations]`.
    pub modulated: Option<&'a [f32]>,
    /// An optional offset that is added to the scales and shifts of all stylization layers,
    /// `[batch, outputs of the modulations]`.
    pub modulation: Option<&'a [f32]>,
    /// For each block, the context of its attention to the text, `[batch, heads, d, d]`.
    pub text: &'a [&'a [f32]],
    /// The number of frames of each motion, at least 1.
    pub lengths: &'a [usize],
    /// The number of frames of each padded motion.
    pub frames: usize,
}

/// The number of stylization layers of a block.
pub(crate) const STYLIZATION_LAYERS: usize = 3;

impl<S: FloatStorage> Decoder<S> {
    /// Computes the network's output, `[batch, frames, features]`, which is zero past a motion's length.
    ///
    /// # Panics
    ///
    /// If the sizes of weights and input do not fit together.
    pub fn evaluate(&self, input: DecoderInput<'_>) -> Vec<f32> {
        self.check(input);
        run_in_pool(|| {
            self.forward(input, chunks_for_threads(input), RecordMode::Nothing)
                .0
        })
    }

    /// Computes the scales and shifts of all stylization layers for conditions, `[batch, outputs of the modulations]`. A row of
    /// the result depends on the row of its condition alone, to the last bit.
    pub fn modulate(&self, condition: &[f32]) -> Vec<f32> {
        run_in_pool(|| self.modulations.modulate(condition))
    }

    /// Computes the network's output and the tape that [`backward`](Self::backward) needs.
    ///
    /// # Panics
    ///
    /// In the same cases as [`evaluate`](Self::evaluate).
    pub fn record(&self, input: DecoderInput<'_>) -> (Vec<f32>, Tape) {
        self.check(input);
        run_in_pool(|| self.forward(input, chunks_for_threads(input), RecordMode::ForCondition))
    }

    /// Computes the network's output and the tape that [`gradients`](Self::gradients) needs.
    ///
    /// The tape has about 12 numbers per frame and channel in each block.
    ///
    /// # Panics
    ///
    /// In the same cases as [`evaluate`](Self::evaluate).
    pub fn record_for_training(&self, input: DecoderInput<'_>) -> (Vec<f32>, Tape) {
        self.check(input);
        // The chunks are those for one thread, because sums over frames must not depend on the number of threads.
        let chunks = Chunk::split(input.lengths, 1);
        run_in_pool(|| self.forward(input, chunks, RecordMode::ForWeights))
    }

    /// Panics if the sizes of weights and input do not fit together. Without this check, a slice that is too long or too
    /// short would be read as something else.
    pub(crate) fn check(&self, input: DecoderInput<'_>) {
        let (width, motions) = (self.width(), input.lengths.len());
        let features = self.pose_embedding.weight.inputs();
        let blocks = self.blocks.len();
        assert!(blocks > 0, "expected at least one block");
        assert!(
            self.heads > 0 && width.is_multiple_of(self.heads),
            "expected heads that share {width} channels evenly, found {}",
            self.heads
        );
        let check_size = |what: &str, expected: usize, found: usize| {
            assert!(
                expected == found,
                "{what}: expected {expected}, found {found}"
            );
        };
        let outputs = &self.modulations.weight;
        check_size(
            "outputs of the modulations",
            blocks * STYLIZATION_LAYERS * 2 * width,
            outputs.outputs(),
        );
        for block in &self.blocks {
            for norm in block.norms() {
                check_size(
                    "scales of a normalization",
                    width,
                    norm.gamma.as_ref().len(),
                );
                check_size("shifts of a normalization", width, norm.beta.as_ref().len());
            }
        }
        check_size(
            "pose features",
            motions * input.frames * features,
            input.x_t.len(),
        );
        check_size(
            "condition",
            motions * outputs.inputs(),
            input.condition.len(),
        );
        for modulation in [input.modulated, input.modulation].into_iter().flatten() {
            check_size(
                "scales and shifts",
                motions * outputs.outputs(),
                modulation.len(),
            );
        }
        check_size("blocks of the text", blocks, input.text.len());
        for text in input.text {
            check_size(
                "text of a block",
                motions * width * width / self.heads,
                text.len(),
            );
        }
        let longest = self.frame_embedding.as_ref().len() / width;
        for &length in input.lengths {
            assert!(
                (1..=input.frames.min(longest)).contains(&length),
                "expected motions of 1 to {} frames, found {length}",
                input.frames.min(longest)
            );
        }
    }

    /// Returns the width of the hidden state.
    pub(crate) fn width(&self) -> usize {
        self.pose_embedding.weight.outputs()
    }

    pub(crate) fn heads(&self) -> HeadLayout {
        HeadLayout {
            width: self.width(),
            channels: self.width() / self.heads,
        }
    }

    /// Returns the range of a chunk's pose features in the batch.
    pub(crate) fn batch_range(
        &self,
        chunk: &Chunk,
        input: DecoderInput<'_>,
    ) -> std::ops::Range<usize> {
        let features = self.pose_embedding.weight.inputs();
        let start = (chunk.motion * input.frames + chunk.first) * features;
        start..start + chunk.frames() * features
    }
}

/// Splits the motions of an input into chunks that keep all threads busy.
fn chunks_for_threads(input: DecoderInput<'_>) -> Vec<Chunk> {
    Chunk::split(input.lengths, rayon::current_num_threads())
}

/// Runs a whole task in the thread pool. Otherwise every parallel part of the task would have to wake the pool and wait
/// for it.
pub(crate) fn run_in_pool<R: Send>(task: impl FnOnce() -> R + Send) -> R {
    rayon::scope(|_| task())
}

impl<S> DecoderBlock<S> {
    /// Returns all normalizations of the block.
    fn norms(&self) -> impl Iterator<Item = &LayerNorm<S>> {
        let first = [&self.self_attention.norm, &self.cross_attention.norm];
        first.into_iter().chain(self.stylization_norms())
    }

    /// Returns the normalizations of the stylization layers.
    pub(crate) fn stylization_norms(&self) -> [&LayerNorm<S>; STYLIZATION_LAYERS] {
        [
            &self.self_attention.output.norm,
            &self.cross_attention.output.norm,
            &self.feed_forward.output.norm,
        ]
    }
}

impl<'a> DecoderInput<'a> {
    /// Returns the context of a block's attention to the text of a motion, `[width, d]`.
    pub(crate) fn text(&self, block: usize, motion: usize) -> &'a [f32] {
        let all = self.text[block];
        let size = all.len() / self.lengths.len();
        &all[motion * size..][..size]
    }
}
