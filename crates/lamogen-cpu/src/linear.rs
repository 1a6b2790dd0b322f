//! Linear layers and matrix products.

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};

use crate::FloatStorage;
use crate::math;

/// The memory layout of a matrix `[inputs, outputs]`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WeightLayout {
    /// Input by input: the weights of the first input come first.
    ByInput,
    /// Output by output: the weights of the first output come first, as PyTorch stores linear layers.
    ByOutput,
}

/// A weight matrix `[inputs, outputs]`.
#[derive(Clone, Debug)]
pub struct Matrix<S> {
    numbers: S,
    inputs: usize,
    outputs: usize,
    layout: WeightLayout,
}

impl<S: FloatStorage> Matrix<S> {
    /// Creates a matrix from its numbers.
    ///
    /// # Panics
    ///
    /// If there are not `inputs · outputs` numbers.
    pub fn new(numbers: S, inputs: usize, outputs: usize, layout: WeightLayout) -> Self {
        assert_eq!(numbers.as_ref().len(), inputs * outputs);
        Matrix {
            numbers,
            inputs,
            outputs,
            layout,
        }
    }

    /// Returns the numbers in their order in memory.
    pub fn storage(&self) -> &S {
        &self.numbers
    }

    /// Returns the number of inputs.
    pub fn inputs(&self) -> usize {
        self.inputs
    }

    /// Returns the number of outputs.
    pub fn outputs(&self) -> usize {
        self.outputs
    }

    pub(crate) fn layout(&self) -> WeightLayout {
        self.layout
    }

    pub(crate) fn numbers(&self) -> &[f32] {
        self.numbers.as_ref()
    }

    pub(crate) fn view(&self) -> MatRef<'_, f32> {
        let numbers = self.numbers.as_ref();
        match self.layout {
            WeightLayout::ByInput => {
                MatRef::from_row_major_slice(numbers, self.inputs, self.outputs)
            }
            WeightLayout::ByOutput => {
                MatRef::from_column_major_slice(numbers, self.inputs, self.outputs)
            }
        }
    }

    /// Computes `out += x · W`, with `x` and `out` stored row by row.
    pub(crate) fn accumulate(&self, x: &[f32], out: &mut [f32]) {
        product(
            rows(x, self.inputs),
            self.view(),
            rows_mut(out, self.outputs),
            Accum::Add,
        );
    }

    /// Computes `out = g · Wᵀ`, the gradient of `x · W` with respect to `x`.
    pub(crate) fn backward(&self, gradient: &[f32], out: &mut [f32]) {
        self.backward_with(gradient, out, Accum::Replace);
    }

    /// Computes `out += g · Wᵀ`.
    pub(crate) fn backward_accumulate(&self, gradient: &[f32], out: &mut [f32]) {
        self.backward_with(gradient, out, Accum::Add);
    }

    fn backward_with(&self, gradient: &[f32], out: &mut [f32], accum: Accum) {
        let weights = self.view().transpose();
        product(
            rows(gradient, self.outputs),
            weights,
            rows_mut(out, self.inputs),
            accum,
        );
    }
}

/// A linear layer, `y = x · W + b`.
#[derive(Clone, Debug)]
pub struct Linear<S> {
    pub(crate) weight: Matrix<S>,
    pub(crate) bias: S,
}

impl<S: FloatStorage> Linear<S> {
    /// Returns the weights.
    pub fn weight(&self) -> &Matrix<S> {
        &self.weight
    }

    /// Returns the bias.
    pub fn bias(&self) -> &S {
        &self.bias
    }

    /// Creates a layer from weights `[inputs, outputs]` and a bias `[outputs]`.
    ///
    /// # Panics
    ///
    /// If the bias does not have one number for each output.
    pub fn new(weight: Matrix<S>, bias: S) -> Self {
        assert_eq!(bias.as_ref().len(), weight.outputs);
        Linear { weight, bias }
    }

    /// Computes `out = x · W + b`.
    pub(crate) fn forward(&self, x: &[f32], out: &mut [f32]) {
        let bias = self.bias.as_ref();
        for row in out.chunks_exact_mut(bias.len()) {
            row.copy_from_slice(bias);
        }
        self.weight.accumulate(x, out);
    }

