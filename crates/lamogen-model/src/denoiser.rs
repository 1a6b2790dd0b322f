//! The interface through which guidance uses a network.

use burn::tensor::{Device, Tensor};
use lamogen_motion::{FeatureGroup, frame_mask};

use crate::config::{LABAN_FEATURES, Prediction};
use crate::diffusion::{MotionWindow, NoiseSchedule, SamplingMethod};
use crate::tokens::TokenBatch;

/// A text-to-motion denoiser that can be sampled from and guided.
///
/// The computation is divided by its inputs, so that nothing is computed twice: [`encode`](Denoiser::encode) runs once per
/// prompt, [`embed_timesteps`](Denoiser::embed_timesteps) once per timestep, and [`denoise`](Denoiser::denoise) at every
/// step. Guidance moves the embedding of a [`Prompt`] along the derivative that [`linearize`](Denoiser::linearize) gives.
/// The weights are never tracked by autodiff.
pub trait Denoiser {
    /// The data that the network needs of a prompt in addition to the embedding.
    type Context: Clone;

    /// Returns the quantity that [`denoise`](Denoiser::denoise) predicts.
    fn prediction(&self) -> Prediction;

    /// Returns the number of pose features per frame.
    fn pose_features(&self) -> usize;

    /// Returns the length of the longest motion, in frames.
    fn max_frames(&self) -> usize;

    /// Returns the length of the shortest motion, in frames.
    fn min_frames(&self) -> usize {
        1
    }

    /// Returns the noise schedule that the network was trained with. The default is MotionDiffuse's.
    fn noise_schedule(&self) -> NoiseSchedule {
        NoiseSchedule::default()
    }

    /// Returns the sampling method that the network's authors use, which is the default for generating motions with it.
    fn sampling_method(&self) -> SamplingMethod {
        SamplingMethod::default()
    }

    /// Returns the windows in which the network continues a motion, or `None`, the default, if it makes whole motions.
    fn window(&self) -> Option<MotionWindow> {
        None
    }

    /// Returns the device that holds the weights.
    fn device(&self) -> Device;

    /// Computes everything that depends on the prompts alone.
    ///
    /// # Shapes
    ///
    /// - `tokens`: `[batch, tokens]`, as the network's own tokenizer pads them
    /// - output: see [`Prompt`]
    ///
    /// # Panics
    ///
    /// May panic if an id is beyond the vocabulary or there are more tokens than the context holds.
    fn encode(&self, tokens: &TokenBatch) -> Prompt<Self::Context>;

    /// Returns what takes the place of the prompts in the unconditional evaluation of classifier-free guidance.
    ///
    /// `wordless` is a batch of as many texts without words. The default encodes them. A network that was trained to drop the
    /// text in another way overrides this method.
    fn unconditional(
        &self,
        prompts: &Prompt<Self::Context>,
        wordless: &TokenBatch,
    ) -> Prompt<Self::Context> {
        let _ = prompts;
        self.encode(wordless)
    }

    /// Returns the scale of classifier-free guidance of each pose feature, for a given scale of the text.
    ///
    /// The default limits the turning of the root ([`FeatureGroup::RootYaw`]) to a scale of 1. It is one feature of 263 and
    /// is summed over all frames, so a scale of 2.5 would turn the body by half a circle where a quarter was requested.
    fn text_scales(&self, scale: f64) -> Vec<f32> {
        limited_text_scales(scale, self.pose_features())
    }

    /// Returns the context of motions that continue `prefix`, the normalised frames `[batch, frames, features]` before the
    /// window. Only networks with a [`window`](Denoiser::window) read a prefix; the default returns the context as it is.
    fn with_prefix(&self, context: Self::Context, prefix: Tensor<3>) -> Self::Context {
        let _ = prefix;
        context
    }

    /// Computes everything that depends on the timesteps alone: `[timesteps, d_condition]`.
    fn embed_timesteps(&self, timesteps: &[usize]) -> Tensor<2>;

