//! The decoder on the CPU: the modules' own weights, handed to the kernels of `lamogen-cpu`.
//!
//! ```text
//! modules ──shared memory──▶ Decoder ◀── DenoiserInput, if all of it lies in the CPU's memory
//! ```

use burn::backend::Flex;
use burn::backend::flex::{FlexTensor, Layout as Strides};
use burn::module::{Param, ParamId};
use burn::nn::{LayerNorm, Linear};
use burn::optim::GradientsParams;
use burn::tensor::{DType, Tensor, TensorData};
use lamogen_cpu::{Decoder, DecoderGradients, DecoderInput, Matrix, Tape, WeightLayout};

use super::cross_attention::CrossAttentionContext;
use crate::denoiser::DenoiserInput;

/// A tensor's numbers, shared with the tensor.
#[derive(Clone, Debug)]
pub(super) struct Numbers {
    tensor: FlexTensor,
    start: usize,
    count: usize,
}

impl AsRef<[f32]> for Numbers {
    fn as_ref(&self) -> &[f32] {
        &self.tensor.storage::<f32>()[self.start..][..self.count]
    }
}

impl Numbers {
    /// A tensor's numbers, row after row. `None` if they are not 32-bit floats in the CPU's memory, or if
    /// gradients are followed through them.
    pub(super) fn of<const D: usize>(tensor: Tensor<D>) -> Option<Self> {
        Some(Self::of_flex(flex(tensor)?.to_contiguous()))
    }

    /// The numbers as they lie.
    fn of_flex(tensor: FlexTensor) -> Self {
        Numbers {
            start: tensor.layout().start_offset(),
            count: tensor.layout().num_elements(),
            tensor,
        }
    }
}

fn flex<const D: usize>(tensor: Tensor<D>) -> Option<FlexTensor> {
    let tensor = tensor.try_into_primitive::<Flex>().ok()?;
    (tensor.dtype() == DType::F32).then_some(tensor)
}

fn numbers(parameter: &Param<Tensor<1>>) -> Option<Numbers> {
    Numbers::of(parameter.val())
}

/// A linear layer; weights read from PyTorch's files are transposed views, which are shared as they lie.
pub(super) fn linear(layer: &Linear) -> Option<lamogen_cpu::Linear<Numbers>> {
    let weight = layer.weight.val();
    let [inputs, outputs] = weight.dims();
    let weight = flex(weight)?;
    let transposed = |strides: &Strides| *strides.strides() == [1, inputs as isize];
    let (numbers, layout) = match transposed(weight.layout()) {
        true => (Numbers::of_flex(weight), WeightLayout::ByOutput),
        false => (
            Numbers::of_flex(weight.to_contiguous()),
            WeightLayout::ByInput,
        ),
    };
    let weight = Matrix::new(numbers, inputs, outputs, layout);
    Some(lamogen_cpu::Linear::new(weight, numbers_of(&layer.bias)?))
}

pub(super) fn norm(layer: &LayerNorm) -> Option<lamogen_cpu::LayerNorm<Numbers>> {
    Some(lamogen_cpu::LayerNorm {
        gamma: numbers(&layer.gamma)?,
        beta: numbers_of(&layer.beta)?,
        epsilon: super::NORM_EPSILON as f32,
    })
}

fn numbers_of(parameter: &Option<Param<Tensor<1>>>) -> Option<Numbers> {
    numbers(parameter.as_ref()?)
}

/// Notes the gradients of a linear layer under the names of its parameters.
pub(super) fn note_linear(
    layer: &Linear,
    gradient: lamogen_cpu::Linear<Vec<f32>>,
    notes: &mut GradientsParams,
) {
    let (weight, bias) = gradient.into_parts();
    let shape: [usize; 2] = layer.weight.lazy_shape().dims();
    notes.register(layer.weight.id, tensor(weight, shape));
    note_vector(id(&layer.bias), bias, notes);
}

/// Notes the gradients of a normalization.
pub(super) fn note_norm(
    layer: &LayerNorm,
    gradient: lamogen_cpu::LayerNorm<Vec<f32>>,
    notes: &mut GradientsParams,
) {
    note_vector(layer.gamma.id, gradient.gamma, notes);
    note_vector(id(&layer.beta), gradient.beta, notes);
}

fn note_vector(id: ParamId, gradient: Vec<f32>, notes: &mut GradientsParams) {
    let shape = [gradient.len()];
    notes.register(id, tensor(gradient, shape));
}

fn id(parameter: &Option<Param<Tensor<1>>>) -> ParamId {
    parameter.as_ref().expect("layers with a bias").id
}

