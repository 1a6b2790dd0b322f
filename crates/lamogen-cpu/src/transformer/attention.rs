//! Attention with softmax over keys, head by head.

use faer::prelude::ReborrowMut;
use faer::{Accum, MatRef};
use multiversion::multiversion;

use crate::linear::{product, rows, rows_mut};
use crate::math;

/// The heads of an attention: equal parts of the channels, in their order.
#[derive(Clone, Copy, Debug)]
pub(super) struct Heads {
    pub(super) count: usize,
    /// The width of all heads together.
    pub(super) width: usize,
}

/// The weights of the values in each head, `[queries, keys]` each; empty if they are not recorded.
#[derive(Debug, Default)]
pub(super) struct Probabilities(Vec<Vec<f32>>);

impl Heads {
    fn head_width(self) -> usize {
        self.width / self.count
    }

    fn scale(self) -> f32 {
        (self.head_width() as f32).powf(-0.5)
    }

    /// Computes what queries make of keys and values, `[keys, 2 · width]`. Writes it to `out`, `[queries, width]`. The penalty
    /// of each key is subtracted from its scores.
    pub(super) fn attend(
        self,
        query: MatRef<'_, f32>,
        keys_and_values: &[f32],
        penalty: Option<&[f32]>,
        out: &mut [f32],
        records: bool,
    ) -> Probabilities {
        let (head, all) = (self.head_width(), rows(keys_and_values, 2 * self.width));
        let keys = all.nrows();
        let mut recorded = Vec::new();
        let mut scores = vec![0.0; query.nrows() * keys];
        for start in (0..self.width).step_by(head) {
            let key = all.subcols(start, head);
            let query = query.subcols(start, head);
            let to = rows_mut(&mut scores, keys);
            product(query, key.transpose(), to, Accum::Replace);
            softmax(&mut scores, keys, self.scale(), penalty);
            let value = all.subcols(self.width + start, head);
            let to = rows_mut(out, self.width).subcols_mut(start, head);
            product(rows(&scores, keys), value, to, Accum::Replace);
            if records {
                recorded.push(scores.clone());
            }
        }
        Probabilities(recorded)
    }

    /// Weights the values as recorded. Writes the result to `out`, `[queries, width]`.
    pub(super) fn weigh_values(
        self,
        keys_and_values: &[f32],
        Probabilities(probabilities): &Probabilities,
        out: &mut [f32],
    ) {
        let (head, all) = (self.head_width(), rows(keys_and_values, 2 * self.width));
        let starts = (0..self.width).step_by(head);
        for (start, probabilities) in starts.zip(probabilities) {
            let value = all.subcols(self.width + start, head);
            let to = rows_mut(out, self.width).subcols_mut(start, head);
            let weights = rows(probabilities, all.nrows());
            product(weights, value, to, Accum::Replace);
        }
    }

    /// Computes the gradient with respect to the queries, `[queries, width]`, and adds that with respect to keys and values to
    /// `shared_gradient`, from the gradient of the result.
    pub(super) fn backward(
        self,
        query: MatRef<'_, f32>,
        keys_and_values: &[f32],
        Probabilities(probabilities): &Probabilities,
        gradient: &[f32],
        shared_gradient: &mut [f32],
    ) -> Vec<f32> {
        let (head, all) = (self.head_width(), rows(keys_and_values, 2 * self.width));
        let keys = all.nrows();
        let gradient = rows(gradient, self.width);
        let mut query_gradient = vec![0.0; query.nrows() * self.width];
        let mut scores = vec![0.0; query.nrows() * keys];
        let starts = (0..self.width).step_by(head);
        for (start, probabilities) in starts.zip(probabilities) {
            let gradient = gradient.subcols(start, head);
            let value = all.subcols(self.width + start, head);
            let to = rows_mut(&mut scores, keys);
            product(gradient, value.transpose(), to, Accum::Replace);
            softmax_backward(&mut scores, probabilities, keys, self.scale());
            let (scores, weights) = (rows(&scores, keys), rows(probabilities, keys));
            let to = rows_mut(&mut query_gradient, self.width).subcols_mut(start, head);
            product(scores, all.subcols(start, head), to, Accum::Replace);
            let mut shared = rows_mut(shared_gradient, 2 * self.width);
            let to = shared.rb_mut().subcols_mut(start, head);
            product(
                scores.transpose(),
                query.subcols(start, head),
                to,
                Accum::Add,
            );
            let to = shared.subcols_mut(self.width + start, head);
            product(weights.transpose(), gradient, to, Accum::Add);
        }
        query_gradient
    }
}

/// Turns each row of scores into the softmax of `scale · score - penalty`.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2+fma"))]
fn softmax(scores: &mut [f32], keys: usize, scale: f32, penalty: Option<&[f32]>) {
    for row in scores.chunks_exact_mut(keys) {
        for x in row.iter_mut() {
            *x *= scale;
        }
        if let Some(penalty) = penalty {
            for (x, penalty) in row.iter_mut().zip(penalty) {
                *x -= penalty;
            }
        }
        let largest = math::largest(row);
        for x in row.iter_mut() {
            *x = math::exp(*x - largest);
        }
        let factor = 1.0 / math::total(row);
        for x in row.iter_mut() {
            *x *= factor;
        }
    }
}

/// Turns the gradient of each row of probabilities into that of its scores.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2+fma"))]
fn softmax_backward(gradient: &mut [f32], probabilities: &[f32], keys: usize, scale: f32) {
    let probabilities = probabilities.chunks_exact(keys);
    for (row, probabilities) in gradient.chunks_exact_mut(keys).zip(probabilities) {
        let mean = math::dot(row, probabilities);
        for (x, probability) in row.iter_mut().zip(probabilities) {
            *x = (*x - mean) * probability * scale;
        }
    }
}
