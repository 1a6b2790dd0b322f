//! The precision of stored numbers, and the quantisation to 8 bits.

use std::str::FromStr;

use burn::tensor::TensorData;
use safetensors::tensor::Dtype;

/// The precision of a stored number.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Precision {
    /// Floats of 32 bits.
    #[default]
    F32,
    /// Floats of 16 bits, which need half the space.
    F16,
    /// Integers of 8 bits with a scale for each row of a matrix, which need a quarter of the space.
    ///
    /// A weight is the integer times the scale of its row. The scales are stored in a separate tensor, with the key
    /// `….scale`. The error of a weight is at most 1/254 of the largest weight of its row. Vectors are stored with 16 bits.
    I8,
}

impl FromStr for Precision {
    type Err = &'static str;

    /// Reads the number of bits: `32`, `16` or `8`.
    fn from_str(bits: &str) -> Result<Self, Self::Err> {
        match bits {
            "32" => Ok(Precision::F32),
            "16" => Ok(Precision::F16),
            "8" => Ok(Precision::I8),
            _ => Err("expected 8, 16 or 32"),
        }
    }
}

/// A part of a tensor that is stored under a key of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum TensorPart {
    /// The numbers of the tensor.
    Numbers,
    /// The scale of each row, by which the integers are multiplied.
    Scale,
}

impl TensorPart {
    /// Returns the key of this part of a tensor, given the key of the tensor.
    pub(super) fn key(self, key: &str) -> String {
        match self {
            TensorPart::Numbers => key.to_owned(),
            TensorPart::Scale => scale_key(key),
        }
    }
}

/// The suffix of the key of a tensor's scales.
const SCALE_SUFFIX: &str = ".scale";

/// The largest integer of 8 bits whose negative also has 8 bits.
const MAX_INT8: f32 = 127.0;

/// Returns the key of the scales that belong to a tensor of integers.
pub(super) fn scale_key(key: &str) -> String {
    format!("{key}{SCALE_SUFFIX}")
}

/// Returns the key of the tensor that scales belong to, or `None` if `key` is not the key of scales.
pub(super) fn scaled_key(key: &str) -> Option<&str> {
    key.strip_suffix(SCALE_SUFFIX)
}

impl Precision {
    /// Returns the parts that are stored of a tensor with the given number of dimensions.
    pub(super) fn parts(self, dimensions: usize) -> &'static [TensorPart] {
        match self.is_quantized(dimensions) {
            true => &[TensorPart::Numbers, TensorPart::Scale],
            false => &[TensorPart::Numbers],
        }
    }

    /// Returns the data type in which the numbers of a part are stored.
    pub(super) fn dtype(self, part: TensorPart, dimensions: usize) -> Dtype {
        match (self, part) {
            (Precision::F32, _) | (_, TensorPart::Scale) => Dtype::F32,
            (Precision::I8, _) if self.is_quantized(dimensions) => Dtype::I8,
            (Precision::F16 | Precision::I8, _) => Dtype::F16,
        }
    }

    /// Converts a part of a tensor to this precision. Returns `None` if a number is too large for 16 bits.
    pub(super) fn convert(self, data: TensorData, part: TensorPart) -> Option<TensorData> {
        let shape = data.shape().to_vec();
        match self.dtype(part, shape.len()) {
            Dtype::F32 if part == TensorPart::Numbers => Some(data.convert::<f32>()),
            Dtype::F16 => {
                let data = data.convert::<half::f16>();
                let fits = data.iter::<f32>().all(|number| number.is_finite());
                fits.then_some(data)
            }
            _ => {
                let (numbers, scales) = quantize(&data);
                Some(match part {
                    TensorPart::Numbers => TensorData::new(numbers, shape),
                    TensorPart::Scale => {
                        let rows = scales.len();
                        TensorData::new(scales, [rows])
                    }
                })
            }
        }
    }

    /// Returns whether a tensor with the given number of dimensions is stored as integers.
    ///
    /// Only tensors with at least two dimensions are. A vector is small, and each of its numbers would be a row of its own.
    fn is_quantized(self, dimensions: usize) -> bool {
        self == Precision::I8 && dimensions > 1
    }
}

/// Converts numbers to integers and the scale of each row.
fn quantize(data: &TensorData) -> (Vec<i8>, Vec<f32>) {
    let values: Vec<f32> = data.iter::<f32>().collect();
    let rows = data.shape().to_vec()[0];
    let width = values.len() / rows.max(1);
    let (mut numbers, mut scales) = (Vec::with_capacity(values.len()), Vec::with_capacity(rows));
    for row in values.chunks(width.max(1)) {
        let largest = row.iter().fold(0.0f32, |largest, x| largest.max(x.abs()));
        let scale = largest / MAX_INT8;
        scales.push(scale);
        // A row of zeros has the scale 0, so any integers would be right.
        let inverse = if scale > 0.0 { 1.0 / scale } else { 0.0 };
        numbers.extend(
            row.iter()
                .map(|x| (x * inverse).round().clamp(-MAX_INT8, MAX_INT8) as i8),
        );
    }
    (numbers, scales)
}

/// Multiplies integers `[rows, …]` by the scale of each row.
pub(super) fn dequantize(numbers: &TensorData, scales: &TensorData) -> TensorData {
    let scales: Vec<f32> = scales.iter::<f32>().collect();
    let integers = numbers
        .as_slice::<i8>()
        .expect("the numbers are integers of 8 bits");
    let width = (integers.len() / scales.len().max(1)).max(1);
    let mut values = Vec::with_capacity(integers.len());
    for (row, scale) in integers.chunks(width).zip(scales) {
        values.extend(row.iter().map(|x| f32::from(*x) * scale));
    }
    TensorData::new(values, numbers.shape().to_vec())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_numbers_are_near_and_a_row_of_nothing_stays_nothing() {
        let values = vec![1.0f32, -0.3, 0.004, 0.0, 0.0, 0.0, -50.0, 25.0, 0.1];
        let data = TensorData::new(values.clone(), [3, 3]);
        let part = |part| Precision::I8.convert(data.clone(), part).unwrap();
        let back = dequantize(&part(TensorPart::Numbers), &part(TensorPart::Scale));
        let back: Vec<f32> = back.iter::<f32>().collect();
        for (row, (before, after)) in values.chunks(3).zip(back.chunks(3)).enumerate() {
            let largest = [1.0, 0.0, 50.0][row];
            for (before, after) in before.iter().zip(after) {
                assert!(
                    (before - after).abs() <= largest / 254.0 + 1e-6,
                    "{before} {after}"
                );
            }
        }
        assert_eq!(back[0], 1.0);
        assert_eq!(back[3..6], [0.0; 3]);
    }
}
