//! Batches of texts or motions of about the same length, which networks embed together.

use burn::tensor::{Device, Tensor, TensorData};

use crate::{Embeddings, EvaluatorConfig, EvaluatorError, MetricError};

/// The number of texts that a network embeds at once.
pub(crate) const TEXTS_PER_BATCH: usize = 128;
/// The number of motions that a network embeds at once.
pub(crate) const MOTIONS_PER_BATCH: usize = 32;

/// Embeds `count` items in batches of `size` items of about the same length, and returns their embeddings of the given width in the order
/// of the items. `length` returns the length of the item with an index; `embed` embeds the items with the indices of a batch.
pub(crate) fn embed_in_batches(
    size: usize,
    width: usize,
    length: &dyn Fn(usize) -> usize,
    count: usize,
    embed: impl Fn(&[usize]) -> Tensor<2>,
) -> Result<Embeddings, MetricError> {
    let mut order: Vec<usize> = (0..count).collect();
    order.sort_by_key(|&index| length(index));
    let mut embeddings = Embeddings::new(Vec::new(), width)?;
    for indices in order.chunks(size) {
        embeddings.extend(&Embeddings::from_tensor(embed(indices))?)?;
    }
    let mut rows = vec![0; count];
    for (row, index) in order.into_iter().enumerate() {
        rows[index] = row;
    }
    Ok(embeddings.select(rows))
}

/// Motions of pose features, not normalised, with the number of frames that a network reads of each: a multiple of 4.
pub(crate) struct MotionInputs<'a, M> {
    motions: &'a [M],
    config: &'a EvaluatorConfig,
    frames: Vec<usize>,
}

impl<'a, M: AsRef<[f32]>> MotionInputs<'a, M> {
    /// Checks that a network of these sizes reads motions of these lengths.
    pub(crate) fn new(
        motions: &'a [M],
        config: &'a EvaluatorConfig,
    ) -> Result<Self, EvaluatorError> {
        let unit = EvaluatorConfig::FRAMES_PER_MOVEMENT;
        let features = config.dim_pose;
        let frames = |motion: &M| motion.as_ref().len() / features / unit * unit;
        let frames: Vec<usize> = motions.iter().map(frames).collect();
        for (index, (motion, &frames)) in motions.iter().zip(&frames).enumerate() {
            let found = motion.as_ref().len();
            let has_length = (unit..=config.max_motion_length).contains(&frames);
            if !has_length || !found.is_multiple_of(features) {
                return Err(EvaluatorError::Motion {
                    motion: index,
                    shortest: unit,
                    longest: config.max_motion_length,
                    features,
                    found,
                });
            }
        }
        Ok(MotionInputs {
            motions,
            config,
            frames,
        })
    }

    /// Returns the number of frames that are read of a motion.
    pub(crate) fn frames(&self, index: usize) -> usize {
        self.frames[index]
    }

    /// Returns the motions with these indices, `[motions, frames, features]`, padded with zeros to the longest, and their lengths.
    pub(crate) fn batch(&self, indices: &[usize], device: &Device) -> (Tensor<3>, Vec<usize>) {
        let features = self.config.dim_pose;
        let lengths: Vec<usize> = indices.iter().map(|&index| self.frames[index]).collect();
        let longest = *lengths.iter().max().expect("a batch has members");
        let mut numbers = vec![0.0; indices.len() * longest * features];
        let rows = numbers.chunks_exact_mut(longest * features);
        for ((row, &index), length) in rows.zip(indices).zip(&lengths) {
            let count = length * features;
            row[..count].copy_from_slice(&self.motions[index].as_ref()[..count]);
        }
        let shape = [indices.len(), longest, features];
        (
            Tensor::from_data(TensorData::new(numbers, shape), device),
            lengths,
        )
    }
}
