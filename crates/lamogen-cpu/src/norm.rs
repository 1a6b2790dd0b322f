//! Layer normalization.

use multiversion::multiversion;

use crate::FloatStorage;
use crate::math;

/// The weights of a layer normalization over the channels of a frame.
#[derive(Clone, Debug)]
pub struct LayerNorm<S> {
    /// The scale of each channel.
    pub gamma: S,
    /// The shift of each channel.
    pub beta: S,
    /// The constant that is added to the variance.
    pub epsilon: f32,
}

/// The normalized rows and the factor by which each row was scaled, which the gradient of a normalization needs.
#[derive(Debug, Default)]
pub(crate) struct NormalizedRows {
    pub(crate) rows: Vec<f32>,
    scale: Vec<f32>,
}

impl<S: FloatStorage> LayerNorm<S> {
    pub(crate) fn width(&self) -> usize {
        self.gamma.as_ref().len()
    }

    /// Normalizes the rows of `x` and writes the scaled and shifted rows to `out`.
    pub(crate) fn forward(&self, x: &[f32], normalized: &mut NormalizedRows, out: &mut [f32]) {
        normalized.normalize(x, self.width(), self.epsilon);
        scale_and_shift(
            &normalized.rows,
            self.gamma.as_ref(),
            self.beta.as_ref(),
            out,
        );
    }

    /// Adds the gradient with respect to `x` to `out`. `gradient` is the gradient of the output and is overwritten.
    pub(crate) fn backward(
        &self,
        gradient: &mut [f32],
        normalized: &NormalizedRows,
        out: &mut [f32],
    ) {
        math::scale(gradient, self.gamma.as_ref());
        normalized.backward(gradient, self.width());
        math::add(out, gradient);
    }
}

impl LayerNorm<Vec<f32>> {
    /// Creates a normalization of zeros with the sizes of another one.
    pub(crate) fn zeros_like<S: FloatStorage>(norm: &LayerNorm<S>) -> Self {
        LayerNorm {
            gamma: vec![0.0; norm.width()],
            beta: vec![0.0; norm.width()],
            epsilon: norm.epsilon,
        }
    }

    /// Adds the scales and shifts to a list.
    pub(crate) fn collect_weights<'a>(&'a mut self, list: &mut Vec<&'a mut Vec<f32>>) {
        list.extend([&mut self.gamma, &mut self.beta]);
    }

    /// Adds the gradients of scale and shift, given the gradient of the output.
    pub(crate) fn add_gradients(&mut self, gradient: &[f32], normalized: &NormalizedRows) {
        math::add_rows(&mut self.beta, gradient);
        math::add_products(&mut self.gamma, gradient, &normalized.rows);
    }
}

impl NormalizedRows {
    /// Writes the scaled and shifted rows to `out`, as [`LayerNorm::forward`] does.
    pub(crate) fn scale_and_shift<S: FloatStorage>(&self, norm: &LayerNorm<S>, out: &mut [f32]) {
        scale_and_shift(&self.rows, norm.gamma.as_ref(), norm.beta.as_ref(), out);
    }

    /// Stores the rows of `x`, each minus its mean and divided by its standard deviation.
    pub(crate) fn normalize(&mut self, x: &[f32], width: usize, epsilon: f32) {
        self.rows.resize(x.len(), 0.0);
        self.scale.resize(x.len() / width, 0.0);
        normalize(x, width, epsilon, &mut self.rows, &mut self.scale);
    }

    /// Turns the gradient of the normalized rows into the gradient of the rows.
    pub(crate) fn backward(&self, gradient: &mut [f32], width: usize) {
        normalize_backward(gradient, width, &self.rows, &self.scale);
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2+fma"))]
fn normalize(x: &[f32], width: usize, epsilon: f32, out: &mut [f32], scales: &mut [f32]) {
    let count = width as f32;
    let rows = x.chunks_exact(width).zip(out.chunks_exact_mut(width));
    for ((x, out), scale) in rows.zip(scales) {
        let mean = math::total(x) / count;
        let variance = math::sum(x, x, |x, _| (x - mean) * (x - mean)) / count;
        *scale = 1.0 / (variance + epsilon).sqrt();
        for (out, x) in out.iter_mut().zip(x) {
            *out = (x - mean) * *scale;
        }
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2+fma"))]
fn normalize_backward(gradient: &mut [f32], width: usize, rows: &[f32], scales: &[f32]) {
    let count = width as f32;
    let rows = gradient
        .chunks_exact_mut(width)
        .zip(rows.chunks_exact(width));
    for ((gradient, row), scale) in rows.zip(scales) {
        let mean = math::total(gradient) / count;
        let slope = math::dot(gradient, row) / count;
        for (g, x) in gradient.iter_mut().zip(row) {
            *g = (*g - mean - x * slope) * scale;
        }
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2+fma"))]
pub(crate) fn scale_and_shift(rows: &[f32], gamma: &[f32], beta: &[f32], out: &mut [f32]) {
    let rows = rows.chunks_exact(gamma.len());
    for (out, row) in out.chunks_exact_mut(gamma.len()).zip(rows) {
        for (((out, x), gamma), beta) in out.iter_mut().zip(row).zip(gamma).zip(beta) {
            *out = x * gamma + beta;
        }
    }
}
