//! Rows of pose features, 16 bits per number.

use half::f16;
use half::slice::HalfFloatSliceExt;
use lamogen_motion::POSE_FEATURES;

/// The rows of all clips, one clip after another.
#[derive(Clone, Debug, Default)]
pub(crate) struct Rows {
    values: Vec<f16>,
    /// The first row of each clip, and at the end the number of all rows.
    offsets: Vec<usize>,
}

impl Rows {
    /// Returns rows without any clip.
    pub fn new() -> Rows {
        Rows {
            values: Vec::new(),
            offsets: vec![0],
        }
    }

    /// Returns rows from all numbers and the offsets of the clips: the first row of each, and the number of all rows.
    ///
    /// # Panics
    ///
    /// If the offsets do not grow from 0 to the number of rows.
    pub fn from_parts(values: Vec<f16>, offsets: Vec<usize>) -> Rows {
        assert!(offsets.first() == Some(&0) && offsets.is_sorted());
        assert_eq!(
            offsets.last().map(|n| n * POSE_FEATURES),
            Some(values.len())
        );
        Rows { values, offsets }
    }

    /// Adds a clip of whole rows.
    pub fn push(&mut self, clip: &[f16]) {
        debug_assert!(clip.len().is_multiple_of(POSE_FEATURES));
        self.values.extend_from_slice(clip);
        self.offsets.push(self.len());
    }

    /// Reserves memory for more rows, so that a large data set is not copied as it grows.
    pub fn reserve(&mut self, rows: usize) {
        self.values.reserve(rows * POSE_FEATURES);
    }

    /// Adds all clips of other rows.
    pub fn append(&mut self, others: &Rows) {
        let first = self.len();
        self.values.extend_from_slice(&others.values);
        let ends = others.offsets.iter().skip(1);
        self.offsets.extend(ends.map(|end| first + end));
    }

    /// Returns the number of rows.
    pub fn len(&self) -> usize {
        self.values.len() / POSE_FEATURES
    }

    /// Returns the number of clips.
    pub fn clips(&self) -> usize {
        self.offsets.len() - 1
    }

    /// Returns the rows of a clip.
    pub fn clip(&self, clip: usize) -> std::ops::Range<usize> {
        self.offsets[clip]..self.offsets[clip + 1]
    }

    /// Returns the numbers of a range of rows.
    pub fn values(&self, rows: std::ops::Range<usize>) -> &[f16] {
        &self.values[rows.start * POSE_FEATURES..rows.end * POSE_FEATURES]
    }

    /// Returns a row as 32-bit numbers.
    pub fn row(&self, row: usize) -> [f32; POSE_FEATURES] {
        let mut values = [0.0; POSE_FEATURES];
        self.values(row..row + 1).convert_to_f32_slice(&mut values);
        values
    }
}

/// Converts numbers to 16 bits. The error is the index of the first number that is not finite in 16 bits.
pub(crate) fn to_half(values: &[f32]) -> Result<Vec<f16>, usize> {
    let mut halves = vec![f16::ZERO; values.len()];
    halves.convert_from_f32_slice(values);
    match first_not_finite(&halves) {
        None => Ok(halves),
        Some(place) => Err(place),
    }
}

/// Returns the index of the first number that is not finite.
pub(crate) fn first_not_finite(values: &[f16]) -> Option<usize> {
    values.iter().position(|value| !value.is_finite())
}
