//! Embeddings of texts and motions, in the host's memory.

use burn::tensor::Tensor;

use super::MetricError;

/// A set of embeddings of one width. All numbers are finite.
#[derive(Clone, Debug, PartialEq)]
pub struct Embeddings {
    values: Vec<f32>,
    width: usize,
}

impl Embeddings {
    /// Returns embeddings from rows of `width` numbers, one after another.
    ///
    /// # Errors
    ///
    /// If the numbers do not fill rows, or one is not finite.
    pub fn new(values: Vec<f32>, width: usize) -> Result<Self, MetricError> {
        if width == 0 || !values.len().is_multiple_of(width) {
            return Err(MetricError::Width {
                expected: width,
                found: values.len(),
            });
        }
        match values.iter().position(|value| !value.is_finite()) {
            Some(place) => Err(MetricError::NotFinite { row: place / width }),
            None => Ok(Embeddings { values, width }),
        }
    }

    /// Returns embeddings from a tensor `[count, width]` on any device.
    ///
    /// # Errors
    ///
    /// If a number is not finite.
    pub fn from_tensor(tensor: Tensor<2>) -> Result<Self, MetricError> {
        let [_, width] = tensor.dims();
        Self::new(tensor.into_data().iter::<f32>().collect(), width)
    }

    /// Appends other embeddings.
    ///
    /// # Errors
    ///
    /// If the widths differ.
    pub fn extend(&mut self, other: &Embeddings) -> Result<(), MetricError> {
        self.check_width(other)?;
        self.values.extend_from_slice(&other.values);
        Ok(())
    }

    /// Returns the embeddings with the given indices, in the given order.
    ///
    /// # Panics
    ///
    /// If there is no embedding with an index.
    pub fn select(&self, rows: impl IntoIterator<Item = usize>) -> Embeddings {
        Embeddings {
            values: rows
                .into_iter()
                .flat_map(|row| self.row(row))
                .copied()
                .collect(),
            width: self.width,
        }
    }

    /// Returns the number of embeddings.
    pub fn len(&self) -> usize {
        self.values.len() / self.width
    }

    /// Returns whether there are no embeddings.
    pub fn is_empty(&self) -> bool {
        self.values.is_empty()
    }

    /// Returns how many numbers each embedding has.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Returns the embedding with an index.
    ///
    /// # Panics
    ///
    /// If there is no embedding with this index.
    pub fn row(&self, index: usize) -> &[f32] {
        &self.values[index * self.width..][..self.width]
    }

    pub(super) fn rows(&self) -> impl Iterator<Item = &[f32]> {
        self.values.chunks_exact(self.width)
    }

    pub(super) fn check_width(&self, other: &Embeddings) -> Result<(), MetricError> {
        match self.width == other.width {
            true => Ok(()),
            false => Err(MetricError::Mismatch {
                what: "embeddings of a width",
                expected: self.width,
                found: other.width,
            }),
        }
    }
}

/// Returns the Euclidean distance.
pub(super) fn distance(a: &[f32], b: &[f32]) -> f64 {
    let squares = a.iter().zip(b).map(|(&a, &b)| {
        let difference = f64::from(a) - f64::from(b);
        difference * difference
    });
    squares.sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_that_are_not_finite_are_named_by_their_row() {
        let error = Embeddings::new(vec![0.0, 1.0, 2.0, f32::NAN], 2).unwrap_err();
        assert_eq!(
            error.to_string(),
            "embedding 1 holds numbers that are not finite"
        );
        assert!(Embeddings::new(vec![0.0; 5], 2).is_err());
    }
}
