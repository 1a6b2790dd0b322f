//! Numbers of tensors in main memory.

use burn::tensor::Tensor;

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