/// An evaluation whose weights and inputs all lie in the CPU's memory.
pub(super) struct Evaluation {
    decoder: Decoder<Numbers>,
    x_t: Numbers,
    condition: Numbers,
    modulation: Option<Numbers>,
    text: Vec<Numbers>,
    lengths: Vec<usize>,
    /// Batch, frames, features.
    shape: [usize; 3],
}

impl Evaluation {
    /// `None` if something lies elsewhere, or if gradients are followed by other means.
    pub(super) fn new(
        decoder: impl FnOnce() -> Option<Decoder<Numbers>>,
        input: &DenoiserInput,
        context: &CrossAttentionContext,
    ) -> Option<Self> {
        let x_t = Numbers::of(input.x_t.clone())?;
        let shape @ [motions, frames, _] = input.x_t.dims();
        assert_eq!(
            [motions, frames],
            [input.mask.lengths().len(), input.mask.frames()],
            "the mask must be of as many motions and frames as x_t"
        );
        let condition = input.time.clone() + input.embedding.clone();
        let text = context.0.iter().cloned();
        let modulation = match input.modulation.clone() {
            Some(modulation) => Some(Numbers::of(modulation)?),
            None => None,
        };
        Some(Evaluation {
            modulation,
            shape,
            x_t,
            condition: Numbers::of(condition)?,
            text: text.map(Numbers::of).collect::<Option<_>>()?,
            decoder: decoder()?,
            lengths: input.mask.lengths().to_vec(),
        })
    }

    /// The network's output.
    pub(super) fn run(&self) -> Tensor<3> {
        self.with_input(|input| self.output(self.decoder.evaluate(input)))
    }

    /// The network's output, and what [`backward`](Self::backward) needs.
    pub(super) fn record(&self) -> (Tensor<3>, Tape) {
        self.with_input(|input| {
            let (output, tape) = self.decoder.record(input);
            (self.output(output), tape)
        })
    }

    /// The gradient with respect to the embedding, or to the modulation where there is one.
    pub(super) fn backward(&self, tape: Tape, gradient: Tensor<3>) -> Tensor<2> {
        let gradient = untracked(gradient);
        let gradient = gradient.as_ref();
        let out = self.with_input(|input| match input.modulation {
            None => self.decoder.backward(input, tape, gradient),
            Some(_) => self.decoder.backward_to_modulation(input, tape, gradient),
        });
        let [motions, _, _] = self.shape;
        let width = out.len() / motions;
        tensor(out, [motions, width])
    }

    /// The network's output, and what [`gradients`](Self::gradients) needs.
    pub(super) fn record_for_training(&self) -> (Tensor<3>, Tape) {
        self.with_input(|input| {
            let (output, tape) = self.decoder.record_for_training(input);
            (self.output(output), tape)
        })
    }

    /// The gradient with respect to the noisy motion; of an evaluation recorded for training.
    pub(super) fn backward_to_motion(&self, tape: Tape, gradient: Tensor<3>) -> Tensor<3> {
        let gradient = untracked(gradient);
        let backward = |input: DecoderInput<'_>| {
            let decoder = &self.decoder;
            decoder.backward_to_motion(input, tape, gradient.as_ref())
        };
        self.output(self.with_input(backward))
    }

    /// All gradients from that of the output.
    pub(super) fn gradients(&self, tape: Tape, gradient: Tensor<3>) -> DecoderGradients {
        let gradient = untracked(gradient);
        self.with_input(|input| self.decoder.gradients(input, tape, gradient.as_ref()))
    }

    fn output(&self, numbers: Vec<f32>) -> Tensor<3> {
        tensor(numbers, self.shape)
    }

    fn with_input<R>(&self, function: impl FnOnce(DecoderInput<'_>) -> R) -> R {
        let text: Vec<&[f32]> = self.text.iter().map(AsRef::as_ref).collect();
        let [_, frames, _] = self.shape;
        function(DecoderInput {
            x_t: self.x_t.as_ref(),
            condition: self.condition.as_ref(),
            modulation: self.modulation.as_ref().map(AsRef::as_ref),
            text: &text,
            lengths: &self.lengths,
            frames,
        })
    }
}

/// The numbers of a gradient that a caller hands back.
fn untracked(gradient: Tensor<3>) -> Numbers {
    Numbers::of(gradient)
        .expect("a gradient of 32-bit floats that lies where the output does and is not tracked")
}

pub(super) fn tensor<const D: usize>(numbers: Vec<f32>, shape: [usize; D]) -> Tensor<D> {
    Tensor::from_data(
        TensorData::new(numbers, shape),
        &burn::tensor::Device::flex(),
    )
}
