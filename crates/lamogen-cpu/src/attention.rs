//! Efficient attention (Shen et al. 2021) of the frames of a chunk.
//!
//! Channels stand head after head: of `width` channels, `d` belong to each head. What is attended to is
//! summed up in a context `[width, d]`, a `d × d` matrix a head.

use multiversion::multiversion;

use faer::{Accum, MatMut, MatRef};

use crate::linear::{product, rows, rows_mut};
use crate::math;

/// Sizes of the heads.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Heads {
    pub(crate) width: usize,
    /// Channels of a head.
    pub(crate) channels: usize,
}

/// Keys and values of some frames summed up: a part of a context whose softmax over frames is not yet
/// normalized, as each part knows only its own largest keys.
#[derive(Debug)]
pub(crate) struct Part {
    /// The largest key of each channel.
    largest: Vec<f32>,
    /// Sum over frames of `exp(key - largest)`.
    sum: Vec<f32>,
    /// Sum over frames of `exp(key - largest) · value`, `[width, d]`.
    products: Vec<f32>,
}

/// What the frames of a motion attend to.
#[derive(Debug)]
pub(crate) struct Context {
    /// `[width, d]`.
    pub(crate) values: Vec<f32>,
    /// For each part and channel, what turns `exp(key - largest)` into the softmax.
    pub(crate) shares: Vec<Vec<f32>>,
}

impl Heads {
    fn each(self) -> impl Iterator<Item = usize> {
        (0..self.width).step_by(self.channels)
    }

    /// Softmax over the channels of each head.
    pub(crate) fn softmax(self, query: &mut [f32]) {
        softmax(query, self.channels);
    }

    /// Turns the gradient of the softmax into that of its input.
    pub(crate) fn softmax_backward(self, softmax: &[f32], gradient: &mut [f32]) {
        softmax_backward(softmax, gradient, self.channels);
    }

    /// Sums up keys and values of some frames. The keys become `exp(key - largest)`.
    pub(crate) fn part(self, key: &mut [f32], value: &[f32]) -> Part {
        let mut largest = vec![f32::NEG_INFINITY; self.width];
        let mut sum = vec![0.0; self.width];
        exponentiate(key, &mut largest, &mut sum);
        let mut products = vec![0.0; self.width * self.channels];
        self.outer(key, value, &mut products);
        Part {
            largest,
            sum,
            products,
        }
    }

    /// `out = aᵀ · b` for each head, summed over frames: `[width, d]`.
    pub(crate) fn outer(self, a: &[f32], b: &[f32], out: &mut [f32]) {
        for head in self.each() {
            let out = rows_mut(out, self.channels).subrows_mut(head, self.channels);
            product(
                self.of(a, head).transpose(),
                self.of(b, head),
                out,
                Accum::Replace,
            );
        }
    }

    /// `out = a · context` for each frame and head.
    pub(crate) fn apply(self, a: &[f32], context: &[f32], out: &mut [f32]) {
        self.apply_each(a, |head| self.matrix(context, head), out);
    }

    /// `out = a · contextᵀ` for each frame and head.
    pub(crate) fn apply_transposed(self, a: &[f32], context: &[f32], out: &mut [f32]) {
        self.apply_each(a, |head| self.matrix(context, head).transpose(), out);
    }

    fn apply_each<'c>(self, a: &[f32], matrix: impl Fn(usize) -> MatRef<'c, f32>, out: &mut [f32]) {
        for head in self.each() {
            let out = self.of_mut(out, head);
            product(self.of(a, head), matrix(head), out, Accum::Replace);
        }
    }

    fn of(self, x: &[f32], head: usize) -> MatRef<'_, f32> {
        rows(x, self.width).subcols(head, self.channels)
    }

    fn of_mut(self, x: &mut [f32], head: usize) -> MatMut<'_, f32> {
        rows_mut(x, self.width).subcols_mut(head, self.channels)
    }

    fn matrix(self, context: &[f32], head: usize) -> MatRef<'_, f32> {
        rows(context, self.channels).subrows(head, self.channels)
    }
}

impl Context {
    /// The context of a motion from its parts, first frames first.
    pub(crate) fn of<'p>(parts: impl Iterator<Item = &'p Part> + Clone) -> Self {
        let mut largest: Vec<f32> = Vec::new();
        for part in parts.clone() {
            largest.resize(part.largest.len(), f32::NEG_INFINITY);
            for (largest, x) in largest.iter_mut().zip(&part.largest) {
                *largest = math::larger(*largest, *x);
            }
        }
        let mut sum = vec![0.0; largest.len()];
        let mut shares = Vec::new();
        for part in parts.clone() {
            let mut share = part.largest.clone();
            for ((share, largest), (sum, x)) in share
                .iter_mut()
                .zip(&largest)
                .zip(sum.iter_mut().zip(&part.sum))
            {
                *share = math::exp(*share - largest);
                *sum += *share * x;
            }
            shares.push(share);
        }
        let mut values: Vec<f32> = Vec::new();
        for (part, share) in parts.zip(&mut shares) {
            values.resize(part.products.len(), 0.0);
            let channels = values.len() / sum.len();
            let rows = values.chunks_exact_mut(channels);
            let rows = rows.zip(part.products.chunks_exact(channels));
            for ((row, products), (share, sum)) in rows.zip(share.iter_mut().zip(&sum)) {
                *share /= sum;
                for (value, product) in row.iter_mut().zip(products) {
                    *value += *share * product;
                }
            }
        }
        Context { values, shares }
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2+fma"))]
fn softmax(rows: &mut [f32], width: usize) {
    for row in rows.chunks_exact_mut(width) {
        let largest = math::largest(row);
        for x in row.iter_mut() {
            *x = math::exp(*x - largest);
        }
        let share = 1.0 / math::total(row);
        for x in row {
            *x *= share;
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

/// Turns keys into `exp(key - largest)` with the largest of each channel, and sums them up.
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

/// Turns the gradient of the softmax over frames into that of the keys: `(g - mean) · softmax`, each
/// channel with its own mean.
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

    const HEADS: Heads = Heads {
        width: 6,
        channels: 3,
    };

    fn numbers(count: usize, seed: f32) -> Vec<f32> {
        (0..count).map(|i| (i as f32 * seed).sin() * 3.0).collect()
    }

    #[test]
    fn a_context_is_the_same_in_one_part_or_in_several() {
        let (key, value) = (numbers(6 * 9, 1.7), numbers(6 * 9, 0.9));
        let whole = Context::of([HEADS.part(&mut key.clone(), &value)].iter());
        let parts = [0..4, 4..7, 7..9].map(|rows| {
            let range = rows.start * 6..rows.end * 6;
            HEADS.part(&mut key[range.clone()].to_vec(), &value[range])
        });
        let parts = Context::of(parts.iter());
        for (a, b) in whole.values.iter().zip(&parts.values) {
            assert!((a - b).abs() < 1e-6, "{a} is not {b}");
        }
        // Channel 4 is the second of the second head; its weights over frames sum to 1.
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
            HEADS.softmax(&mut y);
            y.iter().zip(&weights).map(|(y, w)| f64::from(y * w)).sum()
        };
        let mut softmax = x.clone();
        HEADS.softmax(&mut softmax);
        assert!((softmax[..3].iter().sum::<f32>() - 1.0).abs() < 1e-6);
        let mut gradient = weights.clone();
        HEADS.softmax_backward(&softmax, &mut gradient);
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
