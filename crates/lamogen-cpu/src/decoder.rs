//! Weights of a decoder, and what can be done with them.

use crate::FloatStorage;
use crate::attention::Heads;
use crate::chunk::Chunk;
use crate::linear::Linear;
use crate::norm::LayerNorm;
use crate::stylization::Stylization;
use crate::tape::{Keep, Tape};

/// Weights of a decoder.
#[derive(Clone, Debug)]
pub struct Decoder<S> {
    /// Heads of all attention layers.
    pub heads: usize,
    /// From pose features to the hidden state.
    pub pose_embedding: Linear<S>,
    /// Added to the hidden state, `[frames, width]`.
    pub frame_embedding: S,
    /// Scales and shifts of all stylization layers, in the order of blocks and layers.
    pub modulations: Linear<S>,
    /// One after another.
    pub blocks: Vec<DecoderBlock<S>>,
    /// From the hidden state to pose features.
    pub output: Linear<S>,
}

/// Weights of one block.
#[derive(Clone, Debug)]
pub struct DecoderBlock<S> {
    /// Frames to each other.
    pub self_attention: SelfAttention<S>,
    /// Frames to the text.
    pub cross_attention: CrossAttention<S>,
    /// Each frame alone.
    pub feed_forward: FeedForward<S>,
}

/// Attention of the frames to each other.
#[derive(Clone, Debug)]
pub struct SelfAttention<S> {
    /// Before the projections.
    pub norm: LayerNorm<S>,
    /// Softmax over channels.
    pub query: Linear<S>,
    /// Softmax over frames.
    pub key: Linear<S>,
    /// What is summed.
    pub value: Linear<S>,
    /// After the attention.
    pub output: Stylization<S>,
}

/// Attention of the frames to the text, whose side is part of the [`DecoderInput`].
#[derive(Clone, Debug)]
pub struct CrossAttention<S> {
    /// Before the projection.
    pub norm: LayerNorm<S>,
    /// Softmax over channels.
    pub query: Linear<S>,
    /// After the attention.
    pub output: Stylization<S>,
}

/// Two layers around a GELU.
#[derive(Clone, Debug)]
pub struct FeedForward<S> {
    /// To more channels.
    pub expand: Linear<S>,
    /// And back.
    pub contract: Linear<S>,
    /// After both.
    pub output: Stylization<S>,
}

/// What a decoder is evaluated on.
#[derive(Clone, Copy, Debug)]
pub struct DecoderInput<'a> {
    /// Noisy motions, `[batch, frames, features]`.
    pub x_t: &'a [f32],
    /// Embedded timestep plus sentence embedding, `[batch, condition]`.
    pub condition: &'a [f32],
    /// What is added to the scales and shifts of all stylization layers, `[batch, outputs of the modulations]`; nothing if not given.
    pub modulation: Option<&'a [f32]>,
    /// What each block attends to in the text, `[batch, heads, d, d]`.
    pub text: &'a [&'a [f32]],
    /// Frames of each motion, at least 1.
    pub lengths: &'a [usize],
    /// Frames with padding.
    pub frames: usize,
}

/// Stylization layers of a block.
pub(crate) const LAYERS: usize = 3;

impl<S: FloatStorage> Decoder<S> {
    /// The network's output `[batch, frames, features]`; zeros past a motion's length.
    ///
    /// # Panics
    ///
    /// If the sizes of weights and input do not belong together.
    pub fn evaluate(&self, input: DecoderInput<'_>) -> Vec<f32> {
        self.check(input);
        on_the_pool(|| self.forward(input, for_threads(input), Keep::Nothing).0)
    }

    /// The network's output, and what [`backward`](Self::backward) needs.
    ///
    /// # Panics
    ///
    /// As [`evaluate`](Self::evaluate).
    pub fn record(&self, input: DecoderInput<'_>) -> (Vec<f32>, Tape) {
        self.check(input);
        on_the_pool(|| self.forward(input, for_threads(input), Keep::ForCondition))
    }

    /// The network's output, and what [`gradients`](Self::gradients) needs: about 12 numbers a frame and
    /// channel in each block.
    ///
    /// # Panics
    ///
    /// As [`evaluate`](Self::evaluate).
    pub fn record_for_training(&self, input: DecoderInput<'_>) -> (Vec<f32>, Tape) {
        self.check(input);
        // Whole motions wherever it can be: sums over frames must not depend on the number of threads.
        let chunks = Chunk::cut(input.lengths, 1);
        on_the_pool(|| self.forward(input, chunks, Keep::ForWeights))
    }

    /// Panics where the sizes of weights and input do not belong together: a slice too long or too short
    /// would be read as something else.
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
        let is = |what: &str, expected: usize, found: usize| {
            assert!(
                expected == found,
                "{what}: expected {expected}, found {found}"
            );
        };
        let outputs = &self.modulations.weight;
        is(
            "outputs of the modulations",
            blocks * LAYERS * 2 * width,
            outputs.outputs(),
        );
        for block in &self.blocks {
            for norm in block.norms() {
                is(
                    "scales of a normalization",
                    width,
                    norm.gamma.as_ref().len(),
                );
                is("shifts of a normalization", width, norm.beta.as_ref().len());
            }
        }
        is(
            "pose features",
            motions * input.frames * features,
            input.x_t.len(),
        );
        is(
            "condition",
            motions * outputs.inputs(),
            input.condition.len(),
        );
        if let Some(modulation) = input.modulation {
            is(
                "scales and shifts",
                motions * outputs.outputs(),
                modulation.len(),
            );
        }
        is("blocks of the text", blocks, input.text.len());
        for text in input.text {
            is(
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

    pub(crate) fn width(&self) -> usize {
        self.pose_embedding.weight.outputs()
    }

    pub(crate) fn heads(&self) -> Heads {
        Heads {
            width: self.width(),
            channels: self.width() / self.heads,
        }
    }

    /// Where the pose features of a chunk stand in the batch.
    pub(crate) fn place(&self, chunk: &Chunk, input: DecoderInput<'_>) -> std::ops::Range<usize> {
        let features = self.pose_embedding.weight.inputs();
        let start = (chunk.motion * input.frames + chunk.first) * features;
        start..start + chunk.frames() * features
    }
}

/// Chunks that keep all threads busy.
fn for_threads(input: DecoderInput<'_>) -> Vec<Chunk> {
    Chunk::cut(input.lengths, rayon::current_num_threads())
}

/// Runs a task on the thread pool as a whole: every parallel part of it would otherwise have to wake
/// the pool and wait for it.
pub(crate) fn on_the_pool<R: Send>(task: impl FnOnce() -> R + Send) -> R {
    rayon::scope(|_| task())
}

impl<S> DecoderBlock<S> {
    fn norms(&self) -> impl Iterator<Item = &LayerNorm<S>> {
        let first = [&self.self_attention.norm, &self.cross_attention.norm];
        first.into_iter().chain(self.styled_norms())
    }

    /// Normalizations of the stylization layers.
    pub(crate) fn styled_norms(&self) -> [&LayerNorm<S>; LAYERS] {
        [
            &self.self_attention.output.norm,
            &self.cross_attention.output.norm,
            &self.feed_forward.output.norm,
        ]
    }
}

impl<'a> DecoderInput<'a> {
    /// What a block attends to in the text of a motion, `[width, d]`.
    pub(crate) fn text(&self, block: usize, motion: usize) -> &'a [f32] {
        let all = self.text[block];
        let size = all.len() / self.lengths.len();
        &all[motion * size..][..size]
    }
}
