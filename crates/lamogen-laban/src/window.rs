//! Gaussian smoothing along the frames of a batch.

use burn::tensor::{Device, Int, Tensor, TensorData};

use crate::smoothing::GaussianKernel;

/// The largest number of frames that is smoothed by one matrix product.
const BLOCK: usize = 256;

/// A Gaussian window that smooths a batch of series of given lengths, differentiably. Before a motion's first frame the
/// first frame repeats, and after its last frame the last, so that padding has no effect.
///
/// A series is cut into blocks, so that memory grows with the number of frames and not with its square.
#[derive(Clone, Debug)]
pub struct SmoothingWindow {
    /// The row of `[batch * frames, …]` at each place of all blocks. Each block is extended by the radius of the window
    /// on both sides.
    rows: Tensor<1, Int>,
    /// The matrix `[1, block, block + 2 * radius]` with the kernel along its diagonal. Each sum of the product runs
    /// over the weights of the kernel in their order, as in a convolution. The order matters, because differences of
    /// smoothed positions magnify rounding errors.
    band: Tensor<3>,
}

impl SmoothingWindow {
    /// Creates the window for motions of the given lengths, padded to `frames` frames. A length of 0 counts as 1.
    ///
    /// # Panics
    ///
    /// If `frames` is 0.
    pub fn new(
        gaussian: &GaussianKernel,
        frames: usize,
        lengths: impl Iterator<Item = usize>,
        device: &Device,
    ) -> Self {
        Self::with_neighbours(gaussian, frames, lengths, device, |frame, length| {
            frame.clamp(0, length as isize - 1) as usize
        })
    }

    /// Creates the window for loops: before the first frame comes the last one, and after the last frame the first one.
    ///
    /// # Panics
    ///
    /// If `frames` is 0.
    pub fn cyclic(
        gaussian: &GaussianKernel,
        frames: usize,
        lengths: impl Iterator<Item = usize>,
        device: &Device,
    ) -> Self {
        Self::with_neighbours(gaussian, frames, lengths, device, |frame, length| {
            frame.rem_euclid(length as isize) as usize
        })
    }

    /// Creates the window of motions whose frames beyond their ends are those that `neighbour` gives for a place and the length of
    /// a motion.
    fn with_neighbours(
        gaussian: &GaussianKernel,
        frames: usize,
        lengths: impl Iterator<Item = usize>,
        device: &Device,
        neighbour: impl Fn(isize, usize) -> usize + Copy,
    ) -> Self {
        assert!(frames > 0, "a window needs a frame");
        let kernel = gaussian.kernel();
        let radius = kernel.len() / 2;
        let block = frames.min(BLOCK);
        let extended = block + 2 * radius;
        let rows: Vec<i32> = lengths
            .enumerate()
            .flat_map(|(motion, length)| {
                let row = move |t: usize| {
                    let frame = t as isize - radius as isize;
                    motion * frames + neighbour(frame, length.max(1))
                };
                (0..frames)
                    .step_by(block)
                    .flat_map(move |start| (start..start + extended).map(row))
            })
            .map(|row| row as i32)
            .collect();
        let mut band = vec![0.0; block * extended];
        for (t, row) in band.chunks_exact_mut(extended).enumerate() {
            row[t..t + kernel.len()].copy_from_slice(&kernel);
        }
        SmoothingWindow {
            rows: Tensor::from_data(rows.as_slice(), device),
            band: Tensor::from_data(TensorData::new(band, [1, block, extended]), device),
        }
    }

    /// Smooths `[batch, frames, channels]` along the frames.
    ///
    /// # Panics
    ///
    /// If the batch size or the number of frames is not the one that the window was created for.
    pub fn smooth(&self, x: Tensor<3>) -> Tensor<3> {
        let [batch, frames, channels] = x.dims();
        let [_, block, extended] = self.band.dims();
        let blocks = frames.div_ceil(block);
        let x = x
            .reshape([batch * frames, channels])
            .select(0, self.rows.clone())
            .reshape([batch * blocks, extended, channels]);
        self.band
            .clone()
            .matmul(x)
            .reshape([batch, blocks * block, channels])
            .narrow(1, 0, frames)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn smooth(series: &[f32], length: usize) -> Vec<f32> {
        let device = Device::flex();
        let frames = series.len();
        let window = SmoothingWindow::new(
            &GaussianKernel::PAPER,
            frames,
            [length].into_iter(),
            &device,
        );
        let data = TensorData::new(series.to_vec(), [1, frames, 1]);
        let smoothed = window.smooth(Tensor::from_data(data, &device));
        smoothed.into_data().try_to_vec().unwrap()
    }

    #[test]
    fn smoothing_keeps_a_still_pose_still() {
        for value in smooth(&[2.0; 9], 9) {
            assert!((value - 2.0).abs() < 1e-6);
        }
    }

    #[test]
    fn an_impulse_becomes_the_kernel() {
        let mut impulse = [0.0; 15];
        impulse[7] = 1.0;
        assert_eq!(smooth(&impulse, 15)[2..13], GaussianKernel::PAPER.kernel());
    }

    #[test]
    fn the_ends_repeat_and_padding_does_not_leak() {
        let mut series = [0.0; 12];
        series[7] = 1.0;
        let alone = smooth(&series[..8], 8);
        let tail: f32 = GaussianKernel::PAPER.kernel()[5..].iter().sum();
        assert!((alone[7] - tail).abs() < 1e-6);
        series[8..].fill(1e6);
        assert_eq!(smooth(&series, 8)[..8], alone);
    }

    #[test]
    fn blocks_join_without_a_seam() {
        let kernel = GaussianKernel::PAPER.kernel();
        let series: Vec<f32> = (0..600).map(|t| (t as f32 * 0.37).sin()).collect();
        for (t, smoothed) in smooth(&series, 600).into_iter().enumerate() {
            let tap = |offset: usize| series[(t + offset).saturating_sub(5).min(599)];
            let expected: f32 = kernel.iter().enumerate().map(|(i, k)| k * tap(i)).sum();
            assert!((smoothed - expected).abs() < 1e-6, "frame {t}");
        }
    }
}