    /// Embeds the Laban features of the motions to be generated: the means over time of Weight, Time, Flow and Shape, or
    /// `None` for a feature that is not given.
    ///
    /// The result, `[motions, d_condition]`, is added to the embeddings of the prompts. It is `None` if the network cannot
    /// be conditioned on Laban features.
    fn embed_laban(&self, means: &[[Option<f32>; LABAN_FEATURES]]) -> Option<Tensor<2>> {
        let _ = means;
        None
    }

    /// Evaluates the network once. The output, `[batch, frames, features]`, is the quantity that
    /// [`prediction`](Denoiser::prediction) names, such as the noise or the clean motion.
    ///
    /// The output past a motion's length has no meaning.
    ///
    /// # Panics
    ///
    /// May panic if there are more frames than [`max_frames`](Denoiser::max_frames), if the number of features differs from
    /// [`pose_features`](Denoiser::pose_features), or if the input and the context have different numbers of motions.
    fn denoise(&self, input: DenoiserInput, context: &Self::Context) -> Tensor<3>;

    /// Evaluates the network for the prompts and without a text, as classifier-free guidance needs it. Returns both outputs,
    /// in this order.
    ///
    /// The default calls [`denoise`](Denoiser::denoise) twice. A network that is faster on one batch of twice the size
    /// overrides this method.
    ///
    /// # Panics
    ///
    /// In the same cases as [`denoise`](Denoiser::denoise).
    fn denoise_with_unconditional(
        &self,
        input: DenoiserInput,
        context: &Self::Context,
        unconditional: &Prompt<Self::Context>,
    ) -> [Tensor<3>; 2] {
        let without_text = input.without_text(unconditional);
        [
            self.denoise(input, context),
            self.denoise(without_text, &unconditional.context),
        ]
    }

    /// Evaluates the network once and prepares its derivative with respect to the embedding, or to the modulation if the
    /// input has one.
    ///
    /// No part of the input is tracked by autodiff. The default implementation applies autodiff to
    /// [`denoise`](Denoiser::denoise). A network with a faster derivative overrides this method.
    ///
    /// # Panics
    ///
    /// In the same cases as [`denoise`](Denoiser::denoise).
    fn linearize<'a>(
        &'a self,
        input: DenoiserInput,
        context: &'a Self::Context,
    ) -> LinearizedEvaluation<'a> {
        LinearizedEvaluation::by_autodiff(input, |input| self.denoise(input, context))
    }

    /// Evaluates the network again at the noisy motion and the timestep of a [linearized](Denoiser::linearize) evaluation, with
    /// another embedding or modulation. The output is that of [`denoise`](Denoiser::denoise).
    ///
    /// `unconditional` is what the first evaluation [kept](LinearizedEvaluation::unconditional). The default does not need it.
    ///
    /// # Panics
    ///
    /// In the same cases as [`denoise`](Denoiser::denoise).
    fn denoise_again(
        &self,
        input: DenoiserInput,
        context: &Self::Context,
        unconditional: Option<Tensor<3>>,
    ) -> Tensor<3> {
        let _ = unconditional;
        self.denoise(input, context)
    }

    /// Returns the number of scales and shifts of all stylization layers of the network together.
    ///
    /// The network computes the scales and shifts from the sentence and the timestep, and adds
    /// [`DenoiserInput::modulation`] to them. The number is 0, the default, if the network has no stylization layers.
    fn modulation_width(&self) -> usize {
        0
    }

    /// Returns the number of offsets of the conditioning tokens of all layers together: one for each channel of each layer.
    ///
    /// The offsets follow the scales and shifts in [`DenoiserInput::modulation`], and a network adds them to the tokens that
    /// carry sentence and timestep, at the input of each layer. The number is 0, the default, if the network has no such
    /// tokens.
    fn token_offset_width(&self) -> usize {
        0
    }

    /// Evaluates the network once and prepares its derivative with respect to the noisy motion `x_t`.
    ///
    /// Methods that optimise the start noise through all steps of a pass need this derivative. Otherwise the method is like
    /// [`linearize`](Denoiser::linearize).
    ///
    /// # Panics
    ///
    /// In the same cases as [`denoise`](Denoiser::denoise).
    fn linearize_motion<'a>(
        &'a self,
        input: DenoiserInput,
        context: &'a Self::Context,
    ) -> LinearizedEvaluation<'a, 3> {
        LinearizedEvaluation::of_motion_by_autodiff(input, |input| self.denoise(input, context))
    }
}

