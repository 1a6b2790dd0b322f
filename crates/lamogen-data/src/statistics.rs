//! Mean and standard deviation of the features over the training split, as HumanML3D computes them.

use std::ops::Range;

use lamogen_motion::{FeatureGroup, POSE_FEATURES};
use rayon::prelude::*;

use crate::entry::Entry;
use crate::mirror::Mirror;
use crate::rows::Rows;
use crate::split::Split;

/// Mean and standard deviation of every feature, `[263]` each.
///
/// All features of a [`FeatureGroup`] have the same deviation, the mean of their own deviations (Guo et al. 2022,
/// `cal_mean_variance`). A group that never changes, such as the foot contacts of people who all stand still, has the
/// deviation 1, so that its features are normalised to 0.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Statistics {
    pub mean: Vec<f32>,
    pub std: Vec<f32>,
}

/// A smaller deviation, in metres or radians, counts as a rounding error: the feature does not change.
const UNCHANGING: f64 = 1e-5;

/// The number of rows that one task sums. It is fixed, so that sums do not depend on the number of threads.
const CHUNK: usize = 4096;

impl Statistics {
    /// Computes the statistics of the training entries without variations. Every row counts once, and once more
    /// mirrored if a mirror image uses it.
    ///
    /// # Errors
    ///
    /// If there is no training entry.
    pub fn of(entries: &[Entry], rows: &Rows, mirror: &Mirror) -> Result<Statistics, String> {
        let mut moments = Moments::default();
        for mirrored in [false, true] {
            let ranges = training_ranges(entries, mirrored);
            let chunks: Vec<Range<usize>> = ranges.into_iter().flat_map(chunks).collect();
            let parts: Vec<Moments> = { chunks.into_par_iter() }
                .map(|chunk| Moments::of(rows, chunk))
                .collect();
            let sum = parts.into_iter().fold(Moments::default(), Moments::merge);
            moments = moments.merge(match mirrored {
                true => sum.mirrored(mirror),
                false => sum,
            });
        }
        if moments.count == 0.0 {
            return Err("no motion is for training".into());
        }
        let mut std = vec![0.0; POSE_FEATURES];
        for group in FeatureGroup::ALL {
            let deviations = group
                .range()
                .map(|i| (moments.squares[i] / moments.count).sqrt());
            let mean = deviations.sum::<f64>() / group.width() as f64;
            std[group.range()].fill(match mean < UNCHANGING {
                true => 1.0,
                false => mean as f32,
            });
        }
        Ok(Statistics {
            mean: moments.mean.map(|mean| mean as f32).to_vec(),
            std,
        })
    }

    /// Returns the first value that cannot be a mean or a standard deviation: the name of its array (`mean` or `std`),
    /// what was expected, the feature's index, and the value.
    pub fn first_invalid(&self) -> Option<(&'static str, &'static str, usize, f32)> {
        let is_finite = |value: &f32| value.is_finite();
        let is_positive = |value: &f32| value.is_finite() && *value > 0.0;
        let first = |values: &[f32], is_valid: &dyn Fn(&f32) -> bool| {
            let index = values.iter().position(|value| !is_valid(value));
            index.map(|index| (index, values[index]))
        };
        let mean =
            first(&self.mean, &is_finite).map(|(i, value)| ("mean", "a finite mean", i, value));
        mean.or_else(|| {
            let (i, value) = first(&self.std, &is_positive)?;
            Some(("std", "a standard deviation above 0", i, value))
        })
    }
}

/// Returns the rows of the training entries that are mirror images, or of those that are not. The ranges are sorted and
/// do not overlap.
fn training_ranges(entries: &[Entry], mirrored: bool) -> Vec<Range<usize>> {
    let is_included = |entry: &&Entry| {
        let is_original = entry.variation_of.is_none();
        entry.split == Split::Train && entry.mirror == mirrored && is_original
    };
    let mut ranges: Vec<Range<usize>> = { entries.iter() }
        .filter(is_included)
        .map(Entry::rows)
        .collect();
    ranges.sort_by_key(|range| range.start);
    let mut joined: Vec<Range<usize>> = Vec::new();
    for range in ranges {
        match joined.last_mut() {
            Some(last) if range.start <= last.end => last.end = last.end.max(range.end),
            _ => joined.push(range),
        }
    }
    joined
}

/// Cuts a range of rows into chunks of [`CHUNK`] rows; the last one may be shorter.
fn chunks(range: Range<usize>) -> impl Iterator<Item = Range<usize>> {
    let end = range.end;
    range
        .step_by(CHUNK)
        .map(move |start| start..end.min(start + CHUNK))
}

/// The number of rows, their mean, and the sum of the squared deviations from the mean.
struct Moments {
    count: f64,
    mean: [f64; POSE_FEATURES],
    squares: [f64; POSE_FEATURES],
}

impl Default for Moments {
    fn default() -> Self {
        Moments {
            count: 0.0,
            mean: [0.0; POSE_FEATURES],
            squares: [0.0; POSE_FEATURES],
        }
    }
}

impl Moments {
    /// Computes the moments of a range of rows.
    fn of(rows: &Rows, range: Range<usize>) -> Moments {
        let mut moments = Moments {
            count: range.len() as f64,
            ..Moments::default()
        };
        for row in range.clone() {
            for (mean, value) in moments.mean.iter_mut().zip(rows.row(row)) {
                *mean += f64::from(value);
            }
        }
        moments.mean = moments.mean.map(|sum| sum / moments.count);
        for row in range {
            let places = moments.squares.iter_mut().zip(&moments.mean);
            for ((square, mean), value) in places.zip(rows.row(row)) {
                *square += (f64::from(value) - mean).powi(2);
            }
        }
        moments
    }

    /// Returns the moments of both sets of rows together (Chan et al. 1979).
    fn merge(mut self, other: Moments) -> Moments {
        let count = self.count + other.count;
        if count == 0.0 {
            return self;
        }
        let share = other.count / count;
        for i in 0..POSE_FEATURES {
            let difference = other.mean[i] - self.mean[i];
            self.mean[i] += difference * share;
            self.squares[i] += other.squares[i] + difference * difference * self.count * share;
        }
        self.count = count;
        self
    }

    /// Returns the moments of the mirror images of the rows.
    fn mirrored(&self, mirror: &Mirror) -> Moments {
        let (source, sign) = (mirror.source(), mirror.sign());
        Moments {
            count: self.count,
            mean: std::array::from_fn(|i| self.mean[source[i]] * f64::from(sign[i])),
            squares: std::array::from_fn(|i| self.squares[source[i]]),
        }
    }
}
