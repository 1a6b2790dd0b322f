//! Mean and standard deviation over the training split, as HumanML3D has them.

use std::ops::Range;

use lamogen_motion::{FeatureGroup, POSE_FEATURES};
use rayon::prelude::*;

use crate::entry::Entry;
use crate::mirror::Mirror;
use crate::rows::Rows;
use crate::split::Split;

/// Mean and standard deviation of every feature; within a [`FeatureGroup`] the deviation is one number, the mean of
/// the features' own (Guo et al. 2022, `cal_mean_variance`). A group that never changes, such as the contacts of
/// people who all stand still, has the deviation 1: its features are normalised to 0.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Statistics {
    pub mean: Vec<f32>,
    pub std: Vec<f32>,
}

/// What deviates less than this, in metres or radians, is taken for rounding.
const UNCHANGING: f64 = 1e-5;

/// Rows that one task sums up; fixed, so that sums do not depend on the number of threads.
const CHUNK: usize = 4096;

impl Statistics {
    /// Those of the training entries but for variations, every row once, and once mirrored where an entry is.
    ///
    /// # Errors
    ///
    /// If there is no training entry.
    pub fn of(entries: &[Entry], rows: &Rows, mirror: &Mirror) -> Result<Statistics, String> {
        let mut moments = Moments::default();
        for mirrored in [false, true] {
            let ranges = covered(entries, mirrored);
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

    /// The first value that can be no mean or standard deviation: in which of the two (`mean` or `std`), what is
    /// expected, of which feature, and the value.
    pub fn first_wrong(&self) -> Option<(&'static str, &'static str, usize, f32)> {
        let finite = |value: &f32| value.is_finite();
        let positive = |value: &f32| value.is_finite() && *value > 0.0;
        let wrong = |values: &[f32], right: &dyn Fn(&f32) -> bool| {
            let place = values.iter().position(|value| !right(value));
            place.map(|place| (place, values[place]))
        };
        let mean = wrong(&self.mean, &finite).map(|(i, value)| ("mean", "a finite mean", i, value));
        mean.or_else(|| {
            let (i, value) = wrong(&self.std, &positive)?;
            Some(("std", "a standard deviation above 0", i, value))
        })
    }
}

/// The rows of the training entries that are, or are not, mirrored: without overlaps, in order.
fn covered(entries: &[Entry], mirrored: bool) -> Vec<Range<usize>> {
    let wanted = |entry: &&Entry| {
        let is_original = entry.variation_of.is_none();
        entry.split == Split::Train && entry.mirror == mirrored && is_original
    };
    let mut ranges: Vec<Range<usize>> =
        { entries.iter() }.filter(wanted).map(Entry::rows).collect();
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

fn chunks(range: Range<usize>) -> impl Iterator<Item = Range<usize>> {
    let end = range.end;
    range
        .step_by(CHUNK)
        .map(move |start| start..end.min(start + CHUNK))
}

/// How many rows, their mean, and the sum of squared distances from it.
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

    /// Those of both together (Chan et al. 1979).
    fn merge(mut self, other: Moments) -> Moments {
        let count = self.count + other.count;
        if count == 0.0 {
            return self;
        }
        let part = other.count / count;
        for i in 0..POSE_FEATURES {
            let apart = other.mean[i] - self.mean[i];
            self.mean[i] += apart * part;
            self.squares[i] += other.squares[i] + apart * apart * self.count * part;
        }
        self.count = count;
        self
    }

    fn mirrored(&self, mirror: &Mirror) -> Moments {
        let (source, sign) = (mirror.source(), mirror.sign());
        Moments {
            count: self.count,
            mean: std::array::from_fn(|i| self.mean[source[i]] * f64::from(sign[i])),
            squares: std::array::from_fn(|i| self.squares[source[i]]),
        }
    }
}
