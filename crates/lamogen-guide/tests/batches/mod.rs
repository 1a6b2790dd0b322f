//! Batches for tests.

use burn::tensor::{Device, Tensor};
use lamogen_guide::{Batch, noise};
use lamogen_model::Prompt;
use lamogen_motion::POSE_FEATURES;

/// Returns a batch of motions of these lengths, padded to `frames` frames, with embeddings of 1. The noise seed of each
/// motion is its index.
pub fn batch(lengths: &[usize], frames: usize) -> Batch<()> {
    let device = Device::flex();
    let start: Vec<f32> = (0..lengths.len() as u64)
        .flat_map(|seed| noise(seed, frames, POSE_FEATURES))
        .collect();
    let start = Tensor::<1>::from_floats(&start[..], &device);
    Batch {
        prompt: Prompt {
            embedding: Tensor::ones([lengths.len(), 1], &device),
            context: (),
        },
        noise: start.reshape([lengths.len(), frames, POSE_FEATURES]),
        lengths: lengths.to_vec(),
        step_noise: None,
        continuation: None,
        known: None,
    }
}
