//! Motions that a network makes a window at a time, each window continuing the one before.

use burn::tensor::Tensor;
use lamogen_model::{MotionWindow, Prompt};

use crate::sampler::Batch;

/// What a network that continues motions needs beside a prompt: the frames before the motion, and the sentences of the
/// windows after the first.
#[derive(Clone, Debug)]
pub struct Continuation<C> {
    /// The normalised frames before the motion, `[batch, prefix, features]`, with the number of frames that
    /// [`Denoiser::window`](lamogen_model::Denoiser::window) states.
    pub prefix: Tensor<3>,
    /// The encoded prompts of the second window, the third, and so on. Windows past the last of them have its prompt; with
    /// none, all have the prompt of the batch.
    pub prompts: Vec<Prompt<C>>,
}

/// The windows of a batch that are finished.
#[derive(Clone)]
pub(crate) struct WindowChain {
    /// `None` if the network makes whole motions, which are then one window.
    window: Option<MotionWindow>,
    /// The finished windows, normalised, `[batch, frames, features]` each.
    finished: Vec<Tensor<3>>,
}

impl WindowChain {
    pub(crate) fn new(window: Option<MotionWindow>) -> Self {
        WindowChain {
            window,
            finished: Vec::new(),
        }
    }

    /// Returns the index of the window that is made next.
    pub(crate) fn index(&self) -> usize {
        self.finished.len()
    }

    /// Returns the frames of the window that is made next, among `frames` frames of a motion.
    pub(crate) fn frames(&self, frames: usize) -> std::ops::Range<usize> {
        match self.window {
            None => 0..frames,
            Some(window) => {
                let start = self.index() * window.frames;
                start..start + window.frames
            }
        }
    }

    /// Returns the frames before the window that is made next; `None` if the network makes whole motions.
    ///
    /// # Panics
    ///
    /// If the network continues motions and the batch has no prefix.
    pub(crate) fn prefix<C>(&self, batch: &Batch<C>) -> Option<Tensor<3>> {
        let window = self.window?;
        Some(match self.finished.last() {
            Some(last) => last
                .clone()
                .narrow(1, window.frames - window.prefix, window.prefix),
            None => {
                let continuation = batch.continuation.as_ref();
                let continuation =
                    continuation.expect("a network that continues motions needs a prefix");
                continuation.prefix.clone()
            }
        })
    }

    /// Returns the prompt of the window that is made next.
    pub(crate) fn prompt<'b, C>(&self, batch: &'b Batch<C>) -> &'b Prompt<C> {
        let prompts = batch.continuation.iter().flat_map(|more| &more.prompts);
        let mut prompts = prompts.take(self.index());
        let last = prompts.by_ref().last();
        last.unwrap_or(&batch.prompt)
    }

    /// Adds a finished window.
    pub(crate) fn push(&mut self, motion: Tensor<3>) {
        self.finished.push(motion);
    }

    /// Returns the finished windows followed by a motion.
    pub(crate) fn followed_by(&self, motion: Tensor<3>) -> Tensor<3> {
        match &self.finished[..] {
            [] => motion,
            finished => {
                let parts = finished.iter().cloned().chain([motion]);
                Tensor::cat(parts.collect(), 1)
            }
        }
    }

    /// Returns a whole motion with the finished windows and the given one in the place of its own; the windows after it are
    /// those of `whole`.
    pub(crate) fn within(&self, window: Tensor<3>, whole: &Tensor<3>) -> Tensor<3> {
        let [_, all, _] = whole.dims();
        let motion = self.followed_by(window);
        let [_, done, _] = motion.dims();
        match all.checked_sub(done) {
            None | Some(0) => motion,
            Some(rest) => Tensor::cat(vec![motion, whole.clone().narrow(1, done, rest)], 1),
        }
    }
}

/// Returns the number of windows of motions with `frames` frames.
pub(crate) fn window_count(window: Option<MotionWindow>, frames: usize) -> usize {
    window.map_or(1, |window| frames.div_ceil(window.frames))
}
