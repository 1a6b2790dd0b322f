//! A bidirectional recurrent network over sequences of different lengths.

use burn::module::{Initializer, Module, Param};
use burn::nn::Linear;
use burn::tensor::activation::sigmoid;
use burn::tensor::{Bool, Device, Int, Tensor, TensorData};
use lamogen_model::{NamedParameters, ParameterList};

/// Gated recurrent units (GRU) in both directions, in PyTorch's form (`torch.nn.GRU` over packed sequences), with learned
/// initial states.
///
/// burn's `BiGru` has the same cell but takes no lengths, so its backward direction would start in the padding. It also
/// multiplies the input with the weights of each gate at every step, while here one product serves all steps and gates.
#[derive(Module, Debug)]
pub(super) struct BiGru {
    forward: GruDirection,
    backward: GruDirection,
    /// The initial states of both directions, `[2, 1, hidden]`.
    start: Param<Tensor<3>>,
}

/// One direction of the network. Both layers give the reset gate, the update gate and the candidate side by side.
#[derive(Module, Debug)]
struct GruDirection {
    input: Linear,
    hidden: Linear,
}

impl BiGru {
    pub(super) fn new(input: usize, hidden: usize, device: &Device) -> Self {
        let standard = Initializer::Normal {
            mean: 0.0,
            std: 1.0,
        };
        BiGru {
            forward: GruDirection::new(input, hidden, device),
            backward: GruDirection::new(input, hidden, device),
            start: standard.init([2, 1, hidden], device),
        }
    }

    /// Returns the final states of both directions side by side, after each has read the whole sequence.
    ///
    /// # Shapes
    ///
    /// - `x`: `[batch, steps, input]`; steps after a sequence's length are ignored
    /// - output: `[batch, 2 * hidden]`
    ///
    /// # Panics
    ///
    /// If there are not as many lengths as sequences, or a length is 0 or above the number of steps.
    pub(super) fn final_states(&self, x: Tensor<3>, lengths: &[usize]) -> Tensor<2> {
        let [batch, steps, _] = x.dims();
        assert!(
            lengths.len() == batch && lengths.iter().all(|length| (1..=steps).contains(length)),
            "expected {batch} lengths from 1 to {steps}, found {lengths:?}"
        );
        let start = |direction| self.start.val().narrow(0, direction, 1).squeeze_dim(0);
        let forward = step_order(lengths, steps, |_, step| step);
        let backward = step_order(lengths, steps, |length, step| length - 1 - step);
        Tensor::cat(
            vec![
                self.forward
                    .final_states(x.clone(), start(0), lengths, forward),
                self.backward.final_states(x, start(1), lengths, backward),
            ],
            1,
        )
    }
}

/// Returns, step by step, the row of `[batch * steps, input]` that each sequence reads. A sequence that has ended reads
/// a row of its own whose result is not used.
fn step_order(
    lengths: &[usize],
    steps: usize,
    position: impl Fn(usize, usize) -> usize,
) -> Vec<i64> {
    let longest = lengths.iter().copied().max().unwrap_or_default();
    let rows = (0..longest).flat_map(|step| {
        let position = &position;
        lengths.iter().enumerate().map(move |(sequence, &length)| {
            let position = if step < length {
                position(length, step)
            } else {
                0
            };
            (sequence * steps + position) as i64
        })
    });
    rows.collect()
}

impl GruDirection {
    fn new(input: usize, hidden: usize, device: &Device) -> Self {
        // These are PyTorch's initial weights of a GRU.
        let bound = 1.0 / (hidden as f64).sqrt();
        let uniform = Initializer::Uniform {
            min: -bound,
            max: bound,
        };
        let layer = |input| Linear {
            weight: uniform.init([input, 3 * hidden], device),
            bias: Some(uniform.init([3 * hidden], device)),
        };
        GruDirection {
            input: layer(input),
            hidden: layer(hidden),
        }
    }

    fn final_states(
        &self,
        x: Tensor<3>,
        start: Tensor<2>,
        lengths: &[usize],
        order: Vec<i64>,
    ) -> Tensor<2> {
        let [batch, steps, input] = x.dims();
        let device = x.device();
        let order: Tensor<1, Int> = Tensor::from_data(order.as_slice(), &device);
        let rows = x.reshape([batch * steps, input]).select(0, order);
        let inputs = split_steps(self.input.forward(rows), batch);
        let [_, hidden] = start.dims();
        let mut state = start.repeat_dim(0, batch);
        for (step, input) in inputs.into_iter().enumerate() {
            let next = self.step(input, state.clone());
            let ended: Vec<bool> = lengths.iter().map(|&length| length <= step).collect();
            state = match ended.contains(&true) {
                false => next,
                true => {
                    let ended = TensorData::new(ended, [batch, 1]);
                    let ended: Tensor<2, Bool> = Tensor::from_data(ended, &device);
                    next.mask_where(ended.repeat_dim(1, hidden), state)
                }
            };
        }
        state
    }

    /// Computes the next state: `n + z (h - n)` with the candidate `n = tanh(W x + r (U h))`. Both products have biases,
    /// as in PyTorch.
    fn step(&self, input: Tensor<2>, state: Tensor<2>) -> Tensor<2> {
        let [_, hidden] = state.dims();
        let recurrent = self.hidden.forward(state.clone());
        let candidate = |x: Tensor<2>| x.narrow(1, 2 * hidden, hidden);
        let gates = sigmoid(
            input.clone().narrow(1, 0, 2 * hidden) + recurrent.clone().narrow(1, 0, 2 * hidden),
        );
        let reset = gates.clone().narrow(1, 0, hidden);
        let update = gates.narrow(1, hidden, hidden);
        let new = (candidate(input) + reset * candidate(recurrent)).tanh();
        new.clone() + update * (state - new)
    }
}

/// Splits `[steps * batch, width]` into one tensor per step.
///
/// It splits by halves, because the gradient of a part is a tensor as large as the tensor that it was cut from. Cutting
/// the steps one by one would fill numbers in proportion to the square of the number of steps.
fn split_steps(x: Tensor<2>, batch: usize) -> Vec<Tensor<2>> {
    let [rows, _] = x.dims();
    let steps = rows / batch;
    if steps == 1 {
        return vec![x];
    }
    let half = steps / 2 * batch;
    let mut parts = split_steps(x.clone().narrow(0, 0, half), batch);
    parts.extend(split_steps(x.narrow(0, half, rows - half), batch));
    parts
}

impl NamedParameters for BiGru {
    fn keys(&mut self, keys: &mut ParameterList) {
        keys.parameter("hidden", &mut self.start);
        for (direction, suffix) in [(&mut self.forward, ""), (&mut self.backward, "_reverse")] {
            let mut layer = |name: &str, layer: &mut Linear| {
                let [weight, bias] =
                    ["weight", "bias"].map(|kind| format!("gru.{kind}_{name}_l0{suffix}"));
                keys.linear_named(&weight, &bias, layer);
            };
            layer("ih", &mut direction.input);
            layer("hh", &mut direction.hidden);
        }
    }
}