/// Returns the scale of each pose feature: the given scale, but at most 1 for the turning of the root (see
/// [`Denoiser::text_scales`]).
pub fn limited_text_scales(scale: f64, features: usize) -> Vec<f32> {
    let mut scales = vec![scale as f32; features];
    for yaw_scale in &mut scales[FeatureGroup::RootYaw.range()] {
        *yaw_scale = yaw_scale.min(1.0);
    }
    scales
}

/// An evaluation of a network with the derivative of its output.
///
/// The derivative is with respect to the embedding or the modulation (`D` is 2) or to the noisy motion (`D` is 3).
pub struct LinearizedEvaluation<'a, const D: usize = 2> {
    /// The output of [`Denoiser::denoise`], `[batch, frames, features]`, not tracked by autodiff.
    pub output: Tensor<3>,
    /// The output of the unconditional evaluation of classifier-free guidance, which another embedding or modulation does not
    /// change ([`Denoiser::denoise_again`]); `None` if there was none.
    pub unconditional: Option<Tensor<3>>,
    shape: [usize; 3],
    pullback: Box<dyn FnOnce(Tensor<3>) -> Tensor<D> + 'a>,
}

impl<'a, const D: usize> LinearizedEvaluation<'a, D> {
    /// Combines an output with the function that turns the gradient of the output into the gradient of the embedding, the
    /// modulation or the noisy motion.
    pub fn new(output: Tensor<3>, pullback: impl FnOnce(Tensor<3>) -> Tensor<D> + 'a) -> Self {
        LinearizedEvaluation {
            shape: output.dims(),
            output,
            unconditional: None,
            pullback: Box::new(pullback),
        }
    }

    /// Adds the output of the unconditional evaluation.
    pub fn with_unconditional(self, unconditional: Option<Tensor<3>>) -> Self {
        LinearizedEvaluation {
            unconditional,
            ..self
        }
    }

    /// Evaluates a function and prepares its derivative by autodiff.
    fn with_autodiff(input: Tensor<D>, evaluate: impl FnOnce(Tensor<D>) -> Tensor<3>) -> Self {
        let leaf = input.autodiff().require_grad();
        let output = evaluate(leaf.clone());
        LinearizedEvaluation::new(output.clone().inner(), move |gradient| {
            let product = (output * gradient.autodiff()).sum();
            let gradient = match product.is_tracked() {
                true => leaf.grad_remove(&mut product.backward()),
                false => None,
            };
            // A network may ignore its input, which then has no gradient.
            gradient.unwrap_or_else(|| leaf.inner().zeros_like())
        })
    }

