//! The keys of the parameters of a network in a checkpoint.
//!
//! Every layer lists the keys of its parameters once ([`NamedParameters::keys`]), and both loading and saving use that list. The
//! keys and layouts are those of PyTorch, as in the public MotionDiffuse checkpoint. A linear weight is stored as
//! `[output, input]`; a transposed view of it is burn's `[input, output]`.

use burn::module::Param;
use burn::nn::conv::Conv1d;
use burn::nn::{Embedding, LayerNorm, Linear};
use burn::tensor::{Device, Tensor, TensorData};

/// A layer, or a whole network, that knows the keys of its parameters.
///
/// Such a network can be filled from a [`Checkpoint`](crate::Checkpoint) and written to one.
///
/// ```
/// use burn::module::Module;
/// use burn::nn::Linear;
/// use lamogen_model::{NamedParameters, ParameterList};
///
/// #[derive(Module, Debug)]
/// struct Head {
///     expand: Linear,
///     contract: Linear,
/// }
///
/// impl NamedParameters for Head {
///     fn keys(&mut self, keys: &mut ParameterList) {
///         keys.linear("0", &mut self.expand);
///         keys.linear("2", &mut self.contract);
///     }
/// }
/// ```
pub trait NamedParameters {
    /// Lists all parameters, under keys relative to the layer.
    fn keys(&mut self, keys: &mut ParameterList);
}

/// A visitor of the tensors of a network, which reads them from a file or writes them to one.
pub(crate) trait TensorVisitor {
    /// Visits one tensor. `current` computes the tensor's present value. The returned value, if any, replaces it.
    fn visit(
        &mut self,
        key: &str,
        shape: &[usize],
        current: &dyn Fn() -> TensorData,
    ) -> Option<TensorData>;
}

/// The list of a network's parameters, which are matched one by one with the tensors of a file.
///
/// The key of a parameter consists of the names of the layers around it and its own name, separated by dots. The layouts
/// are those of PyTorch.
pub struct ParameterList<'a> {
    prefix: String,
    device: Device,
    visitor: &'a mut dyn TensorVisitor,
}

impl<'a> ParameterList<'a> {
    pub(super) fn new(device: Device, visitor: &'a mut dyn TensorVisitor) -> Self {
        ParameterList {
            prefix: String::new(),
            device,
            visitor,
        }
    }

    /// Lists a layer whose keys begin with `name.`.
    pub fn nested(&mut self, name: &str, layer: &mut impl NamedParameters) {
        let outer = self.prefix.len();
        self.prefix.push_str(name);
        self.prefix.push('.');
        layer.keys(self);
        self.prefix.truncate(outer);
    }

    /// Lists a layer whose keys have no prefix of their own.
    pub fn flat(&mut self, layer: &mut impl NamedParameters) {
        layer.keys(self);
    }

    /// Lists layers whose keys begin with `name.0.`, `name.1.`, …
    pub fn each(&mut self, name: &str, layers: &mut [impl NamedParameters]) {
        for (index, layer) in layers.iter_mut().enumerate() {
            self.nested(&format!("{name}.{index}"), layer);
        }
    }

    /// Lists a linear layer: `name.weight`, `[output, input]`, and `name.bias`.
    pub fn linear(&mut self, name: &str, linear: &mut Linear) {
        self.linear_named(&format!("{name}.weight"), &format!("{name}.bias"), linear);
    }

    /// Lists a linear layer whose keys do not end in `.weight` and `.bias`.
    pub fn linear_named(&mut self, weight: &str, bias: &str, linear: &mut Linear) {
        let [input, output] = linear.weight.lazy_shape().dims();
        let current = || linear.weight.val().transpose().into_data();
        if let Some(data) = self.visit(weight, &[output, input], &current) {
            let stored = Tensor::<2>::from_data(data, &self.device);
            linear.weight = with_value(&linear.weight, stored.transpose());
        }
        if let Some(parameter) = &mut linear.bias {
            self.vector(bias, parameter);
        }
    }

