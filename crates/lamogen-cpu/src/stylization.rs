//! Stylization: the timestep and the sentence scale and shift a hidden state.

use multiversion::multiversion;

use crate::FloatStorage;
use crate::chunk::Chunk;
use crate::linear::Linear;
use crate::math;
use crate::norm::{LayerNorm, NormalizedRows};

/// The weights of a stylization layer, `out = W · silu(norm(h) · (1 + scale) + shift)`.
#[derive(Clone, Debug)]
pub struct Stylization<S> {
    /// The normalization of the hidden state.
    pub norm: LayerNorm<S>,
    /// The linear layer after the activation.
    pub output: Linear<S>,
}

/// The scale and shift of a stylization layer combined with those of its normalization:
/// `norm(h) · (1 + scale) + shift = x̂ · factor + offset`.
#[derive(Debug)]
pub(crate) struct StyleParameters {
    factor: Vec<f32>,
    offset: Vec<f32>,
    /// `1 + scale`.
    gain: Vec<f32>,
}

/// The sums of the gradients of a stylization layer's parameters.
pub(crate) struct ParameterGradients<'a> {
    /// The gradients of scale and shift, granule by granule.
    pub(crate) modulation: &'a mut [f32],
    /// The gradients of the weights, if they are requested.
    pub(crate) weights: Option<&'a mut Stylization<Vec<f32>>>,
}

impl StyleParameters {
    /// Combines a normalization with a `modulation`, which holds the scale and then the shift.
    pub(crate) fn new<S: FloatStorage>(norm: &LayerNorm<S>, modulation: &[f32]) -> Self {
        let (scale, shift) = modulation.split_at(norm.width());
        let (gamma, beta) = (norm.gamma.as_ref(), norm.beta.as_ref());
        let gain: Vec<f32> = scale.iter().map(|s| 1.0 + s).collect();
        let factor = gamma.iter().zip(&gain).map(|(g, gain)| g * gain);
        let offset = beta.iter().zip(&gain).zip(shift);
        StyleParameters {
            factor: factor.collect(),
            offset: offset.map(|((b, gain), t)| b * gain + t).collect(),
            gain,
        }
    }
}

impl Stylization<Vec<f32>> {
    /// Creates a layer of zeros with the sizes of another layer.
    pub(crate) fn zeros_like<S: FloatStorage>(layer: &Stylization<S>) -> Self {
        Stylization {
            norm: LayerNorm::zeros_like(&layer.norm),
            output: Linear::zeros_like(&layer.output),
        }
    }

    /// Adds all weights to a list.
    pub(crate) fn collect_weights<'a>(&'a mut self, list: &mut Vec<&'a mut Vec<f32>>) {
        self.norm.collect_weights(list);
        self.output.collect_weights(list);
    }
}

impl<S: FloatStorage> Stylization<S> {
    /// Adds the output to `x`. `hidden` is overwritten.
    pub(crate) fn forward(
        &self,
        hidden: &mut [f32],
        style: &StyleParameters,
        normalized: &mut NormalizedRows,
        x: &mut [f32],
    ) {
        let width = self.norm.width();
        normalized.normalize(hidden, width, self.norm.epsilon);
        activate(&normalized.rows, &style.factor, &style.offset, hidden);
        self.output.accumulate(hidden, x);
    }

    /// Computes the gradients from the gradient of the output.
    ///
    /// The gradient of the hidden state is written to `hidden`. The gradients of scale and shift, summed over the frames of
    /// each granule of the chunk, are added to `modulation`, which must hold zeros.
    pub(crate) fn backward(
        &self,
        gradient: &[f32],
        style: &StyleParameters,
        normalized: &NormalizedRows,
        hidden: &mut [f32],
        chunk: &Chunk,
        ParameterGradients {
            modulation,
            mut weights,
        }: ParameterGradients<'_>,
    ) {
        let width = self.norm.width();
        if let Some(gradients) = &mut weights {
            activate(&normalized.rows, &style.factor, &style.offset, hidden);
            gradients.output.add_gradients(hidden, gradient);
        }
        self.output.weight.backward(gradient, hidden);
        let (gamma, beta) = (self.norm.gamma.as_ref(), self.norm.beta.as_ref());
        let modulations = modulation.chunks_exact_mut(2 * width);
        for (range, modulation) in chunk.granule_ranges(width).zip(modulations) {
            let (sums, slopes) = modulation.split_at_mut(width);
            activate_backward(
                &normalized.rows[range.clone()],
                &style.factor,
                &style.offset,
                &mut hidden[range],
                (sums, slopes),
            );
            if let Some(Stylization { norm, .. }) = &mut weights {
                math::add_products(&mut norm.beta, sums, &style.gain);
                math::add_products(&mut norm.gamma, slopes, &style.gain);
            }
            // Turn Σ g and Σ g x̂ into the gradients of scale and shift.
            let parameters = gamma.iter().zip(beta);
            let sums = sums.iter_mut().zip(slopes.iter_mut());
            for ((first, second), (gamma, beta)) in sums.zip(parameters) {
                let (sum, slope) = (*first, *second);
                *first = slope * gamma + sum * beta;
                *second = sum;
            }
        }
        normalized.backward(hidden, width);
    }
}

/// Computes `silu(x̂ · factor + offset)`.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2+fma"))]
fn activate(rows: &[f32], factor: &[f32], offset: &[f32], out: &mut [f32]) {
    let width = factor.len();
    for (out, row) in out.chunks_exact_mut(width).zip(rows.chunks_exact(width)) {
        let parameters = factor.iter().zip(offset);
        for ((out, x), (factor, offset)) in out.iter_mut().zip(row).zip(parameters) {
            let h = x * factor + offset;
            *out = math::silu(h);
        }
    }
}

/// Turns the gradient of [`activate`] into the gradient of `x̂`. Adds `g` to `sums` and `g · x̂` to `slopes`, where `g` is
/// the gradient of the argument of `silu`, summed over rows.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2+fma"))]
fn activate_backward(
    rows: &[f32],
    factor: &[f32],
    offset: &[f32],
    gradient: &mut [f32],
    (sums, slopes): (&mut [f32], &mut [f32]),
) {
    let width = factor.len();
    for (g, row) in gradient
        .chunks_exact_mut(width)
        .zip(rows.chunks_exact(width))
    {
        let parameters = factor.iter().zip(offset);
        let sums = sums.iter_mut().zip(slopes.iter_mut());
        let all = g.iter_mut().zip(row).zip(parameters).zip(sums);
        for (((g, x), (factor, offset)), (sum, slope)) in all {
            let h = x * factor + offset;
            let argument_gradient = *g * math::silu_derivative(h);
            *sum += argument_gradient;
            *slope += argument_gradient * x;
            *g = argument_gradient * factor;
        }
    }
}
