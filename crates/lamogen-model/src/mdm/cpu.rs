//! MDM on the CPU. The kernels of `lamogen-cpu` use the weights of the modules without copying them.

use burn::tensor::Tensor;
use lamogen_cpu::{Transformer, TransformerInput, TransformerTape, TransformerWeightGradients};

use super::network::MdmContext;
use crate::denoiser::DenoiserInput;
use crate::network::cpu::{SharedFloats, tensor};

/// An evaluation of the network with weights and inputs that all lie in the CPU's memory.
pub(super) struct CpuEvaluation<'n> {
    transformer: Transformer<SharedFloats>,
    poses: SharedFloats,
    lengths: Vec<usize>,
    positions: &'n [f32],
    tokens: SharedFloats,
    token_penalty: Option<SharedFloats>,
    offsets: Option<SharedFloats>,
    /// The number of frames of the prefix.
    prefix: usize,
    /// The shape of the output, with the frames of the prefix.
    shape: [usize; 3],
}

impl<'n> CpuEvaluation<'n> {
    /// Prepares an evaluation. Returns `None` if a tensor does not lie in the CPU's memory, or if autodiff tracks one.
    pub(super) fn new(
        transformer: impl FnOnce() -> Option<Transformer<SharedFloats>>,
        positions: &'n [f32],
        input: &DenoiserInput,
        context: &MdmContext,
    ) -> Option<Self> {
        let [motions, frames, _] = input.x_t.dims();
        assert_eq!(
            [motions, frames],
            [input.mask.lengths().len(), input.mask.frames()],
            "the mask must be of as many motions and frames as x_t"
        );
        let (poses, prefix) = context.with_prefix_frames(input.x_t.clone());
        let optional = |tensor: Option<Tensor<2>>| match tensor {
            Some(tensor) => SharedFloats::from_tensor(tensor).map(Some),
            None => Some(None),
        };
        let penalty =
            { context.penalty.clone() }.map(|penalty| penalty.reshape([motions, context.tokens]));
        Some(CpuEvaluation {
            shape: poses.dims(),
            poses: SharedFloats::from_tensor(poses)?,
            lengths: { input.mask.lengths().iter() }
                .map(|length| prefix + length)
                .collect(),
            positions,
            tokens: SharedFloats::from_tensor(context.conditioned_tokens(input))?,
            token_penalty: optional(penalty)?,
            offsets: optional(input.modulation.clone())?,
            transformer: transformer()?,
            prefix,
        })
    }

    /// Computes the network's output.
    pub(super) fn run(&self) -> Tensor<3> {
        self.output(self.transformer.evaluate(self.input()))
    }

    /// Computes the network's output and the tape that [`backward`](Self::backward) needs.
    pub(super) fn record(&self) -> (Tensor<3>, TransformerTape) {
        let (output, tape) = self.transformer.record(self.input());
        (self.output(output), tape)
    }

    /// Computes the gradient with respect to the embedding, or to the offsets if the input has them.
    pub(super) fn backward(&self, tape: &TransformerTape, gradient: Tensor<3>) -> Tensor<2> {
        let [motions, _, _] = self.shape;
        let gradient = self.with_gradient_of_prefix(gradient);
        let input = self.input();
        let gradients = { &self.transformer }.backward(input, tape, gradient.as_ref());
        let numbers = match input.offsets {
            None => gradients.tokens,
            Some(_) => gradients.offsets,
        };
        let width = numbers.len() / motions;
        tensor(numbers, [motions, width])
    }

    /// Computes the gradients of all weights and of the conditioning tokens.
    pub(super) fn gradients(
        &self,
        tape: &TransformerTape,
        gradient: Tensor<3>,
    ) -> TransformerWeightGradients {
        let gradient = self.with_gradient_of_prefix(gradient);
        { &self.transformer }.gradients(self.input(), tape, gradient.as_ref())
    }

    /// Returns the numbers of a gradient of the output, after zeros for the frames of the prefix.
    fn with_gradient_of_prefix(&self, gradient: Tensor<3>) -> SharedFloats {
        let [motions, _, features] = self.shape;
        let zeros = Tensor::zeros([motions, self.prefix, features], &gradient.device());
        let gradient = match self.prefix {
            0 => gradient,
            _ => Tensor::cat(vec![zeros, gradient], 1),
        };
        SharedFloats::from_tensor(gradient).expect(
            "a gradient of 32-bit floats that lies where the output does and is not tracked",
        )
    }

    fn input(&self) -> TransformerInput<'_> {
        let [_, frames, _] = self.shape;
        TransformerInput {
            poses: self.poses.as_ref(),
            frames,
            lengths: &self.lengths,
            positions: self.positions,
            tokens: self.tokens.as_ref(),
            token_penalty: self.token_penalty.as_ref().map(AsRef::as_ref),
            offsets: self.offsets.as_ref().map(AsRef::as_ref),
        }
    }

    fn output(&self, numbers: Vec<f32>) -> Tensor<3> {
        let [_, frames, _] = self.shape;
        tensor(numbers, self.shape).narrow(1, self.prefix, frames - self.prefix)
    }
}
