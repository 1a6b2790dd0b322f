//! How the frames of a batch are dealt out to threads.

use std::ops::Range;

/// Adjacent frames of one motion, which pass through the network on one thread.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Chunk {
    pub(crate) motion: usize,
    /// The first frame.
    pub(crate) first: usize,
    /// The first granule.
    pub(crate) first_granule: usize,
    /// Number of frames in each granule.
    pub(crate) granules: Vec<usize>,
}

/// The most frames whose sums are formed together. A granule's length depends on the length of a motion
/// alone; so do results, however many threads there are.
const GRANULE: usize = 50;

/// The shortest motion that is cut at all.
const SHORTEST_CUT: usize = 16;

/// More rows at once make matrix products no faster.
const GRANULES_AT_ONCE: usize = 4;

impl Chunk {
    /// Cuts motions of the given lengths so that each of so many threads has work.
    pub(crate) fn cut(lengths: &[usize], threads: usize) -> Vec<Chunk> {
        let all: usize = lengths.iter().map(|&length| count(length)).sum();
        let at_once = (all / threads.max(1)).clamp(1, GRANULES_AT_ONCE);
        let mut chunks = Vec::new();
        for (motion, &length) in lengths.iter().enumerate() {
            let granules = granules(length);
            let mut first = 0;
            let count = granules.len().div_ceil(at_once);
            for part in 0..count {
                let range = part * granules.len() / count..(part + 1) * granules.len() / count;
                let chunk = Chunk {
                    motion,
                    first,
                    first_granule: range.start,
                    granules: granules[range].to_vec(),
                };
                first += chunk.frames();
                chunks.push(chunk);
            }
        }
        chunks
    }

    /// Number of frames.
    pub(crate) fn frames(&self) -> usize {
        self.granules.iter().sum()
    }

    /// Where each granule's numbers stand among those of the chunk, `width` a frame.
    pub(crate) fn granules(&self, width: usize) -> impl Iterator<Item = Range<usize>> {
        self.granules.iter().scan(0, move |end, frames| {
            let start = *end;
            *end += frames * width;
            Some(start..*end)
        })
    }
}

/// How many granules a motion has: an even number, so that two threads share it evenly.
fn count(length: usize) -> usize {
    match length {
        ..SHORTEST_CUT => 1,
        _ => 2 * length.div_ceil(2 * GRANULE),
    }
}

/// Nearly equal parts of a length.
fn granules(length: usize) -> Vec<usize> {
    let count = count(length);
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
            let chunks = Chunk::cut(&lengths, threads);
            for (motion, &length) in lengths.iter().enumerate() {
                let mut next = 0;
                let mut all: Vec<usize> = Vec::new();
                for chunk in chunks.iter().filter(|chunk| chunk.motion == motion) {
                    assert_eq!(chunk.first, next);
                    assert!(chunk.frames() > 0);
                    next += chunk.frames();
                    all.extend(&chunk.granules);
                }
                assert_eq!(next, length);
                assert_eq!(all, granules(length));
            }
        }
    }

    #[test]
    fn one_motion_is_shared_by_two_threads() {
        let chunks = Chunk::cut(&[196], 2);
        assert_eq!(chunks.len(), 2);
        assert_eq!(chunks[0].frames(), 98);
        assert_eq!(Chunk::cut(&[120], 2)[0].frames(), 60);
        assert_eq!(Chunk::cut(&[40], 2)[0].frames(), 20);
        assert_eq!(Chunk::cut(&[196], 8).len(), 4);
        assert_eq!(Chunk::cut(&[196; 8], 2).len(), 8);
    }
}
