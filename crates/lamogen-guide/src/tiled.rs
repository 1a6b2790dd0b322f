//! Motions longer than a network's longest, made of tiles that overlap.
//!
//! ```text
//! sentences     | a person walks forward            | a person jumps    |
//! tiles         |---------------------|             |                   |
//!               |               |-----------------------|               |
//!               |                               |-----------------------|
//!               every tile is evaluated for its sentence; where two overlap, the prediction passes from one to the other
//! ```

use std::ops::Range;

use burn::tensor::{Device, Int, Tensor, TensorData};
use lamogen_model::{Denoiser, FrameMask};

use crate::arranged::{Arranged, FrameArrangement, smooth_step};

/// The number of frames by which a tile reaches into each of its neighbours, if they and the network's motions are long enough: one
/// second, so that neighbours share two. With half of it, motions pass from one sentence to the next within a few frames.
const REACH: usize = 20;
/// The number of frames of the shortest sentence beside others: one second.
const SHORTEST: usize = 20;

/// The frames that a network sees at once, in a motion of several sentences or one that is longer than the network's longest.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Tile {
    /// The frames of the tile among those of the motion.
    pub frames: Range<usize>,
    /// The index of the sentence that the tile is made for.
    pub sentence: usize,
}

/// How a motion of several sentences, or a long one, is cut into tiles.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Tiling {
    tiles: Vec<Tile>,
}

impl Tiling {
    /// Cuts a motion into tiles. `lengths` are the numbers of frames of its sentences, one after another, and `longest` is the
    /// length of the network's longest motion.
    ///
    /// The pieces of a sentence are equally long. A tile is a piece with up to a second of its neighbours on each side, but
    /// at most half of a neighbour or of its own, so that no frame is in three tiles.
    ///
    /// # Panics
    ///
    /// If there is no sentence, one is shorter than [`shortest`](Self::shortest), or the longest motion has fewer than 2
    /// frames.
    pub fn new(lengths: &[usize], longest: usize) -> Tiling {
        let total: usize = lengths.iter().sum();
        assert!(total > 0, "a motion has a sentence");
        if let [length] = lengths
            && *length <= longest
        {
            let tile = Tile {
                frames: 0..total,
                sentence: 0,
            };
            return Tiling { tiles: vec![tile] };
        }
        let reach = reach(longest);
        let mut pieces = Vec::new();
        let mut start = 0;
        for (sentence, &length) in lengths.iter().enumerate() {
            assert!(
                length >= Tiling::shortest(longest),
                "a sentence of {length} frames is shorter than {}",
                Tiling::shortest(longest)
            );
            let count = length.div_ceil(longest - 2 * reach);
            let place = |piece: usize| start + length * piece / count;
            pieces.extend((0..count).map(|piece| Tile {
                frames: place(piece)..place(piece + 1),
                sentence,
            }));
            start += length;
        }
        let borders: Vec<usize> = { pieces.windows(2) }
            .map(|pair| {
                let halves = pair.iter().map(|piece| piece.frames.len() / 2);
                halves.fold(reach, usize::min)
            })
            .collect();
        let mut tiles = pieces;
        for (border, reach) in borders.into_iter().enumerate() {
            tiles[border].frames.end += reach;
            tiles[border + 1].frames.start -= reach;
        }
        Tiling { tiles }
    }

    /// Returns the number of frames of the shortest sentence beside others, for a network whose longest motion has `longest`
    /// frames.
    pub fn shortest(longest: usize) -> usize {
        SHORTEST.min(longest / 2).max(1)
    }

    /// Returns the tiles in the order of their frames.
    pub fn tiles(&self) -> &[Tile] {
        &self.tiles
    }

    /// Returns the number of frames of the motion.
    pub fn frames(&self) -> usize {
        self.tiles.last().map_or(0, |tile| tile.frames.end)
    }

    /// Returns whether the motion is a single tile, which a network makes as it is.
    pub fn is_whole(&self) -> bool {
        self.tiles.len() == 1
    }
}

