//! The mask of a batch of motions of different lengths.

use burn::tensor::{Device, Tensor, TensorData};

/// Returns a mask `[batch, frames, 1]`: 1 where a frame is part of its motion, 0 where it is padding. Returns
/// `None` if no motion is padded, so that no work is spent on a mask.
///
/// # Panics
///
/// If a length is 0 or above `frames`, or `lengths` is empty.
pub fn frame_mask(lengths: &[usize], frames: usize, device: &Device) -> Option<Tensor<3>> {
    assert!(
        !lengths.is_empty() && lengths.iter().all(|&length| (1..=frames).contains(&length)),
        "expected lengths from 1 to {frames}, found {lengths:?}"
    );
    let padded = lengths.iter().any(|&length| length < frames);
    padded.then(|| {
        let values: Vec<f32> = lengths
            .iter()
            .flat_map(|&length| (0..frames).map(move |t| f32::from(u8::from(t < length))))
            .collect();
        let data = TensorData::new(values, [lengths.len(), frames, 1]);
        Tensor::from_data(data, device)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn padding_is_marked_and_only_where_there_is_some() {
        let device = Device::flex();
        let mask = frame_mask(&[3, 1], 3, &device).unwrap();
        let values: Vec<f32> = mask.try_into_vec_as().unwrap();
        assert_eq!(values, [1.0, 1.0, 1.0, 1.0, 0.0, 0.0]);
        assert!(frame_mask(&[3, 3], 3, &device).is_none());
    }
}
