//! What guidance needs to know of a network.

use burn::tensor::{Device, Int, Tensor};
use lamogen_motion::frame_mask;

use crate::config::{LABAN_FEATURES, Prediction};

/// A text-to-motion denoiser that can be sampled from and guided.
///
/// The work is split by what it depends on, so that nothing is computed twice:
/// [`encode`](Denoiser::encode) once a prompt, [`embed_timesteps`](Denoiser::embed_timesteps) once a
/// timestep, and [`denoise`](Denoiser::denoise) at every step. Guidance moves the embedding of
/// [`Prompt`] along the derivative that [`linearize`](Denoiser::linearize) gives; the weights are never
/// tracked.
pub trait Denoiser {
    /// What the network keeps of a prompt beside its embedding.
    type Context: Clone;

    /// What [`denoise`](Denoiser::denoise) returns.
    fn prediction(&self) -> Prediction;

    /// Pose features a frame.
    fn pose_features(&self) -> usize;

    /// The longest motion, in frames.
    fn max_frames(&self) -> usize;

    /// The shortest motion, in frames.
    fn min_frames(&self) -> usize {
        1
    }

    /// Where the weights are.
    fn device(&self) -> Device;

    /// Everything that depends on the prompts alone.
    ///
    /// # Shapes
    ///
    /// - `tokens`: `[batch, context_length]`, the end token being the largest id of each row
    /// - output: see [`Prompt`]
    ///
    /// # Panics
    ///
    /// May, if an id is beyond the vocabulary or there are more tokens than the context holds.
    fn encode(&self, tokens: Tensor<2, Int>) -> Prompt<Self::Context>;

    /// Everything that depends on the timesteps alone: `[timesteps, d_condition]`.
    fn embed_timesteps(&self, timesteps: &[usize]) -> Tensor<2>;

    /// What is added to the embeddings of prompts to tell the network the Laban features of the motions to make: the means over time of Weight,
    /// Time, Flow and Shape, each where it is told. `[motions, d_condition]`, or `None` where the network cannot be told any.
    fn embed_laban(&self, means: &[[Option<f32>; LABAN_FEATURES]]) -> Option<Tensor<2>> {
        let _ = means;
        None
    }

    /// One evaluation: noise or clean motion (see [`prediction`](Denoiser::prediction)),
    /// `[batch, frames, features]`. What stands past a motion's length has no meaning.
    ///
    /// # Panics
    ///
    /// May, if there are more frames than [`max_frames`](Denoiser::max_frames) or another number of
    /// features than [`pose_features`](Denoiser::pose_features), or if input and context are not of as
    /// many motions.
    fn denoise(&self, input: DenoiserInput, context: &Self::Context) -> Tensor<3>;

    /// One evaluation, and the way back from its output to the embedding, or to the modulation where the input has one. Nothing of the input is
    /// tracked by autodiff. By default autodiff goes through [`denoise`](Denoiser::denoise); a network
    /// that knows a shorter way says so here.
    ///
    /// # Panics
    ///
    /// As [`denoise`](Denoiser::denoise).
    fn linearize<'a>(
        &'a self,
        input: DenoiserInput,
        context: &'a Self::Context,
    ) -> LinearizedEvaluation<'a> {
        LinearizedEvaluation::by_autodiff(input, |input| self.denoise(input, context))
    }

    /// How many scales and shifts a sentence and a timestep become on their way into the network, over all its stylization layers: what
    /// [`DenoiserInput::modulation`] is added to. 0, the default, where a network has none.
    fn modulations(&self) -> usize {
        0
    }

    /// As [`linearize`](Denoiser::linearize), with the way back to the noisy motion `x_t`: for what moves the start noise through all steps
    /// of a pass.
    ///
    /// # Panics
    ///
    /// As [`denoise`](Denoiser::denoise).
    fn linearize_motion<'a>(
        &'a self,
        input: DenoiserInput,
        context: &'a Self::Context,
    ) -> LinearizedEvaluation<'a, 3> {
        LinearizedEvaluation::of_motion_by_autodiff(input, |input| self.denoise(input, context))
    }
}

/// An evaluation of a network with the derivative of its output: with respect to the embedding or modulation (`D` is 2) or to the
/// noisy motion (3).
pub struct LinearizedEvaluation<'a, const D: usize = 2> {
    /// As [`Denoiser::denoise`] returns it, `[batch, frames, features]`, not tracked by autodiff.
    pub output: Tensor<3>,
    shape: [usize; 3],
    pullback: Box<dyn FnOnce(Tensor<3>) -> Tensor<D> + 'a>,
}

impl<'a, const D: usize> LinearizedEvaluation<'a, D> {
    /// An output, and what turns its gradient into that of the embedding, the modulation or the noisy motion.
    pub fn new(output: Tensor<3>, pullback: impl FnOnce(Tensor<3>) -> Tensor<D> + 'a) -> Self {
        LinearizedEvaluation {
            shape: output.dims(),
            output,
            pullback: Box::new(pullback),
        }
    }

