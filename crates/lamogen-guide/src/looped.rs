//! Networks whose motions are loops.

use burn::tensor::{Device, Int, Tensor, TensorData};
use lamogen_model::{Denoiser, FrameMask};
use lamogen_motion::{FeatureGroup, Normalization};

use crate::arranged::{Arranged, FrameArrangement, select_frames, smooth_step};

/// The number of frames that both ends of a loop share, if the motion and the network leave room for them: one second.
const OVERLAP: usize = 20;
/// The least number of frames that both ends of a loop share.
const MIN_OVERLAP: usize = 10;

/// A network whose motions are loops: the last frame leads into the first.
///
/// The network sees every motion with its first frames once more after its end. There are thus two predictions of these
/// frames: one knows what comes after them, the other what comes before them. The result passes from the second to the
/// first in the course of the frames. Since this happens at every step of a pass, both ends take each other into account
/// from the first step on.
///
/// Loops are not part of the paper.
pub type Looped<'a, D> = Arranged<'a, D, LoopOverlaps>;

impl<'a, D: Denoiser> Looped<'a, D> {
    /// Wraps a network for a batch of loops of the given lengths, padded to the longest. Without lengths, the result is the
    /// network itself.
    pub fn new(network: &'a D, lengths: Option<&[usize]>) -> Self {
        let overlaps = lengths
            .map(|lengths| LoopOverlaps::new(lengths, network.max_frames(), &network.device()));
        Arranged::with(network, overlaps)
    }
}

/// Returns the length of the longest loop of a network whose longest motion has `max_frames` frames.
pub fn longest_loop(max_frames: usize) -> usize {
    max_frames.saturating_sub(MIN_OVERLAP)
}

/// The frames that both ends of each motion of a batch share.
pub struct LoopOverlaps {
    /// The number of frames of the batch without the repeated ones.
    frames: usize,
    /// The mask of the motions with their repeated frames.
    mask: FrameMask,
    /// The frame of the motion that each frame of the longer motion repeats, `[batch, longer frames]`.
    sources: Tensor<2, Int>,
    /// The frame of the longer motion that repeats each frame, or the frame itself, `[batch, frames]`.
    repetitions: Tensor<2, Int>,
    /// The share of the prediction at the beginning, `[batch, frames, 1]`; the rest is that of the prediction at the end.
    share: Tensor<3>,
}

impl LoopOverlaps {
    fn new(lengths: &[usize], max_frames: usize, device: &Device) -> LoopOverlaps {
        let frames = lengths.iter().copied().max().unwrap_or(0);
        let overlap = |length: usize| {
            OVERLAP
                .min(length / 2)
                .min(max_frames.saturating_sub(length))
        };
        let longer: Vec<usize> = lengths.iter().map(|n| n + overlap(*n)).collect();
        let longest = longer.iter().copied().max().unwrap_or(0);
        let (mut sources, mut repetitions, mut share) = (Vec::new(), Vec::new(), Vec::new());
        for &length in lengths {
            let overlap = overlap(length);
            sources.extend((0..longest).map(|t| match t < length + overlap {
                true => (t % length) as i32,
                false => 0,
            }));
            repetitions.extend((0..frames).map(|t| match t < overlap {
                true => (length + t) as i32,
                false => t as i32,
            }));
            share.extend((0..frames).map(|t| match t < overlap {
                true => smooth_step((t + 1) as f32 / (overlap + 1) as f32),
                false => 1.0,
            }));
        }
        let batch = lengths.len();
        LoopOverlaps {
            frames,
            mask: FrameMask::new(&longer, longest, device),
            sources: Tensor::from_data(TensorData::new(sources, [batch, longest]), device),
            repetitions: Tensor::from_data(TensorData::new(repetitions, [batch, frames]), device),
            share: Tensor::from_data(TensorData::new(share, [batch, frames, 1]), device),
        }
    }
}

impl FrameArrangement for LoopOverlaps {
    /// Returns motions, `[batch, frames, features]`, with their first frames repeated after their ends.
    fn arrange(&self, motions: Tensor<3>) -> Tensor<3> {
        select_frames(motions, &self.sources)
    }

    /// Blends the two predictions of the shared frames. The result has the frames of the motions alone.
    fn blend(&self, predictions: Tensor<3>) -> Tensor<3> {
        let own = predictions.clone().narrow(1, 0, self.frames);
        let repeated = select_frames(predictions, &self.repetitions);
        repeated.clone() + (own - repeated) * self.share.clone()
    }

    fn mask(&self) -> &FrameMask {
        &self.mask
    }

    fn longest(&self, max_frames: usize) -> usize {
        longest_loop(max_frames)
    }
}

/// Keeps loops from turning: changes predicted motions so that the body faces at the end as at the beginning, or has turned
/// round whole times.
#[derive(Clone)]
pub(crate) struct HeadingClosure {
    /// 1 divided by the number of frames of each motion, and 0 past its end, `[batch, frames, 1]`.
    mean: Tensor<3>,
    /// The number of frames of each motion, `[batch, 1, 1]`.
    lengths: Tensor<3>,
    /// The mean and the standard deviation of the turning of the root.
    scale: (f64, f64),
}

impl HeadingClosure {
    /// Prepares the closure for motions of the given lengths, padded to `frames` frames.
    pub(crate) fn new(
        lengths: &[usize],
        frames: usize,
        normalization: &Normalization,
        device: &Device,
    ) -> HeadingClosure {
        let [means, deviations] = normalization.values();
        let yaw = FeatureGroup::RootYaw.range().start;
        let mean = lengths.iter().flat_map(|&length| {
            (0..frames).map(move |t| if t < length { 1.0 / length as f32 } else { 0.0 })
        });
        let mean: Vec<f32> = mean.collect();
        let lengths: Vec<f32> = lengths.iter().map(|&length| length as f32).collect();
        let batch = lengths.len();
        HeadingClosure {
            mean: Tensor::from_data(TensorData::new(mean, [batch, frames, 1]), device),
            lengths: Tensor::from_data(TensorData::new(lengths, [batch, 1, 1]), device),
            scale: (f64::from(means[yaw]), f64::from(deviations[yaw])),
        }
    }

    /// Removes the turn that is left over, evenly over the frames. `motions` are normalised, `[batch, frames, features]`.
    pub(crate) fn close(&self, motions: Tensor<3>) -> Tensor<3> {
        let [_, frames, features] = motions.dims();
        let yaw = FeatureGroup::RootYaw.range();
        let turning = motions.clone().narrow(2, yaw.start, 1);
        let (mean, deviation) = self.scale;
        let average = (turning.clone() * self.mean.clone()).sum_dim(1);
        // Pose features have half the angle, so a whole turn is π.
        let turns = (average.clone().detach() * deviation + mean) * self.lengths.clone()
            / std::f64::consts::PI;
        let whole = turns.round() * std::f64::consts::PI / self.lengths.clone();
        let excess = average - (whole - mean) / deviation;
        let closed = turning - excess.repeat_dim(1, frames);
        let mut parts = vec![closed];
        if yaw.start > 0 {
            parts.insert(0, motions.clone().narrow(2, 0, yaw.start));
        }
        parts.push(motions.narrow(2, yaw.end, features - yaw.end));
        Tensor::cat(parts, 2)
    }
}