/// Returns the number of frames by which tiles reach into their neighbours at most, for a network whose longest motion has
/// `longest` frames.
fn reach(longest: usize) -> usize {
    REACH.min(longest / 4)
}

/// A network whose motions are made of tiles.
///
/// Every evaluation sees all tiles as a batch, each with the prompt of its sentence, and blends what it predicts of the frames
/// that two tiles share. Since this happens at every step of a pass, neighbouring tiles take each other into account from the
/// first step on; gradients go through the blend to the embedding of each tile. The idea is that of joint diffusion of
/// overlapping windows (MultiDiffusion, Bar-Tal et al. 2023; for motion PriorMDM, Shafir et al. 2023).
///
/// A batch is a single motion, and its prompts, embeddings and offsets have a row for each tile. Motions of several sentences
/// are not part of the paper.
pub type Tiled<'a, D> = Arranged<'a, D, TileLayout>;

impl<'a, D: Denoiser> Tiled<'a, D> {
    /// Wraps a network for one motion. Without a tiling, or with one of a single tile, the result is the network itself.
    pub fn new(network: &'a D, tiling: Option<&Tiling>) -> Self {
        let tiling = tiling.filter(|tiling| !tiling.is_whole());
        let layout = tiling.map(|tiling| TileLayout::new(tiling, &network.device()));
        Arranged::with(network, layout)
    }
}

/// Where the frames of a motion lie in its tiles.
pub struct TileLayout {
    /// The numbers of tiles and of frames of the longest one.
    shape: [usize; 2],
    /// The mask of the tiles.
    mask: FrameMask,
    /// The frame of the motion that is each frame of each tile, `[tiles · longest]`.
    sources: Tensor<1, Int>,
    /// The place of each frame in the tile that ends later, `[frames]`.
    later: Tensor<1, Int>,
    /// The place of each frame in the tile that ends earlier, or in the same tile where there is only one, `[frames]`.
    earlier: Tensor<1, Int>,
    /// The share of the later tile, `[1, frames, 1]`.
    share: Tensor<3>,
}

impl TileLayout {
    fn new(tiling: &Tiling, device: &Device) -> TileLayout {
        let tiles = tiling.tiles();
        let lengths: Vec<usize> = tiles.iter().map(|tile| tile.frames.len()).collect();
        let longest = lengths.iter().copied().max().unwrap_or(0);
        let sources = tiles.iter().flat_map(|tile| {
            // Frames past the end of a tile are masked.
            let frames = tile.frames.clone().map(|frame| frame as i32);
            frames.chain(std::iter::repeat(0)).take(longest)
        });
        let sources: Vec<i32> = sources.collect();
        let frames = tiling.frames();
        let (mut later, mut earlier) = (vec![0; frames], vec![0; frames]);
        let mut share = vec![1.0; frames];
        for (index, tile) in tiles.iter().enumerate() {
            let shared = match index {
                0 => 0,
                _ => tiles[index - 1].frames.end - tile.frames.start,
            };
            for (place, frame) in tile.frames.clone().enumerate() {
                earlier[frame] = later[frame];
                later[frame] = (index * longest + place) as i32;
                if place < shared {
                    share[frame] = smooth_step((place as f32 + 0.5) / shared as f32);
                } else {
                    earlier[frame] = later[frame];
                }
            }
        }
        let index = |values: Vec<i32>| {
            let count = values.len();
            Tensor::from_data(TensorData::new(values, [count]), device)
        };
        TileLayout {
            shape: [tiles.len(), longest],
            mask: FrameMask::new(&lengths, longest, device),
            sources: index(sources),
            later: index(later),
            earlier: index(earlier),
            share: Tensor::from_data(TensorData::new(share, [1, frames, 1]), device),
        }
    }
}

