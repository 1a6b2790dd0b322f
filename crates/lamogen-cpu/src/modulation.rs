//! The layer that turns conditions into scales and shifts: few rows through very many weights, so that
//! its cost is reading the weights once.

use multiversion::multiversion;
use rayon::prelude::*;

use crate::FloatStorage;
use crate::linear::{Linear, Matrix, WeightLayout};
use crate::math;

/// Rows of weights that are read by one thread.
const STRETCH: usize = 512;

/// Conditions that share one reading of the weights.
const AT_ONCE: usize = 8;

impl<S: FloatStorage> Linear<S> {
    /// `silu(condition) · W + b` for every row of `condition`.
    pub(crate) fn modulate(&self, condition: &[f32]) -> Vec<f32> {
        let active: Vec<f32> = condition.iter().copied().map(math::silu).collect();
        let outputs = self.weight.outputs();
        let mut out = vec![0.0; active.len() / self.weight.inputs() * outputs];
        let rows = active.chunks(AT_ONCE * self.weight.inputs());
        for (x, out) in rows.zip(out.chunks_mut(AT_ONCE * outputs)) {
            match self.weight.layout() {
                WeightLayout::ByOutput => dots(&self.weight, self.weight.inputs(), x, out),
                WeightLayout::ByInput => blends(&self.weight, outputs, x, out),
            }
        }
        for row in out.chunks_exact_mut(outputs) {
            math::add(row, self.bias.as_ref());
        }
        out
    }

    /// The gradient with respect to the conditions from that of the scales and shifts.
    pub(crate) fn modulate_backward(&self, condition: &[f32], gradient: &[f32]) -> Vec<f32> {
        let (inputs, outputs) = (self.weight.inputs(), self.weight.outputs());
        let mut out = vec![0.0; condition.len()];
        let rows = gradient.chunks(AT_ONCE * outputs);
        for (g, out) in rows.zip(out.chunks_mut(AT_ONCE * inputs)) {
            match self.weight.layout() {
                WeightLayout::ByOutput => blends(&self.weight, inputs, g, out),
                WeightLayout::ByInput => dots(&self.weight, outputs, g, out),
            }
        }
        for (g, x) in out.iter_mut().zip(condition) {
            *g *= math::silu_slope(*x);
        }
        out
    }
}

/// For each vector, its product with every row of `width` weights.
fn dots<S: FloatStorage>(weights: &Matrix<S>, width: usize, vectors: &[f32], out: &mut [f32]) {
    let weights = weights.numbers();
    let rows = weights.len() / width;
    let stretches: Vec<Vec<f32>> = weights
        .par_chunks(STRETCH * width)
        .map(|weights| dots_of_stretch(weights, vectors, width))
        .collect();
    let count = vectors.len() / width;
    for (place, value) in stretches.iter().flatten().enumerate() {
        out[place % count * rows + place / count] = *value;
    }
}

/// For each vector, the sum of the rows of `width` weights, each times one of its numbers.
fn blends<S: FloatStorage>(weights: &Matrix<S>, width: usize, vectors: &[f32], out: &mut [f32]) {
    let all = weights.numbers();
    let rows = all.len() / width;
    let stretches: Vec<Vec<f32>> = all
        .par_chunks(STRETCH * width)
        .enumerate()
        .map(|(stretch, weights)| {
            let mut out = vec![0.0; out.len()];
            for (four, weights) in weights.chunks(4 * width).enumerate() {
                let first = stretch * STRETCH + 4 * four;
                let vectors = vectors.chunks_exact(rows);
                for (out, vector) in out.chunks_exact_mut(width).zip(vectors) {
                    blend(weights, &vector[first..first + weights.len() / width], out);
                }
            }
            out
        })
        .collect();
    for stretch in stretches {
        math::add(out, &stretch);
    }
}

