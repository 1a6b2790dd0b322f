//! The scales and shifts of the last conditions.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use lamogen_cpu::Decoder;

use super::cpu::SharedFloats;

/// How many numbers are kept.
const CAPACITY: usize = 1 << 20;

/// The scales and shifts that the layer of the modulations computed for the last conditions, a timestep plus a sentence each.
///
/// The layer has half of the weights of a small network and reads all of them for each row. Both passes of a sampler and both
/// evaluations of a guided step have the same conditions, and the text without words is the same for all sentences.
///
/// Rows are kept for the weights that they were computed by. A copy begins empty.
#[derive(Debug, Default)]
pub(super) struct KeptModulations(Mutex<Kept>);

#[derive(Debug, Default)]
struct Kept {
    /// The weights and biases that the rows were computed by. As long as they are held here, no others lie at their place in memory.
    layer: Option<[SharedFloats; 2]>,
    rows: VecDeque<Row>,
}

#[derive(Debug)]
struct Row {
    condition: Box<[f32]>,
    modulations: Arc<[f32]>,
}

impl Clone for KeptModulations {
    fn clone(&self) -> Self {
        KeptModulations::default()
    }
}

impl KeptModulations {
    /// Returns the scales and shifts of conditions, `[batch, outputs of the modulations]`: kept ones, or else new ones, which are kept.
    pub(super) fn of(&self, decoder: &Decoder<SharedFloats>, condition: &[f32]) -> Vec<f32> {
        let weight = decoder.modulations.weight();
        let conditions = || condition.chunks_exact(weight.inputs());
        let mut rows: Vec<_> = {
            let kept = self.kept(decoder);
            conditions().map(|condition| kept.row(condition)).collect()
        };
        let missing: Vec<&[f32]> = { conditions().zip(&rows) }
            .filter_map(|(condition, row)| row.is_none().then_some(condition))
            .collect();
        if !missing.is_empty() {
            let computed = decoder.modulate(&missing.concat());
            let mut computed = computed.chunks_exact(weight.outputs());
            let mut kept = self.kept(decoder);
            for (condition, row) in conditions().zip(&mut rows) {
                row.get_or_insert_with(|| {
                    let new: Arc<[f32]> = computed.next().expect("one a condition").into();
                    kept.keep(condition, new.clone());
                    new
                });
            }
        }
        rows.into_iter().flatten().collect::<Vec<_>>().concat()
    }

    /// Returns what is kept of these weights.
    fn kept(&self, decoder: &Decoder<SharedFloats>) -> MutexGuard<'_, Kept> {
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let layer = &decoder.modulations;
        let layer = [layer.weight().storage(), layer.bias()];
        let is_kept = kept.layer.as_ref().is_some_and(|kept| {
            { kept.iter().zip(layer) }
                .all(|(kept, numbers)| std::ptr::eq(kept.as_ref(), numbers.as_ref()))
        });
        if !is_kept {
            *kept = Kept {
                layer: Some(layer.map(Clone::clone)),
                rows: VecDeque::new(),
            };
        }
        kept
    }
}

impl Kept {
    fn row(&self, condition: &[f32]) -> Option<Arc<[f32]>> {
        let mut rows = self.rows.iter();
        let row = rows.find(|row| *row.condition == *condition)?;
        Some(row.modulations.clone())
    }

    /// Keeps a row in the place of the oldest ones, unless it is kept already.
    fn keep(&mut self, condition: &[f32], modulations: Arc<[f32]>) {
        if self.row(condition).is_some() {
            return;
        }
        let capacity = (CAPACITY / (condition.len() + modulations.len())).max(1);
        self.rows.truncate(capacity - 1);
        self.rows.push_front(Row {
            condition: condition.into(),
            modulations,
        });
    }
}