impl FrameArrangement for TileLayout {
    /// Cuts a motion, `[1, frames, features]`, into tiles, `[tiles, longest, features]`.
    fn arrange(&self, motion: Tensor<3>) -> Tensor<3> {
        let [_, frames, features] = motion.dims();
        let [tiles, longest] = self.shape;
        let rows = motion.reshape([frames, features]);
        rows.select(0, self.sources.clone())
            .reshape([tiles, longest, features])
    }

    /// Blends what is predicted of each tile to a motion.
    fn blend(&self, predictions: Tensor<3>) -> Tensor<3> {
        let [tiles, longest, features] = predictions.dims();
        let rows = predictions.reshape([tiles * longest, features]);
        let [later, earlier]: [Tensor<3>; 2] = [&self.later, &self.earlier]
            .map(|places| rows.clone().select(0, places.clone()).unsqueeze_dim(0));
        earlier.clone() + (later - earlier) * self.share.clone()
    }

    fn mask(&self) -> &FrameMask {
        &self.mask
    }

    fn longest(&self, _: usize) -> usize {
        usize::MAX
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_cover_a_motion_and_overlap() {
        let ranges = |lengths: &[usize], longest| -> Vec<(Range<usize>, usize)> {
            let tiling = Tiling::new(lengths, longest);
            let tiles = tiling.tiles().iter();
            tiles
                .map(|tile| (tile.frames.clone(), tile.sentence))
                .collect()
        };
        assert_eq!(ranges(&[196], 196), [(0..196, 0)]);
        assert_eq!(ranges(&[60, 40], 196), [(0..80, 0), (40..100, 1)]);
        assert_eq!(ranges(&[200], 196), [(0..120, 0), (80..200, 0)]);
        let long = ranges(&[1200, 40], 196);
        assert_eq!(long.last(), Some(&(1180..1240, 1)));
        for pair in long.windows(2) {
            assert_eq!(pair[0].0.end - pair[1].0.start, 40);
        }
        assert!(long.iter().all(|(frames, _)| frames.len() <= 196));
        // A short sentence is reached into by half of its length from both sides, and networks of very short motions
        // overlap less.
        assert_eq!(
            ranges(&[60, 25, 60], 196),
            [(0..72, 0), (48..97, 1), (73..145, 2)]
        );
        assert_eq!(
            ranges(&[6, 8], 8),
            [(0..4, 0), (2..7, 0), (5..12, 1), (8..14, 1)]
        );
    }

    #[test]
    fn a_motion_that_is_cut_and_blended_is_itself() {
        let device = Device::flex();
        let tiling = Tiling::new(&[60, 45, 300], 196);
        let layout = TileLayout::new(&tiling, &device);
        let frames = tiling.frames();
        let values: Vec<f32> = (0..2 * frames).map(|value| value as f32).collect();
        let motion = Tensor::<3>::from_data(TensorData::new(values, [1, frames, 2]), &device);
        let tiles = layout.arrange(motion.clone());
        assert_eq!(tiles.dims(), [4, 190, 2]);
        let difference = (layout.blend(tiles) - motion)
            .abs()
            .max()
            .into_scalar::<f32>();
        assert!(difference < 1e-3, "{difference}");
    }

    #[test]
    fn shared_frames_pass_from_one_tile_to_the_next() {
        let device = Device::flex();
        let tiling = Tiling::new(&[60, 40], 196);
        let layout = TileLayout::new(&tiling, &device);
        let [tiles, longest] = layout.shape;
        let values = (0..tiles * longest).map(|place| (place / longest) as f32);
        let data = TensorData::new(values.collect::<Vec<f32>>(), [tiles, longest, 1]);
        let blended: Vec<f32> = { layout.blend(Tensor::from_data(data, &device)) }
            .try_into_vec_as()
            .unwrap();
        assert!(blended[..40].iter().all(|share| *share == 0.0));
        assert!(blended[80..].iter().all(|share| *share == 1.0));
        assert!(blended[40..80].windows(2).all(|pair| pair[0] < pair[1]));
        assert!((blended[59] + blended[60] - 1.0).abs() < 1e-6);
    }
}
