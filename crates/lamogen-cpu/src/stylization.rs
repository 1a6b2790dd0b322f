//! How timestep and sentence act on a hidden state: they scale and shift it.

use multiversion::multiversion;

use crate::FloatStorage;
use crate::chunk::Chunk;
use crate::linear::Linear;
use crate::math;
use crate::norm::{LayerNorm, Normalized};

/// `out = W · silu(norm(h) · (1 + scale) + shift)`.
#[derive(Clone, Debug)]
pub struct Stylization<S> {
    /// Normalization of the hidden state.
    pub norm: LayerNorm<S>,
    /// The layer after the activation.
    pub output: Linear<S>,
}

/// Scale and shift with the normalization's own folded in: `norm(h) · (1 + scale) + shift = x̂ · factor + offset`.
#[derive(Debug)]
pub(crate) struct Style {
    factor: Vec<f32>,
    offset: Vec<f32>,
    /// `1 + scale`.
    gain: Vec<f32>,
}

/// Where the gradients of a layer's parameters are summed up.
pub(crate) struct Gathered<'a> {
    /// Of scale and shift, granule after granule.
    pub(crate) modulation: &'a mut [f32],
    /// Of the weights, if they are asked for.
    pub(crate) weights: Option<&'a mut Stylization<Vec<f32>>>,
}

impl Style {
    /// `modulation`: scale, then shift.
    pub(crate) fn new<S: FloatStorage>(norm: &LayerNorm<S>, modulation: &[f32]) -> Self {
        let (scale, shift) = modulation.split_at(norm.width());
        let (gamma, beta) = (norm.gamma.as_ref(), norm.beta.as_ref());
        let gain: Vec<f32> = scale.iter().map(|s| 1.0 + s).collect();
        let factor = gamma.iter().zip(&gain).map(|(g, gain)| g * gain);
        let offset = beta.iter().zip(&gain).zip(shift);
        Style {
            factor: factor.collect(),
            offset: offset.map(|((b, gain), t)| b * gain + t).collect(),
            gain,
        }
    }
}

impl Stylization<Vec<f32>> {
    /// Zeros, one for each weight of another layer.
    pub(crate) fn zeros_like<S: FloatStorage>(layer: &Stylization<S>) -> Self {
        Stylization {
            norm: LayerNorm::zeros_like(&layer.norm),
            output: Linear::zeros_like(&layer.output),
        }
    }

    /// Adds all weights to a list.
    pub(crate) fn parts<'a>(&'a mut self, list: &mut Vec<&'a mut Vec<f32>>) {
        self.norm.parts(list);
        self.output.parts(list);
    }
}

impl<S: FloatStorage> Stylization<S> {
    /// Adds the output to `x`. `hidden` is used up.
    pub(crate) fn forward(
        &self,
        hidden: &mut [f32],
        style: &Style,
        normalized: &mut Normalized,
        x: &mut [f32],
    ) {
        let width = self.norm.width();
        normalized.of(hidden, width, self.norm.epsilon);
        activate(&normalized.rows, &style.factor, &style.offset, hidden);
        self.output.accumulate(hidden, x);
    }

    /// From the gradient of the output to that of the `hidden` state, and to those of scale and shift
    /// summed over the frames of each granule of the chunk, in zeros.
    pub(crate) fn backward(
        &self,
        gradient: &[f32],
        style: &Style,
        normalized: &Normalized,
        hidden: &mut [f32],
        chunk: &Chunk,
        Gathered {
            modulation,
            mut weights,
        }: Gathered<'_>,
    ) {
        let width = self.norm.width();
        if let Some(gathered) = &mut weights {
            activate(&normalized.rows, &style.factor, &style.offset, hidden);
            gathered.output.gather(hidden, gradient);
        }
        self.output.weight.pull(gradient, hidden);
        let (gamma, beta) = (self.norm.gamma.as_ref(), self.norm.beta.as_ref());
        let modulations = modulation.chunks_exact_mut(2 * width);
        for (range, modulation) in chunk.granules(width).zip(modulations) {
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
            // Σ g and Σ g x̂ become the gradients of scale and shift.
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

/// `silu(x̂ · factor + offset)`.
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

/// Turns the gradient of [`activate`] into that of `x̂`; adds up over rows the gradient `g` of `silu`'s
/// argument, and `g · x̂`.
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
            let styled = *g * math::silu_slope(h);
            *sum += styled;
            *slope += styled * x;
            *g = styled * factor;
        }
    }
}
