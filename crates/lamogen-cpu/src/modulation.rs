//! The layer that turns conditions into scales and shifts.
//!
//! The layer has few rows of input and very many weights, so its cost is that of reading the weights once.

use multiversion::multiversion;
use rayon::prelude::*;

use crate::FloatStorage;
use crate::linear::{Linear, Matrix, WeightLayout};
use crate::math;

/// The number of rows of weights that one parallel task reads.
const ROWS_PER_TASK: usize = 512;

/// The number of conditions that are computed in one pass over the weights.
const CONDITIONS_PER_PASS: usize = 8;

impl<S: FloatStorage> Linear<S> {
    /// Computes `silu(condition) · W + b` for every row of `condition`.
    pub(crate) fn modulate(&self, condition: &[f32]) -> Vec<f32> {
        let active: Vec<f32> = condition.iter().copied().map(math::silu).collect();
        let outputs = self.weight.outputs();
        let mut out = vec![0.0; active.len() / self.weight.inputs() * outputs];
        let rows = active.chunks(CONDITIONS_PER_PASS * self.weight.inputs());
        for (x, out) in rows.zip(out.chunks_mut(CONDITIONS_PER_PASS * outputs)) {
            match self.weight.layout() {
                WeightLayout::ByOutput => row_products(&self.weight, self.weight.inputs(), x, out),
                WeightLayout::ByInput => weighted_row_sums(&self.weight, outputs, x, out),
            }
        }
        for row in out.chunks_exact_mut(outputs) {
            math::add(row, self.bias.as_ref());
        }
        out
    }

    /// Computes the gradient with respect to the conditions from the gradient of the scales and shifts.
    pub(crate) fn modulate_backward(&self, condition: &[f32], gradient: &[f32]) -> Vec<f32> {
        let (inputs, outputs) = (self.weight.inputs(), self.weight.outputs());
        let mut out = vec![0.0; condition.len()];
        let rows = gradient.chunks(CONDITIONS_PER_PASS * outputs);
        for (g, out) in rows.zip(out.chunks_mut(CONDITIONS_PER_PASS * inputs)) {
            match self.weight.layout() {
                WeightLayout::ByOutput => weighted_row_sums(&self.weight, inputs, g, out),
                WeightLayout::ByInput => row_products(&self.weight, outputs, g, out),
            }
        }
        for (g, x) in out.iter_mut().zip(condition) {
            *g *= math::silu_derivative(*x);
        }
        out
    }
}

/// Computes the dot product of each vector with every row of `width` weights.
fn row_products<S: FloatStorage>(
    weights: &Matrix<S>,
    width: usize,
    vectors: &[f32],
    out: &mut [f32],
) {
    let weights = weights.numbers();
    let rows = weights.len() / width;
    let results: Vec<Vec<f32>> = weights
        .par_chunks(ROWS_PER_TASK * width)
        .map(|weights| row_products_of_task(weights, vectors, width))
        .collect();
    let count = vectors.len() / width;
    for (place, value) in results.iter().flatten().enumerate() {
        out[place % count * rows + place / count] = *value;
    }
}

/// Computes, for each vector, the sum of the rows of `width` weights, each row multiplied by one number of the vector.
fn weighted_row_sums<S: FloatStorage>(
    weights: &Matrix<S>,
    width: usize,
    vectors: &[f32],
    out: &mut [f32],
) {
    let all = weights.numbers();
    let rows = all.len() / width;
    let results: Vec<Vec<f32>> = all
        .par_chunks(ROWS_PER_TASK * width)
        .enumerate()
        .map(|(task, weights)| {
            let mut out = vec![0.0; out.len()];
            for (four, weights) in weights.chunks(4 * width).enumerate() {
                let first = task * ROWS_PER_TASK + 4 * four;
                let vectors = vectors.chunks_exact(rows);
                for (out, vector) in out.chunks_exact_mut(width).zip(vectors) {
                    add_weighted_rows(weights, &vector[first..first + weights.len() / width], out);
                }
            }
            out
        })
        .collect();
    for result in results {
        math::add(out, &result);
    }
}

/// Computes the dot product of each row of weights with each vector, row by row.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2+fma"))]
fn row_products_of_task(weights: &[f32], vectors: &[f32], width: usize) -> Vec<f32> {
    let count = vectors.len() / width;
    let mut out = vec![0.0; weights.len() / width * count];
    let blocks = weights.chunks(4 * width).zip(out.chunks_mut(4 * count));
    for (weights, out) in blocks {
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

/// Adds up to four rows to `out`, each multiplied by its own factor.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2+fma"))]
fn add_weighted_rows(rows: &[f32], factors: &[f32], out: &mut [f32]) {
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

    /// Returns the same weights in both layouts, with more rows than one task reads in both directions.
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