    /// Turns the gradient of a loss with respect to the output into its gradient with respect to the input.
    ///
    /// The given gradient, `[batch, frames, features]`, must lie on the same device and not be tracked by autodiff. The
    /// result is the gradient with respect to the embedding, `[batch, d_condition]`, the modulation,
    /// `[batch, modulations]`, or the noisy motion, `[batch, frames, features]`.
    ///
    /// # Panics
    ///
    /// If the gradient and the output have different shapes.
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
    /// Evaluates a network and prepares, by autodiff, the derivative with respect to the embedding, or to the modulation if
    /// the input has one.
    pub fn by_autodiff(
        input: DenoiserInput,
        evaluate: impl FnOnce(DenoiserInput) -> Tensor<3>,
    ) -> Self {
        match input.modulation.clone() {
            None => Self::with_autodiff(input.embedding.clone(), |embedding| {
                evaluate(DenoiserInput { embedding, ..input })
            }),
            Some(modulation) => Self::with_autodiff(modulation, |modulation| {
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
    /// Evaluates a network and prepares, by autodiff, the derivative with respect to the noisy motion.
    pub fn of_motion_by_autodiff(
        input: DenoiserInput,
        evaluate: impl FnOnce(DenoiserInput) -> Tensor<3>,
    ) -> Self {
        Self::with_autodiff(input.x_t.clone(), |x_t| {
            evaluate(DenoiserInput { x_t, ..input })
        })
    }
}

/// An encoded batch of prompts.
#[derive(Clone, Debug)]
pub struct Prompt<C> {
    /// The projected sentence embedding `e`, `[batch, d_condition]`, which guidance moves.
    pub embedding: Tensor<2>,
    /// The other data that the network needs of the prompts.
    pub context: C,
}

/// The input of a network at one step.
#[derive(Clone, Debug)]
pub struct DenoiserInput {
    /// The noisy motion, normalised, `[batch, frames, features]`.
    pub x_t: Tensor<3>,
    /// The timestep of each row of [`time`](Self::time).
    pub timesteps: Vec<usize>,
    /// The embedded timestep: `[1, d_condition]` if all motions share it, or `[batch, d_condition]`.
    pub time: Tensor<2>,
    /// The sentence embedding, `[batch, d_condition]`.
    pub embedding: Tensor<2>,
    /// An optional offset that is added to the scales and shifts of all stylization layers (see
    /// [`Denoiser::modulation_width`]), followed by the offsets of the conditioning tokens (see
    /// [`Denoiser::token_offset_width`]): `[batch, modulations + token offsets]`. Networks without both ignore it.
    pub modulation: Option<Tensor<2>>,
    /// The mask of the frames that are part of each motion.
    pub mask: FrameMask,
}

impl DenoiserInput {
    /// Returns the input of the unconditional evaluation: the same motion without the sentence and what guidance added to it.
    pub fn without_text<C>(&self, unconditional: &Prompt<C>) -> Self {
        DenoiserInput {
            embedding: unconditional.embedding.clone(),
            modulation: None,
            ..self.clone()
        }
    }
}

/// The mask of the frames of a padded batch that are part of its motions.
#[derive(Clone, Debug)]
pub struct FrameMask {
    lengths: Vec<usize>,
    frames: usize,
    padding: Option<Padding>,
}

/// The padding of a batch as tensors `[batch, frames, 1]`.
#[derive(Clone, Debug)]
pub(crate) struct Padding {
    /// 1 if a frame is part of its motion, otherwise 0.
    pub(crate) keep: Tensor<3>,
    /// 0 if a frame is part of its motion, otherwise a million, which excludes the frame from softmaxes over frames.
    pub(crate) penalty: Tensor<3>,
}

impl FrameMask {
    /// Creates the mask of motions of given lengths, padded to `frames` frames.
    ///
    /// # Panics
    ///
    /// If a length is 0 or above `frames`, or if there are no lengths.
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

    /// Returns the mask as a tensor `[batch, frames, 1]`: 1 if a frame is part of its motion, otherwise 0.
    ///
    /// Returns `None` if no motion is padded, so that the caller can skip the masking.
    pub fn keep(&self) -> Option<Tensor<3>> {
        self.padding.as_ref().map(|padding| padding.keep.clone())
    }

    pub(crate) fn padding(&self) -> Option<&Padding> {
        self.padding.as_ref()
    }

    /// Returns the length of each motion in frames.
    pub fn lengths(&self) -> &[usize] {
        &self.lengths
    }

    /// Returns the number of frames, including padding.
    pub fn frames(&self) -> usize {
        self.frames
    }
}