/// The product of each row of weights with each vector, row after row.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2+fma"))]
fn dots_of_stretch(weights: &[f32], vectors: &[f32], width: usize) -> Vec<f32> {
    let count = vectors.len() / width;
    let mut out = vec![0.0; weights.len() / width * count];
    let fours = weights.chunks(4 * width).zip(out.chunks_mut(4 * count));
    for (weights, out) in fours {
        let vectors = vectors.chunks_exact(width).enumerate();
        if weights.len() < 4 * width {
            for (place, vector) in vectors {
                for (row, weights) in weights.chunks_exact(width).enumerate() {
                    out[row * count + place] = math::dot(vector, weights);
                }
            }
            break;
        }
        let rows: [&[f32]; 4] = std::array::from_fn(|row| &weights[row * width..][..width]);
        for (place, vector) in vectors {
            for (row, product) in math::dots(vector, &rows).into_iter().enumerate() {
                out[row * count + place] = product;
            }
        }
    }
    out
}

/// Adds up to four rows to one, each times its own factor.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2+fma"))]
fn blend(rows: &[f32], factors: &[f32], out: &mut [f32]) {
    let width = out.len();
    if let &[a, b, c, d] = factors {
        let (first, rest) = rows.split_at(width);
        let (second, rest) = rest.split_at(width);
        let (third, fourth) = rest.split_at(width);
        let rows = first.iter().zip(second).zip(third.iter().zip(fourth));
        for (out, ((w, x), (y, z))) in out.iter_mut().zip(rows) {
            *out += (a * w + b * x) + (c * y + d * z);
        }
        return;
    }
    for (row, factor) in rows.chunks_exact(width).zip(factors) {
        for (out, x) in out.iter_mut().zip(row) {
            *out += factor * x;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbers(count: usize, seed: f32) -> Vec<f32> {
        (0..count).map(|i| (i as f32 * seed).sin()).collect()
    }

    /// Both layouts of the same weights, more than a stretch in both directions.
    fn layers() -> [Linear<Vec<f32>>; 2] {
        let (inputs, outputs) = (521, 1031);
        let by_input = numbers(inputs * outputs, 0.37);
        let by_output = (0..inputs * outputs)
            .map(|i| by_input[i % inputs * outputs + i / inputs])
            .collect();
        let bias = numbers(outputs, 0.11);
        [
            (by_input, WeightLayout::ByInput),
            (by_output, WeightLayout::ByOutput),
        ]
        .map(|(weights, layout)| {
            Linear::new(Matrix::new(weights, inputs, outputs, layout), bias.clone())
        })
    }

    #[test]
    fn both_layouts_are_products_with_the_weights() {
        let [a, b] = layers();
        let condition = numbers(11 * 521, 0.9);
        let mut expected = vec![0.0; 11 * 1031];
        let active: Vec<f32> = condition.iter().copied().map(math::silu).collect();
        a.forward(&active, &mut expected);
        for layer in [&a, &b] {
            for (out, expected) in layer.modulate(&condition).iter().zip(&expected) {
                assert!((out - expected).abs() < 1e-3, "{out} is not {expected}");
            }
        }
    }

    #[test]
    fn gradients_agree_with_differences() {
        let condition = numbers(9 * 521, 0.9);
        let weights = numbers(9 * 1031, 1.9);
        for layer in layers() {
            let loss = |condition: &[f32]| -> f64 {
                let out = layer.modulate(condition);
                out.iter()
                    .zip(&weights)
                    .map(|(a, b)| f64::from(a * b))
                    .sum()
            };
            let gradient = layer.modulate_backward(&condition, &weights);
            for place in [0, 520, 521, 4000, 9 * 521 - 1] {
                let moved = |by: f32| {
                    let mut condition = condition.clone();
                    condition[place] += by;
                    loss(&condition)
                };
                let slope = (moved(0.05) - moved(-0.05)) / 0.1;
                let found = f64::from(gradient[place]);
                assert!(
                    (slope - found).abs() < 2e-2 * found.abs().max(1.0),
                    "{place}: {slope} {found}"
                );
            }
        }
    }
}
