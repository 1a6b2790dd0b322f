//! The decoder on the CPU. The kernels of `lamogen-cpu` use the weights of the modules without copying them.
//!
//! ```text
//! modules ──shared memory──▶ Decoder ◀── DenoiserInput, if it lies completely in the CPU's memory
//! ```

use burn::backend::Flex;
use burn::backend::flex::{FlexTensor, Layout as Strides};
use burn::module::{Param, ParamId};
use burn::nn::{LayerNorm, Linear};
use burn::optim::GradientsParams;
use burn::tensor::{DType, Tensor, TensorData};
use lamogen_cpu::{Decoder, DecoderGradients, DecoderInput, Matrix, Tape, WeightLayout};

use super::cross_attention::CrossAttentionContext;
use super::kept_modulations::KeptModulations;
use crate::denoiser::DenoiserInput;

/// The numbers of a tensor in memory that is shared with the tensor.
#[derive(Clone, Debug)]
pub(crate) struct SharedFloats {
    tensor: FlexTensor,
    start: usize,
    count: usize,
}

impl AsRef<[f32]> for SharedFloats {
    fn as_ref(&self) -> &[f32] {
        &self.tensor.storage::<f32>()[self.start..][..self.count]
    }
}

impl SharedFloats {
    /// Returns the numbers of a tensor, row by row. Returns `None` if they are not 32-bit floats in the CPU's memory, or if
    /// autodiff tracks the tensor.
    pub(crate) fn from_tensor<const D: usize>(tensor: Tensor<D>) -> Option<Self> {
        Some(Self::from_flex(flex_tensor(tensor)?.to_contiguous()))
    }

    /// Returns the numbers in their order in memory.
    fn from_flex(tensor: FlexTensor) -> Self {
        SharedFloats {
            start: tensor.layout().start_offset(),
            count: tensor.layout().num_elements(),
            tensor,
        }
    }
}

/// Returns the tensor of the backend `flex`, or `None` if the tensor lies elsewhere or does not have 32-bit floats.
fn flex_tensor<const D: usize>(tensor: Tensor<D>) -> Option<FlexTensor> {
    let tensor = tensor.try_into_primitive::<Flex>().ok()?;
    (tensor.dtype() == DType::F32).then_some(tensor)
}

fn shared_floats(parameter: &Param<Tensor<1>>) -> Option<SharedFloats> {
    SharedFloats::from_tensor(parameter.val())
}

/// Returns the kernel of a linear layer. Weights from PyTorch's files are transposed views, which are shared in the order
/// in which they are stored.
pub(crate) fn linear_kernel(layer: &Linear) -> Option<lamogen_cpu::Linear<SharedFloats>> {
    let weight = layer.weight.val();
    let [inputs, outputs] = weight.dims();
    let weight = flex_tensor(weight)?;
    let transposed = |strides: &Strides| *strides.strides() == [1, inputs as isize];
    let (floats, layout) = match transposed(weight.layout()) {
        true => (SharedFloats::from_flex(weight), WeightLayout::ByOutput),
        false => (
            SharedFloats::from_flex(weight.to_contiguous()),
            WeightLayout::ByInput,
        ),
    };
    let weight = Matrix::new(floats, inputs, outputs, layout);
    Some(lamogen_cpu::Linear::new(weight, shared_bias(&layer.bias)?))
}

/// Returns the kernel of a layer normalization.
pub(crate) fn norm_kernel(layer: &LayerNorm) -> Option<lamogen_cpu::LayerNorm<SharedFloats>> {
    Some(lamogen_cpu::LayerNorm {
        gamma: shared_floats(&layer.gamma)?,
        beta: shared_bias(&layer.beta)?,
        epsilon: super::NORM_EPSILON as f32,
    })
}

fn shared_bias(parameter: &Option<Param<Tensor<1>>>) -> Option<SharedFloats> {
    shared_floats(parameter.as_ref()?)
}

/// Adds the gradients of a linear layer to `gradients`, under the ids of the layer's parameters.
pub(crate) fn register_linear_gradients(
    layer: &Linear,
    gradient: lamogen_cpu::Linear<Vec<f32>>,
    gradients: &mut GradientsParams,
) {
    let (weight, bias) = gradient.into_parts();
    let shape: [usize; 2] = layer.weight.lazy_shape().dims();
    gradients.register(layer.weight.id, tensor(weight, shape));
    register_vector(bias_id(&layer.bias), bias, gradients);
}

/// Adds the gradients of a normalization to `gradients`.
pub(crate) fn register_norm_gradients(
    layer: &LayerNorm,
    gradient: lamogen_cpu::LayerNorm<Vec<f32>>,
    gradients: &mut GradientsParams,
) {
    register_vector(layer.gamma.id, gradient.gamma, gradients);
    register_vector(bias_id(&layer.beta), gradient.beta, gradients);
}

fn register_vector(id: ParamId, gradient: Vec<f32>, gradients: &mut GradientsParams) {
    let shape = [gradient.len()];
    gradients.register(id, tensor(gradient, shape));
}