    /// By autodiff through an evaluation at a point.
    fn followed(point: Tensor<D>, evaluate: impl FnOnce(Tensor<D>) -> Tensor<3>) -> Self {
        let leaf = point.autodiff().require_grad();
        let output = evaluate(leaf.clone());
        LinearizedEvaluation::new(output.clone().inner(), move |gradient| {
            let along = (output * gradient.autodiff()).sum();
            let gradient = match along.is_tracked() {
                true => leaf.grad_remove(&mut along.backward()),
                false => None,
            };
            // A network may ignore its embedding.
            gradient.unwrap_or_else(|| leaf.inner().zeros_like())
        })
    }

    /// The gradient with respect to the embedding, `[batch, d_condition]`, the modulation, `[batch, modulations]`, or the noisy motion,
    /// `[batch, frames, features]`, of what has the given gradient with respect to the output, `[batch, frames, features]`, on the same device and not
    /// tracked.
    ///
    /// # Panics
    ///
    /// If the gradient has another shape than the output.
    pub fn pull(self, gradient: Tensor<3>) -> Tensor<D> {
        assert_eq!(
            self.shape,
            gradient.dims(),
            "the gradient must have the shape of the output"
        );
        (self.pullback)(gradient)
    }
}

impl LinearizedEvaluation<'_> {
    /// By autodiff through an evaluation, back to the embedding, or to the modulation where the input has one.
    pub fn by_autodiff(
        input: DenoiserInput,
        evaluate: impl FnOnce(DenoiserInput) -> Tensor<3>,
    ) -> Self {
        match input.modulation.clone() {
            None => Self::followed(input.embedding.clone(), |embedding| {
                evaluate(DenoiserInput { embedding, ..input })
            }),
            Some(modulation) => Self::followed(modulation, |modulation| {
                let modulation = Some(modulation);
                evaluate(DenoiserInput {
                    modulation,
                    ..input
                })
            }),
        }
    }
}

impl LinearizedEvaluation<'_, 3> {
    /// By autodiff through an evaluation, back to the noisy motion.
    pub fn of_motion_by_autodiff(
        input: DenoiserInput,
        evaluate: impl FnOnce(DenoiserInput) -> Tensor<3>,
    ) -> Self {
        Self::followed(input.x_t.clone(), |x_t| {
            evaluate(DenoiserInput { x_t, ..input })
        })
    }
}

/// An encoded batch of prompts.
#[derive(Clone, Debug)]
pub struct Prompt<C> {
    /// The projected sentence embedding `e`, `[batch, d_condition]`, which guidance moves.
    pub embedding: Tensor<2>,
    /// What else the network keeps of the prompts.
    pub context: C,
}

/// What a step gives to the network.
#[derive(Clone, Debug)]
pub struct DenoiserInput {
    /// The noisy motion, normalised, `[batch, frames, features]`.
    pub x_t: Tensor<3>,
    /// The embedded timestep, `[1, d_condition]` for all or `[batch, d_condition]` for each.
    pub time: Tensor<2>,
    /// The sentence embedding, `[batch, d_condition]`.
    pub embedding: Tensor<2>,
    /// What is added to the scales and shifts of all stylization layers, `[batch, modulations]` (see
    /// [`Denoiser::modulations`]); nothing by default. Networks without such layers ignore it.
    pub modulation: Option<Tensor<2>>,
    /// Which frames are part of each motion.
    pub mask: FrameMask,
}

/// Which frames of a padded batch are part of its motions.
#[derive(Clone, Debug)]
pub struct FrameMask {
    lengths: Vec<usize>,
    frames: usize,
    padding: Option<Padding>,
}

/// The padding of a batch as tensors `[batch, frames, 1]`.
#[derive(Clone, Debug)]
pub(crate) struct Padding {
    /// 1 where a frame is part of its motion, else 0.
    pub(crate) keep: Tensor<3>,
    /// 0 where a frame is part of its motion, else a million: no softmax over frames sees it.
    pub(crate) penalty: Tensor<3>,
}

impl FrameMask {
    /// The mask of motions of given lengths, padded to `frames` frames.
    ///
    /// # Panics
    ///
    /// If a length is 0 or above `frames`, or there is none.
    pub fn new(lengths: &[usize], frames: usize, device: &Device) -> Self {
        let keep = frame_mask(lengths, frames, device);
        FrameMask {
            lengths: lengths.to_vec(),
            frames,
            padding: keep.map(|keep| Padding {
                penalty: (1.0 - keep.clone()) * 1e6,
                keep,
            }),
        }
    }

    /// 1 where a frame is part of its motion, else 0: `[batch, frames, 1]`. `None` where no motion
    /// is padded, so that no work is spent on it.
    pub fn keep(&self) -> Option<Tensor<3>> {
        self.padding.as_ref().map(|padding| padding.keep.clone())
    }

    pub(crate) fn padding(&self) -> Option<&Padding> {
        self.padding.as_ref()
    }

    /// Length of each motion in frames.
    pub fn lengths(&self) -> &[usize] {
        &self.lengths
    }

    /// Number of frames with padding.
    pub fn frames(&self) -> usize {
        self.frames
    }
}
