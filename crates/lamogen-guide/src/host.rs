//! Numbers of tensors in main memory.

use burn::tensor::{Device, Tensor, TensorData};
use lamogen_motion::JOINTS;

/// Copies a tensor to main memory.
pub(crate) fn to_host<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor.try_into_vec_as().expect("floats convert to f32")
}

/// Returns the index of the first motion with a number that is infinite or NaN.
pub(crate) fn first_non_finite<const D: usize>(rows: &Tensor<D>) -> Option<usize> {
    let motions = rows.dims()[0];
    let rows = rows.clone().reshape([motions as i64, -1]);
    // A product with 0 is 0 for finite numbers and NaN for all others.
    let marks = to_host((rows * 0.0).sum_dim(1));
    marks.iter().position(|mark| !mark.is_finite())
}

/// Copies the joints of motions to a tensor `[batch, frames, 22, 3]`, padded with zeros to the longest motion.
pub(crate) fn joint_tensor(motions: &[&[[[f32; 3]; JOINTS]]], device: &Device) -> Tensor<4> {
    let frames = motions.iter().map(|motion| motion.len()).max().unwrap_or(0);
    let width = JOINTS * 3;
    let mut values = Vec::with_capacity(motions.len() * frames * width);
    for (index, motion) in motions.iter().enumerate() {
        values.extend_from_slice(motion.as_flattened().as_flattened());
        values.resize((index + 1) * frames * width, 0.0);
    }
    let data = TensorData::new(values, [motions.len(), frames, JOINTS, 3]);
    Tensor::from_data(data, device)
}