    /// Computes `out += x · W + b`.
    pub(crate) fn accumulate(&self, x: &[f32], out: &mut [f32]) {
        let bias = self.bias.as_ref();
        for row in out.chunks_exact_mut(bias.len()) {
            math::add_row(row, bias);
        }
        self.weight.accumulate(x, out);
    }
}

impl Matrix<Vec<f32>> {
    pub(crate) fn numbers_mut(&mut self) -> &mut [f32] {
        &mut self.numbers
    }
}

impl Linear<Vec<f32>> {
    /// Creates a layer of zeros, input by input, with the sizes of another layer.
    pub(crate) fn zeros_like<S: FloatStorage>(layer: &Linear<S>) -> Self {
        let (inputs, outputs) = (layer.weight.inputs, layer.weight.outputs);
        Linear::from_input_major(vec![0.0; inputs * outputs], vec![0.0; outputs])
    }

    /// Adds the gradients of the weights and the bias of `x · W + b`, given the gradient of the result.
    pub(crate) fn add_gradients(&mut self, x: &[f32], gradient: &[f32]) {
        let Matrix {
            numbers,
            inputs,
            outputs,
            ..
        } = &mut self.weight;
        product(
            rows(x, *inputs).transpose(),
            rows(gradient, *outputs),
            rows_mut(numbers, *outputs),
            Accum::Add,
        );
        math::add_rows(&mut self.bias, gradient);
    }

    /// Creates a layer from weights that are stored input by input.
    pub(crate) fn from_input_major(numbers: Vec<f32>, bias: Vec<f32>) -> Self {
        let (inputs, outputs) = (numbers.len() / bias.len().max(1), bias.len());
        Linear::new(
            Matrix::new(numbers, inputs, outputs, WeightLayout::ByInput),
            bias,
        )
    }

    /// Adds the weights and the bias to a list.
    pub(crate) fn collect_weights<'a>(&'a mut self, list: &mut Vec<&'a mut Vec<f32>>) {
        list.extend([&mut self.weight.numbers, &mut self.bias]);
    }

    /// Returns the weights, in the order in which they are stored, and the bias. The layers of
    /// [`DecoderGradients`](crate::DecoderGradients) and [`TransformerWeightGradients`](crate::TransformerWeightGradients) are
    /// stored input by input.
    pub fn into_parts(self) -> (Vec<f32>, Vec<f32>) {
        (self.weight.numbers, self.bias)
    }
}

/// Views rows of `width` numbers as a matrix.
pub(crate) fn rows(numbers: &[f32], width: usize) -> MatRef<'_, f32> {
    MatRef::from_row_major_slice(numbers, numbers.len() / width, width)
}

/// Views rows of `width` numbers as a mutable matrix.
pub(crate) fn rows_mut(numbers: &mut [f32], width: usize) -> MatMut<'_, f32> {
    MatMut::from_row_major_slice_mut(numbers, numbers.len() / width, width)
}

/// Computes a matrix product on this thread. The result of a row does not depend on the number of rows of `a`, unless
/// `a` has only one row.
pub(crate) fn product(a: MatRef<'_, f32>, b: MatRef<'_, f32>, out: MatMut<'_, f32>, accum: Accum) {
    matmul(out, accum, a, b, 1.0, Par::Seq);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_do_not_depend_on_their_neighbours() {
        let numbers = |count: usize, seed: f32| -> Vec<f32> {
            (0..count).map(|i| (i as f32 * seed).sin()).collect()
        };
        for (inputs, outputs) in [(512, 64), (16, 16), (263, 128), (128, 263), (1024, 96)] {
            for layout in [WeightLayout::ByInput, WeightLayout::ByOutput] {
                let weight = Matrix::new(numbers(inputs * outputs, 0.7), inputs, outputs, layout);
                let x = numbers(196 * inputs, 1.3);
                let mut whole = vec![0.0; 196 * outputs];
                weight.accumulate(&x, &mut whole);
                for height in [2, 14, 28, 49, 98] {
                    let mut parts = vec![0.0; 196 * outputs];
                    let x = x.chunks(height * inputs);
                    for (x, out) in x.zip(parts.chunks_mut(height * outputs)) {
                        weight.accumulate(x, out);
                    }
                    assert_eq!(whole, parts, "{inputs} {outputs} {layout:?} {height}");
                }
            }
        }
    }
}