fn bias_id(parameter: &Option<Param<Tensor<1>>>) -> ParamId {
    parameter.as_ref().expect("layers with a bias").id
}

/// An evaluation of the decoder with weights and inputs that all lie in the CPU's memory.
pub(super) struct CpuEvaluation {
    decoder: Decoder<SharedFloats>,
    x_t: SharedFloats,
    condition: SharedFloats,
    /// What the layer of the modulations makes of the condition, if it is known.
    modulated: Option<Vec<f32>>,
    modulation: Option<SharedFloats>,
    text: Vec<SharedFloats>,
    lengths: Vec<usize>,
    /// The shape of `x_t` and of the output: batch, frames, features.
    shape: [usize; 3],
}

impl CpuEvaluation {
    /// Prepares an evaluation. Returns `None` if a tensor does not lie in the CPU's memory, or if autodiff tracks one.
    pub(super) fn new(
        decoder: impl FnOnce() -> Option<Decoder<SharedFloats>>,
        input: &DenoiserInput,
        context: &CrossAttentionContext,
    ) -> Option<Self> {
        let x_t = SharedFloats::from_tensor(input.x_t.clone())?;
        let shape @ [motions, frames, _] = input.x_t.dims();
        assert_eq!(
            [motions, frames],
            [input.mask.lengths().len(), input.mask.frames()],
            "the mask must be of as many motions and frames as x_t"
        );
        let condition = input.time.clone() + input.embedding.clone();
        let text = context.0.iter().cloned();
        let modulation = match input.modulation.clone() {
            Some(modulation) => Some(SharedFloats::from_tensor(modulation)?),
            None => None,
        };
        Some(CpuEvaluation {
            modulation,
            shape,
            x_t,
            condition: SharedFloats::from_tensor(condition)?,
            modulated: None,
            text: text.map(SharedFloats::from_tensor).collect::<Option<_>>()?,
            decoder: decoder()?,
            lengths: input.mask.lengths().to_vec(),
        })
    }

    /// Takes the scales and shifts of the condition from those that are kept, and keeps those that are new.
    pub(super) fn with_kept_modulations(self, kept: &KeptModulations) -> Self {
        let modulated = kept.of(&self.decoder, self.condition.as_ref());
        CpuEvaluation {
            modulated: Some(modulated),
            ..self
        }
    }

    /// Computes the network's output.
    pub(super) fn run(&self) -> Tensor<3> {
        self.with_input(|input| self.output(self.decoder.evaluate(input)))
    }

    /// Computes the network's output and the tape that [`backward`](Self::backward) needs.
    pub(super) fn record(&self) -> (Tensor<3>, Tape) {
        self.with_input(|input| {
            let (output, tape) = self.decoder.record(input);
            (self.output(output), tape)
        })
    }

    /// Computes the gradient with respect to the embedding, or to the modulation if the input has one.
    pub(super) fn backward(&self, tape: Tape, gradient: Tensor<3>) -> Tensor<2> {
        let gradient = gradient_floats(gradient);
        let gradient = gradient.as_ref();
        let out = self.with_input(|input| match input.modulation {
            None => self.decoder.backward(input, tape, gradient),
            Some(_) => self.decoder.backward_to_modulation(input, tape, gradient),
        });
        let [motions, _, _] = self.shape;
        let width = out.len() / motions;
        tensor(out, [motions, width])
    }

    /// Computes the network's output and the tape that [`gradients`](Self::gradients) needs.
    pub(super) fn record_for_training(&self) -> (Tensor<3>, Tape) {
        self.with_input(|input| {
            let (output, tape) = self.decoder.record_for_training(input);
            (self.output(output), tape)
        })
    }

    /// Computes the gradient with respect to the noisy motion. The evaluation must be recorded for training.
    pub(super) fn backward_to_motion(&self, tape: Tape, gradient: Tensor<3>) -> Tensor<3> {
        let gradient = gradient_floats(gradient);
        let backward = |input: DecoderInput<'_>| {
            let decoder = &self.decoder;
            decoder.backward_to_motion(input, tape, gradient.as_ref())
        };
        self.output(self.with_input(backward))
    }

    /// Computes all gradients from the gradient of the output.
    pub(super) fn gradients(&self, tape: Tape, gradient: Tensor<3>) -> DecoderGradients {
        let gradient = gradient_floats(gradient);
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
            modulated: self.modulated.as_deref(),
            modulation: self.modulation.as_ref().map(AsRef::as_ref),
            text: &text,
            lengths: &self.lengths,
            frames,
        })
    }
}

/// Returns the numbers of a gradient that a caller provides.
fn gradient_floats(gradient: Tensor<3>) -> SharedFloats {
    SharedFloats::from_tensor(gradient)
        .expect("a gradient of 32-bit floats that lies where the output does and is not tracked")
}

/// Creates a tensor on the CPU.
pub(crate) fn tensor<const D: usize>(numbers: Vec<f32>, shape: [usize; D]) -> Tensor<D> {
    Tensor::from_data(
        TensorData::new(numbers, shape),
        &burn::tensor::Device::flex(),
    )
}
