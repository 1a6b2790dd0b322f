//! How many bits a stored number has.

use std::str::FromStr;

use burn::tensor::TensorData;
use safetensors::tensor::Dtype;

/// Bits of a stored number.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Precision {
    /// 32 bits.
    #[default]
    F32,
    /// 16 bits: half the size.
    F16,
    /// Whole numbers of 8 bits with a scale for each row of a matrix, a quarter of the size: a weight is the number times its row's scale, which lies in
    /// the tensor `….scale` beside it. A weight is off by at most a 254th of the largest of its row. Vectors have 16 bits.
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

/// What is stored of a tensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Part {
    /// Its numbers.
    Numbers,
    /// What the whole numbers of each row are times.
    Scale,
}

impl Part {
    /// The key of this part of a tensor.
    pub(super) fn key(self, key: &str) -> String {
        match self {
            Part::Numbers => key.to_owned(),
            Part::Scale => scale_key(key),
        }
    }
}

/// What a tensor's key ends in where the scales of its rows lie.
const SCALE: &str = ".scale";

/// The largest whole number of 8 bits whose negative is one as well.
const LARGEST: f32 = 127.0;

/// The key of the scales that belong to a tensor of whole numbers.
pub(super) fn scale_key(key: &str) -> String {
    format!("{key}{SCALE}")
}

/// The tensor to which a key's scales belong, if it is the key of some.
pub(super) fn scaled_key(key: &str) -> Option<&str> {
    key.strip_suffix(SCALE)
}

impl Precision {
    /// What is stored of a tensor of so many dimensions.
    pub(super) fn parts(self, dimensions: usize) -> &'static [Part] {
        match self.is_quantized(dimensions) {
            true => &[Part::Numbers, Part::Scale],
            false => &[Part::Numbers],
        }
    }

    /// How the numbers of a part are stored.
    pub(super) fn dtype(self, part: Part, dimensions: usize) -> Dtype {
        match (self, part) {
            (Precision::F32, _) | (_, Part::Scale) => Dtype::F32,
            (Precision::I8, _) if self.is_quantized(dimensions) => Dtype::I8,
            (Precision::F16 | Precision::I8, _) => Dtype::F16,
        }
    }

    /// A part of a tensor with this many bits; `None` if a number is too large for 16.
    pub(super) fn convert(self, data: TensorData, part: Part) -> Option<TensorData> {
        let shape = data.shape().to_vec();
        match self.dtype(part, shape.len()) {
            Dtype::F32 if part == Part::Numbers => Some(data.convert::<f32>()),
            Dtype::F16 => {
                let data = data.convert::<half::f16>();
                let fits = data.iter::<f32>().all(|number| number.is_finite());
                fits.then_some(data)
            }
            _ => {
                let (numbers, scales) = quantize(&data);
                Some(match part {
                    Part::Numbers => TensorData::new(numbers, shape),
                    Part::Scale => {
                        let rows = scales.len();
                        TensorData::new(scales, [rows])
                    }
                })
            }
        }
    }

    /// Matrices, and what has more dimensions, are whole numbers; a vector is small, and each of its numbers would be a row.
    fn is_quantized(self, dimensions: usize) -> bool {
        self == Precision::I8 && dimensions > 1
    }
}

/// Whole numbers, and the scale of each row.
fn quantize(data: &TensorData) -> (Vec<i8>, Vec<f32>) {
    let values: Vec<f32> = data.iter::<f32>().collect();
    let rows = data.shape().to_vec()[0];
    let width = values.len() / rows.max(1);
    let (mut numbers, mut scales) = (Vec::with_capacity(values.len()), Vec::with_capacity(rows));
    for row in values.chunks(width.max(1)) {
        let largest = row.iter().fold(0.0f32, |largest, x| largest.max(x.abs()));
        let scale = largest / LARGEST;
        scales.push(scale);
        // A row of nothing has the scale 0, and any whole number would do.
        let inverse = if scale > 0.0 { 1.0 / scale } else { 0.0 };
        numbers.extend(
            row.iter()
                .map(|x| (x * inverse).round().clamp(-LARGEST, LARGEST) as i8),
        );
    }
    (numbers, scales)
}

/// The numbers of whole numbers `[rows, …]` with a scale for each row.
pub(super) fn dequantize(numbers: &TensorData, scales: &TensorData) -> TensorData {
    let scales: Vec<f32> = scales.iter::<f32>().collect();
    let values: Vec<f32> = numbers.iter::<f32>().collect();
    let width = (values.len() / scales.len().max(1)).max(1);
    let rows = values.chunks(width).zip(scales);
    let values: Vec<f32> = rows
        .flat_map(|(row, scale)| row.iter().map(move |x| x * scale))
        .collect();
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
        let back = dequantize(&part(Part::Numbers), &part(Part::Scale));
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
