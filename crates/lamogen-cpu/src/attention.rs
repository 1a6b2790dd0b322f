//! Efficient attention (Shen et al. 2021) of the frames of a chunk.
//!
//! The channels of the heads are stored one head after another: each head owns `d` of the `width` channels. Keys and
//! values are summed up in a context `[width, d]`, which is one `d × d` matrix per head.

use multiversion::multiversion;

use faer::{Accum, MatMut, MatRef};

use crate::linear::{product, rows, rows_mut};
use crate::math;

/// The division of the channels among the attention heads.
#[derive(Clone, Copy, Debug)]
pub(crate) struct HeadLayout {
    /// The number of channels of all heads together.
    pub(crate) width: usize,
    /// The number of channels of one head.
    pub(crate) channels: usize,
}

/// The summed keys and values of some frames: one part of the context of a motion.
///
/// The softmax over frames is not yet normalized, because each part knows only its own largest keys.
#[derive(Debug)]
pub(crate) struct PartialContext {
    /// The largest key of each channel.
    largest: Vec<f32>,
    /// The sum over frames of `exp(key - largest)`, for each channel.
    sum: Vec<f32>,
    /// The sum over frames of `exp(key - largest) · value`, `[width, d]`.
    products: Vec<f32>,
}

/// The context of a motion's attention: the sum over frames of `softmax(key) · value`.
#[derive(Debug)]
pub(crate) struct AttentionContext {
    /// The context, `[width, d]`.
    pub(crate) values: Vec<f32>,
    /// For each part and channel, the factor that turns `exp(key - largest)` into the softmax over frames.
    pub(crate) softmax_factors: Vec<Vec<f32>>,
}

impl HeadLayout {
    /// Returns the first channel of each head.
    fn head_starts(self) -> impl Iterator<Item = usize> {
        (0..self.width).step_by(self.channels)
    }

    /// Applies the softmax over the channels of each head.
    pub(crate) fn softmax(self, query: &mut [f32]) {
        softmax(query, self.channels);
    }

    /// Turns the gradient of the softmax into the gradient of its input.
    pub(crate) fn softmax_backward(self, softmax: &[f32], gradient: &mut [f32]) {
        softmax_backward(softmax, gradient, self.channels);
    }

    /// Sums up the keys and values of some frames, and replaces the keys by `exp(key - largest)`.
    pub(crate) fn partial_context(self, key: &mut [f32], value: &[f32]) -> PartialContext {
        let mut largest = vec![f32::NEG_INFINITY; self.width];
        let mut sum = vec![0.0; self.width];
        exponentiate(key, &mut largest, &mut sum);
        let mut products = vec![0.0; self.width * self.channels];
        self.outer(key, value, &mut products);
        PartialContext {
            largest,
            sum,
            products,
        }
    }

    /// Computes `out = aᵀ · b` for each head, summed over frames: `[width, d]`.
    pub(crate) fn outer(self, a: &[f32], b: &[f32], out: &mut [f32]) {
        for head in self.head_starts() {
            let out = rows_mut(out, self.channels).subrows_mut(head, self.channels);
            product(
                self.head_columns(a, head).transpose(),
                self.head_columns(b, head),
                out,
                Accum::Replace,
            );
        }
    }

    /// Computes `out = a · context` for each frame and head.
    pub(crate) fn apply(self, a: &[f32], context: &[f32], out: &mut [f32]) {
        self.apply_each(a, |head| self.head_matrix(context, head), out);
    }

    /// Computes `out = a · contextᵀ` for each frame and head.
    pub(crate) fn apply_transposed(self, a: &[f32], context: &[f32], out: &mut [f32]) {
        self.apply_each(a, |head| self.head_matrix(context, head).transpose(), out);
    }

    fn apply_each<'c>(self, a: &[f32], matrix: impl Fn(usize) -> MatRef<'c, f32>, out: &mut [f32]) {
        for head in self.head_starts() {
            let out = self.head_columns_mut(out, head);
            product(
                self.head_columns(a, head),
                matrix(head),
                out,
                Accum::Replace,
            );
        }
    }

    fn head_columns(self, x: &[f32], head: usize) -> MatRef<'_, f32> {
        rows(x, self.width).subcols(head, self.channels)
    }

    fn head_columns_mut(self, x: &mut [f32], head: usize) -> MatMut<'_, f32> {
        rows_mut(x, self.width).subcols_mut(head, self.channels)
    }

    fn head_matrix(self, context: &[f32], head: usize) -> MatRef<'_, f32> {
        rows(context, self.channels).subrows(head, self.channels)
    }
}

