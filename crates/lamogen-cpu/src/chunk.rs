//! The division of a batch's frames among threads.
//!
//! A motion is split into granules of nearly equal length. A chunk is a run of adjacent granules of one motion; each
//! chunk passes through the network on one thread.

use std::ops::Range;

/// A run of adjacent frames of one motion that passes through the network on one thread.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Chunk {
    /// The index of the motion in the batch.
    pub(crate) motion: usize,
    /// The index of the first frame in the motion.
    pub(crate) first: usize,
    /// The index of the first granule in the motion.
    pub(crate) first_granule: usize,
    /// The number of frames in each granule.
    pub(crate) granule_lengths: Vec<usize>,
}

/// The largest number of frames in a granule. Sums over frames are formed granule by granule.
///
/// The lengths of the granules depend on the length of the motion alone. So the results do not depend on the number of
/// threads.
const MAX_GRANULE_FRAMES: usize = 50;

/// The length in frames of the shortest motion that is split into more than one granule.
const MIN_SPLIT_FRAMES: usize = 16;

/// The largest number of granules in a chunk. Matrix products with more rows are no faster.
const MAX_GRANULES_PER_CHUNK: usize = 4;

impl Chunk {
    /// Splits motions of the given lengths into chunks so that each of `threads` threads has work.
    pub(crate) fn split(lengths: &[usize], threads: usize) -> Vec<Chunk> {
        let all: usize = lengths.iter().map(|&length| granule_count(length)).sum();
        let granules_per_chunk = (all / threads.max(1)).clamp(1, MAX_GRANULES_PER_CHUNK);
        let mut chunks = Vec::new();
        for (motion, &length) in lengths.iter().enumerate() {
            let granule_lengths = granule_lengths(length);
            let mut first = 0;
            let count = granule_lengths.len().div_ceil(granules_per_chunk);
            for part in 0..count {
                let range = part * granule_lengths.len() / count
                    ..(part + 1) * granule_lengths.len() / count;
                let chunk = Chunk {
                    motion,
                    first,
                    first_granule: range.start,
                    granule_lengths: granule_lengths[range].to_vec(),
                };
                first += chunk.frames();
                chunks.push(chunk);
            }
        }
        chunks
    }

    /// Returns the number of frames.
    pub(crate) fn frames(&self) -> usize {
        self.granule_lengths.iter().sum()
    }

    /// Returns the range of each granule's numbers among those of the chunk, with `width` numbers per frame.
    pub(crate) fn granule_ranges(&self, width: usize) -> impl Iterator<Item = Range<usize>> {
        self.granule_lengths.iter().scan(0, move |end, frames| {
            let start = *end;
            *end += frames * width;
            Some(start..*end)
        })
    }
}

/// Returns the number of granules of a motion: 1 for a short motion, otherwise an even number, so that two threads
/// share the motion evenly.
fn granule_count(length: usize) -> usize {
    match length {
        ..MIN_SPLIT_FRAMES => 1,
        _ => 2 * length.div_ceil(2 * MAX_GRANULE_FRAMES),
    }
}

/// Splits a length into nearly equal granules.
fn granule_lengths(length: usize) -> Vec<usize> {
    let count = granule_count(length);
    (0..count)
        .map(|i| (i + 1) * length / count - i * length / count)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_frame_is_in_one_chunk_in_order() {
        for threads in [1, 2, 3, 16, 64] {
            let lengths = [196, 1, 50, 51, 80, 1000];
            let chunks = Chunk::split(&lengths, threads);
            for (motion, &length) in lengths.iter().enumerate() {
                let mut next = 0;
                let mut all: Vec<usize> = Vec::new();
                for chunk in chunks.iter().filter(|chunk| chunk.motion == motion) {
                    assert_eq!(chunk.first, next);
                    assert!(chunk.frames() > 0);
                    next += chunk.frames();
                    all.extend(&chunk.granule_lengths);
                }
                assert_eq!(next, length);
                assert_eq!(all, granule_lengths(length));
            }
        }
    }

    #[test]
    fn one_motion_is_shared_by_two_threads() {
        let chunks = Chunk::split(&[196], 2);
        assert_eq!(chunks.len(), 2);
        assert_eq!(chunks[0].frames(), 98);
        assert_eq!(Chunk::split(&[120], 2)[0].frames(), 60);
        assert_eq!(Chunk::split(&[40], 2)[0].frames(), 20);
        assert_eq!(Chunk::split(&[196], 8).len(), 4);
        assert_eq!(Chunk::split(&[196; 8], 2).len(), 8);
    }
}
