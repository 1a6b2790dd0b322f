//! Which key of a checkpoint belongs to which parameter.
//!
//! Every layer lists its keys once ([`Keyed::keys`]); loading and saving both walk that list.
//! Keys and layouts are PyTorch's, as in the public MotionDiffuse checkpoint: a linear weight is
//! stored `[output, input]`, and becomes burn's `[input, output]` by a transposed view.

use burn::module::Param;
use burn::nn::conv::Conv1d;
use burn::nn::{Embedding, LayerNorm, Linear};
use burn::tensor::{Device, Tensor, TensorData};

/// A layer, or a whole network, that knows the keys of its parameters.
///
/// A network that lists them can be filled from a [`Checkpoint`](crate::Checkpoint) and written to one.
///
/// ```
/// use burn::module::Module;
/// use burn::nn::Linear;
/// use lamogen_model::{Keyed, Keys};
///
/// #[derive(Module, Debug)]
/// struct Head {
///     expand: Linear,
///     contract: Linear,
/// }
///
/// impl Keyed for Head {
///     fn keys(&mut self, keys: &mut Keys) {
///         keys.linear("0", &mut self.expand);
///         keys.linear("2", &mut self.contract);
///     }
/// }
/// ```
pub trait Keyed {
    /// Names every parameter, under keys relative to the layer.
    fn keys(&mut self, keys: &mut Keys);
}

/// The other side: a file that is read or written.
pub(crate) trait Exchange {
    /// Meets one tensor. `current` gives its present value; the answer replaces it.
    fn tensor(
        &mut self,
        key: &str,
        shape: &[usize],
        current: &dyn Fn() -> TensorData,
    ) -> Option<TensorData>;
}

/// Walks the parameters of a network beside the tensors of a file.
///
/// A parameter's key is its name after those of the layers around it, with dots between. Layouts are
/// PyTorch's.
pub struct Keys<'a> {
    prefix: String,
    device: Device,
    exchange: &'a mut dyn Exchange,
}

impl<'a> Keys<'a> {
    pub(super) fn new(device: Device, exchange: &'a mut dyn Exchange) -> Self {
        Keys {
            prefix: String::new(),
            device,
            exchange,
        }
    }

    /// A layer whose keys begin with `name.`.
    pub fn nested(&mut self, name: &str, layer: &mut impl Keyed) {
        let outer = self.prefix.len();
        self.prefix.push_str(name);
        self.prefix.push('.');
        layer.keys(self);
        self.prefix.truncate(outer);
    }

    /// A layer whose keys stand among its owner's.
    pub fn flat(&mut self, layer: &mut impl Keyed) {
        layer.keys(self);
    }

    /// Layers whose keys begin with `name.0.`, `name.1.`, …
    pub fn each(&mut self, name: &str, layers: &mut [impl Keyed]) {
        for (index, layer) in layers.iter_mut().enumerate() {
            self.nested(&format!("{name}.{index}"), layer);
        }
    }

    /// `name.weight`, `[output, input]`, and `name.bias`.
    pub fn linear(&mut self, name: &str, linear: &mut Linear) {
        self.linear_named(&format!("{name}.weight"), &format!("{name}.bias"), linear);
    }

    /// A linear layer whose keys do not end in `.weight` and `.bias`.
    pub fn linear_named(&mut self, weight: &str, bias: &str, linear: &mut Linear) {
        let [input, output] = linear.weight.lazy_shape().dims();
        let current = || linear.weight.val().transpose().into_data();
        if let Some(data) = self.exchange(weight, &[output, input], &current) {
            let stored = Tensor::<2>::from_data(data, &self.device);
            linear.weight = replaced(&linear.weight, stored.transpose());
        }
        if let Some(parameter) = &mut linear.bias {
            self.vector(bias, parameter);
        }
    }

    /// Several linear layers of the file that are one here, their outputs side by side.
    pub(crate) fn side_by_side(&mut self, names: &[String], linear: &mut Linear) {
        let [input, total] = linear.weight.lazy_shape().dims();
        let output = total / names.len().max(1);
        let bias = linear.bias.as_ref().expect("layers with a bias");
        let (mut weights, mut biases) = (Vec::new(), Vec::new());
        for (index, name) in names.iter().enumerate() {
            let start = index * output;
            let part = || linear.weight.val().narrow(1, start, output);
            let key = format!("{name}.weight");
            weights
                .extend(self.exchange(&key, &[output, input], &|| part().transpose().into_data()));
            let part = || bias.val().narrow(0, start, output);
            let key = format!("{name}.bias");
            biases.extend(self.exchange(&key, &[output], &|| part().into_data()));
        }
        let complete = !names.is_empty() && weights.len() == names.len();
        if complete && biases.len() == names.len() {
            let stored = |data: TensorData| Tensor::<2>::from_data(data, &self.device);
            let weight = Tensor::cat(weights.into_iter().map(stored).collect(), 0).transpose();
            let stored = |data: TensorData| Tensor::<1>::from_data(data, &self.device);
            let joined = Tensor::cat(biases.into_iter().map(stored).collect(), 0);
            let bias = replaced(bias, joined);
            linear.weight = replaced(&linear.weight, weight);
            linear.bias = Some(bias);
        }
    }

    /// `name.weight` and `name.bias` of a layer normalization.
    pub fn norm(&mut self, name: &str, norm: &mut LayerNorm) {
        self.vector(&format!("{name}.weight"), &mut norm.gamma);
        if let Some(beta) = &mut norm.beta {
            self.vector(&format!("{name}.bias"), beta);
        }
    }

    /// `name.weight`, `[ids, width]`.
    pub fn embedding(&mut self, name: &str, embedding: &mut Embedding) {
        self.matrix(&format!("{name}.weight"), &mut embedding.weight);
    }

    /// `name.weight`, `[output, input, kernel]`, and `name.bias`.
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

    /// A parameter stored as it is.
    pub fn parameter<const D: usize>(&mut self, key: &str, parameter: &mut Param<Tensor<D>>) {
        let shape = parameter.lazy_shape();
        let current = || parameter.val().into_data();
        if let Some(data) = self.exchange(key, &shape.to_vec(), &current) {
            *parameter = replaced(parameter, Tensor::from_data(data, &self.device));
        }
    }

    fn exchange(
        &mut self,
        key: &str,
        shape: &[usize],
        current: &dyn Fn() -> TensorData,
    ) -> Option<TensorData> {
        let key = format!("{}{key}", self.prefix);
        self.exchange.tensor(&key, shape, current)
    }
}

/// The parameter with another value; it stays the same parameter to an optimiser, and one that can be
/// trained.
fn replaced<const D: usize>(parameter: &Param<Tensor<D>>, value: Tensor<D>) -> Param<Tensor<D>> {
    let mut replaced = Param::from_tensor(value);
    replaced.id = parameter.id;
    replaced
}