impl AttentionContext {
    /// Merges the parts of a motion's context, which must be in the order of their frames.
    pub(crate) fn merge<'p>(partials: impl Iterator<Item = &'p PartialContext> + Clone) -> Self {
        let mut largest: Vec<f32> = Vec::new();
        for partial in partials.clone() {
            largest.resize(partial.largest.len(), f32::NEG_INFINITY);
            for (largest, x) in largest.iter_mut().zip(&partial.largest) {
                *largest = math::larger(*largest, *x);
            }
        }
        let mut sum = vec![0.0; largest.len()];
        let mut softmax_factors = Vec::new();
        for partial in partials.clone() {
            let mut factor = partial.largest.clone();
            for ((factor, largest), (sum, x)) in factor
                .iter_mut()
                .zip(&largest)
                .zip(sum.iter_mut().zip(&partial.sum))
            {
                *factor = math::exp(*factor - largest);
                *sum += *factor * x;
            }
            softmax_factors.push(factor);
        }
        let mut values: Vec<f32> = Vec::new();
        for (partial, factor) in partials.zip(&mut softmax_factors) {
            values.resize(partial.products.len(), 0.0);
            let channels = values.len() / sum.len();
            let rows = values.chunks_exact_mut(channels);
            let rows = rows.zip(partial.products.chunks_exact(channels));
            for ((row, products), (factor, sum)) in rows.zip(factor.iter_mut().zip(&sum)) {
                *factor /= sum;
                for (value, product) in row.iter_mut().zip(products) {
                    *value += *factor * product;
                }
            }
        }
        AttentionContext {
            values,
            softmax_factors,
        }
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2+fma"))]
fn softmax(rows: &mut [f32], width: usize) {
    for row in rows.chunks_exact_mut(width) {
        let largest = math::largest(row);
        for x in row.iter_mut() {
            *x = math::exp(*x - largest);
        }
        let factor = 1.0 / math::total(row);
        for x in row {
            *x *= factor;
        }
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2+fma"))]
fn softmax_backward(softmax: &[f32], gradient: &mut [f32], width: usize) {
    let rows = gradient.chunks_exact_mut(width);
    for (g, softmax) in rows.zip(softmax.chunks_exact(width)) {
        let mean = math::dot(g, softmax);
        for (g, softmax) in g.iter_mut().zip(softmax) {
            *g = (*g - mean) * softmax;
        }
    }
}

/// Replaces each key by `exp(key - largest)`, with the largest key of its channel, and sums the results over frames.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2+fma"))]
fn exponentiate(key: &mut [f32], largest: &mut [f32], sum: &mut [f32]) {
    let width = largest.len();
    for row in key.chunks_exact(width) {
        for (largest, x) in largest.iter_mut().zip(row) {
            *largest = math::larger(*largest, *x);
        }
    }
    for row in key.chunks_exact_mut(width) {
        for ((x, largest), sum) in row.iter_mut().zip(largest.iter()).zip(sum.iter_mut()) {
            *x = math::exp(*x - largest);
            *sum += *x;
        }
    }
}

/// Turns the gradient of the softmax over frames into the gradient of the keys: `(g - mean) · softmax`, where each
/// channel has its own mean.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2+fma"))]
pub(crate) fn keys_backward(softmax: &[f32], means: &[f32], gradient: &mut [f32]) {
    let width = means.len();
    for (g, softmax) in gradient
        .chunks_exact_mut(width)
        .zip(softmax.chunks_exact(width))
    {
        for ((g, softmax), mean) in g.iter_mut().zip(softmax).zip(means) {
            *g = (*g - mean) * softmax;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LAYOUT: HeadLayout = HeadLayout {
        width: 6,
        channels: 3,
    };

    fn numbers(count: usize, seed: f32) -> Vec<f32> {
        (0..count).map(|i| (i as f32 * seed).sin() * 3.0).collect()
    }

    #[test]
    fn a_context_is_the_same_in_one_part_or_in_several() {
        let (key, value) = (numbers(6 * 9, 1.7), numbers(6 * 9, 0.9));
        let whole =
            AttentionContext::merge([LAYOUT.partial_context(&mut key.clone(), &value)].iter());
        let partials = [0..4, 4..7, 7..9].map(|rows| {
            let range = rows.start * 6..rows.end * 6;
            LAYOUT.partial_context(&mut key[range.clone()].to_vec(), &value[range])
        });
        let partials = AttentionContext::merge(partials.iter());
        for (a, b) in whole.values.iter().zip(&partials.values) {
            assert!((a - b).abs() < 1e-6, "{a} is not {b}");
        }
        // Channel 4 is the second channel of the second head; its weights over frames sum to 1.
        let weights: Vec<f64> = (0..9).map(|t| f64::from(key[t * 6 + 4]).exp()).collect();
        let total: f64 = weights.iter().sum();
        let expected = |j: usize| -> f64 {
            let values = (0..9).map(|t| f64::from(value[t * 6 + 3 + j]));
            values.zip(&weights).map(|(v, w)| v * w / total).sum()
        };
        for j in 0..3 {
            assert!((f64::from(whole.values[4 * 3 + j]) - expected(j)).abs() < 1e-6);
        }
    }

    #[test]
    fn softmax_and_its_gradient_agree_with_differences() {
        let x = numbers(6, 1.3);
        let weights = numbers(6, 0.7);
        let loss = |x: &[f32]| -> f64 {
            let mut y = x.to_vec();
            LAYOUT.softmax(&mut y);
            y.iter().zip(&weights).map(|(y, w)| f64::from(y * w)).sum()
        };
        let mut softmax = x.clone();
        LAYOUT.softmax(&mut softmax);
        assert!((softmax[..3].iter().sum::<f32>() - 1.0).abs() < 1e-6);
        let mut gradient = weights.clone();
        LAYOUT.softmax_backward(&softmax, &mut gradient);
        for i in 0..6 {
            let moved = |by: f32| {
                let mut x = x.clone();
                x[i] += by;
                loss(&x)
            };
            let slope = (moved(1e-2) - moved(-1e-2)) / 2e-2;
            assert!(
                (slope - f64::from(gradient[i])).abs() < 1e-3,
                "{i}: {slope}"
            );
        }
    }
}