    /// Lists one linear layer that the file stores as several layers. The outputs of the layer are the outputs of the file's
    /// layers, one after another.
    pub(crate) fn linear_from_parts(&mut self, names: &[String], linear: &mut Linear) {
        let [input, total] = linear.weight.lazy_shape().dims();
        let output = total / names.len().max(1);
        let bias = linear.bias.as_ref().expect("layers with a bias");
        let (mut weights, mut biases) = (Vec::new(), Vec::new());
        for (index, name) in names.iter().enumerate() {
            let start = index * output;
            let part = || linear.weight.val().narrow(1, start, output);
            let key = format!("{name}.weight");
            weights.extend(self.visit(&key, &[output, input], &|| part().transpose().into_data()));
            let part = || bias.val().narrow(0, start, output);
            let key = format!("{name}.bias");
            biases.extend(self.visit(&key, &[output], &|| part().into_data()));
        }
        let complete = !names.is_empty() && weights.len() == names.len();
        if complete && biases.len() == names.len() {
            let stored = |data: TensorData| Tensor::<2>::from_data(data, &self.device);
            let weight = Tensor::cat(weights.into_iter().map(stored).collect(), 0).transpose();
            let stored = |data: TensorData| Tensor::<1>::from_data(data, &self.device);
            let joined = Tensor::cat(biases.into_iter().map(stored).collect(), 0);
            let bias = with_value(bias, joined);
            linear.weight = with_value(&linear.weight, weight);
            linear.bias = Some(bias);
        }
    }

    /// Lists a layer normalization: `name.weight` and `name.bias`.
    pub fn norm(&mut self, name: &str, norm: &mut LayerNorm) {
        self.vector(&format!("{name}.weight"), &mut norm.gamma);
        if let Some(beta) = &mut norm.beta {
            self.vector(&format!("{name}.bias"), beta);
        }
    }

    /// Lists an embedding: `name.weight`, `[ids, width]`.
    pub fn embedding(&mut self, name: &str, embedding: &mut Embedding) {
        self.matrix(&format!("{name}.weight"), &mut embedding.weight);
    }

    /// Lists a one-dimensional convolution: `name.weight`, `[output, input, kernel]`, and `name.bias`.
    pub fn conv1d(&mut self, name: &str, conv: &mut Conv1d) {
        self.parameter(&format!("{name}.weight"), &mut conv.weight);
        if let Some(bias) = &mut conv.bias {
            self.vector(&format!("{name}.bias"), bias);
        }
    }

    pub(crate) fn matrix(&mut self, key: &str, parameter: &mut Param<Tensor<2>>) {
        self.parameter(key, parameter);
    }

    fn vector(&mut self, key: &str, parameter: &mut Param<Tensor<1>>) {
        self.parameter(key, parameter);
    }

    /// Lists a parameter that is stored in its own layout.
    pub fn parameter<const D: usize>(&mut self, key: &str, parameter: &mut Param<Tensor<D>>) {
        let shape = parameter.lazy_shape();
        let current = || parameter.val().into_data();
        if let Some(data) = self.visit(key, &shape.to_vec(), &current) {
            *parameter = with_value(parameter, Tensor::from_data(data, &self.device));
        }
    }

    fn visit(
        &mut self,
        key: &str,
        shape: &[usize],
        current: &dyn Fn() -> TensorData,
    ) -> Option<TensorData> {
        let key = format!("{}{key}", self.prefix);
        self.visitor.visit(&key, shape, current)
    }
}

/// Returns a parameter with another value. An optimiser treats it as the same parameter, and it can still be trained.
fn with_value<const D: usize>(parameter: &Param<Tensor<D>>, value: Tensor<D>) -> Param<Tensor<D>> {
    let mut replaced = Param::from_tensor(value);
    replaced.id = parameter.id;
    replaced
}
