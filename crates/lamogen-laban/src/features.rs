//! The measurement of Weight, Time, Flow and Shape from joint positions.

use burn::tensor::{Device, Int, Tensor};
use lamogen_motion::{JOINTS, frame_mask};

use crate::effectors::EndEffectors;
use crate::smoothing::{GaussianKernel, Smoothing};
use crate::window::SmoothingWindow;

/// The number that is added to squared norms, so that a joint at rest has a finite gradient.
pub(crate) const SQUARED_NORM_OFFSET: f32 = 1e-12;

/// Options of the measurement of Laban features. The defaults are those of the paper.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LabanOptions {
    /// The smoothing along time before the differences are taken.
    pub smoothing: Smoothing,
    /// The end-effectors of which Weight, Time and Flow are measured.
    pub end_effectors: EndEffectors,
}

impl LabanOptions {
    /// Returns the options with other end-effectors.
    pub fn with_end_effectors(&self, end_effectors: EndEffectors) -> LabanOptions {
        LabanOptions {
            end_effectors,
            ..self.clone()
        }
    }
}

/// Measures the Laban features of motions of given lengths.
///
/// The value is built once for a batch; [`measure`](Self::measure) is then a differentiable function of the
/// joints. Let `v`, `a` and `j` be the first, second and third difference per frame of the smoothed
/// positions. The features are (paper, appendix "Detailed LMA Quantification Formulas"):
///
/// - Weight: `Σ mass · ‖v‖²` over the end-effectors
/// - Time: `Σ ‖a‖` over the end-effectors
/// - Flow: `Σ ‖j‖` over the end-effectors
/// - Shape: volume in m³ of the box around all 22 joints, aligned with the axes
///
/// The first 1, 2 and 3 frames of Weight, Time and Flow have no difference and hold 0. All frames
/// past a motion's length hold 0 too; the joints of those frames are ignored.
#[derive(Clone, Debug)]
pub struct LabanFeatures {
    frames: usize,
    lengths: Vec<usize>,
    /// The smoothing of positions, velocity and acceleration, each before its difference is taken; `None` for no
    /// smoothing.
    windows: [Option<SmoothingWindow>; ORDERS],
    /// The index of the joint of each end-effector.
    effectors: Tensor<1, Int>,
    masses: Tensor<1>,
    /// 1 at the frames of each motion, else 0; `None` where no motion is padded.
    mask: Option<Tensor<3>>,
    /// The direction of the motions in the room, in radians.
    heading: f32,
}

/// The number of differences: velocity, acceleration and jerk.
pub(crate) const ORDERS: usize = 3;

impl LabanFeatures {
    /// Prepares the measurement of a batch of motions of the given lengths, padded to `frames` frames.
    ///
    /// # Panics
    ///
    /// If a length is 0 or above `frames`, or there are no lengths.
    pub fn new(options: &LabanOptions, frames: usize, lengths: &[usize], device: &Device) -> Self {
        let mask = frame_mask(lengths, frames, device);
        // The n-th difference is n frames shorter.
        let window = |gaussian: &GaussianKernel, order: usize| {
            let lengths = lengths.iter().map(|length| length.saturating_sub(order));
            (frames > order)
                .then(|| SmoothingWindow::new(gaussian, frames - order, lengths, device))
        };
        let windows = match &options.smoothing {
            Smoothing::None => [None, None, None],
            Smoothing::Positions(gaussian) => [window(gaussian, 0), None, None],
            Smoothing::EachDifference(gaussian) => {
                std::array::from_fn(|order| window(gaussian, order))
            }
        };
        let joints: Vec<i32> = options
            .end_effectors
            .joints()
            .map(|joint| joint.index() as i32)
            .collect();
        let masses: Vec<f32> = options.end_effectors.masses().collect();
        LabanFeatures {
            frames,
            lengths: lengths.to_vec(),
            windows,
            effectors: Tensor::from_data(joints.as_slice(), device),
            masses: Tensor::from_data(masses.as_slice(), device),
            mask,
            heading: 0.0,
        }
    }

    /// Sets the direction in which the motions' own +Z points in the room where they will be put, in radians to the left of the
    /// room's. The box of Shape has the axes of the room; the other features do not depend on directions. Default: 0.
    pub fn with_heading(self, heading: f32) -> Self {
        LabanFeatures { heading, ..self }
    }

    /// Measures the features of joint positions.
    ///
    /// # Shapes
    ///
    /// - `joints`: `[batch, frames, 22, 3]` in metres
    /// - output: `[batch, frames, 4]`: Weight, Time, Flow, Shape
    ///
    /// # Panics
    ///
    /// If the batch size or the number of frames is not the one that the measurement was prepared for.
    pub fn measure(&self, joints: Tensor<4>) -> Tensor<3> {
        let [batch, frames, count, axes] = joints.dims();
        assert_eq!(
            [batch, frames, count],
            [self.lengths.len(), self.frames, JOINTS],
            "joints must be those of the motions that were prepared for"
        );
        let joints = self
            .smooth(0, joints.reshape([batch, frames, count * axes]))
            .reshape([batch, frames, count, axes]);
        let shape = volume(turned(joints.clone(), self.heading));
        let [weight, time, flow] = self.efforts(joints);
        let features = Tensor::cat(vec![weight, time, flow, shape], 2);
        match &self.mask {
            Some(mask) => features * mask.clone(),
            None => features,
        }
    }

    /// Returns the lengths of the motions in frames.
    pub fn lengths(&self) -> &[usize] {
        &self.lengths
    }

    /// Smooths the derivative of the given order: positions at 0, velocity at 1, acceleration at 2.
    fn smooth(&self, order: usize, series: Tensor<3>) -> Tensor<3> {
        match &self.windows[order] {
            Some(window) => window.smooth(series),
            None => series,
        }
    }

    /// Computes Weight, Time and Flow of smoothed positions, `[batch, frames, 1]` each.
    fn efforts(&self, joints: Tensor<4>) -> [Tensor<3>; ORDERS] {
        let [batch, frames, _, axes] = joints.dims();
        let count = self.masses.dims()[0];
        let mut series =
            joints
                .select(2, self.effectors.clone())
                .reshape([batch, frames, count * axes]);
        std::array::from_fn(|order| {
            let rows = frames.saturating_sub(order + 1);
            let zeros = Tensor::zeros([batch, frames - rows, 1], &series.device());
            if rows == 0 {
                return zeros;
            }
            if order > 0 {
                series = self.smooth(order, series.clone());
            }
            let (later, earlier) = (series.clone().narrow(1, 1, rows), series.clone());
            series = later - earlier.narrow(1, 0, rows);
            let squared = series
                .clone()
                .reshape([batch, rows, count, axes])
                .square()
                .sum_dim(3)
                .reshape([batch, rows, count]);
            let effort = match order {
                0 => squared * self.masses.clone().unsqueeze(),
                _ => (squared + SQUARED_NORM_OFFSET).sqrt(),
            };
            Tensor::cat(vec![zeros, effort.sum_dim(2)], 1)
        })
    }
}

/// Turns joint positions `[batch, frames, joints, 3]` to the left about the vertical, by an angle in radians.
fn turned(joints: Tensor<4>, angle: f32) -> Tensor<4> {
    if angle == 0.0 {
        return joints;
    }
    let (sin, cos) = angle.sin_cos();
    let [x, y, z] = std::array::from_fn(|axis| joints.clone().narrow(3, axis, 1));
    let (left, forward) = (x.clone() * cos + z.clone() * sin, z * cos - x * sin);
    Tensor::cat(vec![left, y, forward], 3)
}

/// Computes the volume of the box around the joints `[batch, frames, joints, 3]`, as `[batch, frames, 1]`.
fn volume(joints: Tensor<4>) -> Tensor<3> {
    let [batch, frames, _, axes] = joints.dims();
    let extent = (joints.clone().max_dim(2) - joints.min_dim(2)).reshape([batch, frames, axes]);
    let side = |axis: usize| extent.clone().narrow(2, axis, 1);
    side(0) * side(1) * side(2)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tags::{COMPONENTS, Component};
    use burn::tensor::TensorData;

    const FRAMES: usize = 30;

    /// Returns the joints of a motion in which every joint swings with a phase of its own.
    fn swinging(speed: f32) -> Tensor<4> {
        let mut values = Vec::new();
        for frame in 0..FRAMES {
            for joint in 0..JOINTS {
                for axis in 0..3 {
                    let phase = (joint * 3 + axis) as f32;
                    let angle = speed * 0.2 * frame as f32 + phase;
                    values.push((phase * 0.7).sin() + 0.1 * angle.sin());
                }
            }
        }
        let data = TensorData::new(values, [1, FRAMES, JOINTS, 3]);
        Tensor::from_data(data, &Device::flex())
    }

    fn measure(joints: Tensor<4>, options: &LabanOptions) -> Tensor<3> {
        let [batch, frames, _, _] = joints.dims();
        LabanFeatures::new(options, frames, &vec![frames; batch], &joints.device()).measure(joints)
    }

    fn every_smoothing() -> [LabanOptions; 3] {
        [
            Smoothing::None,
            Smoothing::Positions(GaussianKernel::PAPER),
            Smoothing::EachDifference(GaussianKernel::PAPER),
        ]
        .map(|smoothing| LabanOptions {
            smoothing,
            ..LabanOptions::default()
        })
    }

    fn largest(tensor: Tensor<3>) -> f32 {
        tensor.abs().max().into_scalar()
    }

    fn component(features: &Tensor<3>, component: Component) -> Tensor<3> {
        features.clone().narrow(2, component.index(), 1)
    }

    #[test]
    fn a_still_pose_has_no_effort() {
        let pose = swinging(1.0).narrow(1, 7, 1);
        for options in every_smoothing() {
            let features = measure(pose.clone().repeat_dim(1, FRAMES), &options);
            assert!(largest(features.clone().narrow(2, 0, 3)) < 1e-5);
            assert!(largest(component(&features, Component::Shape)) > 0.1);
        }
    }

    #[test]
    fn moving_the_whole_motion_changes_nothing() {
        let moved = swinging(4.0) + Tensor::<1>::from([2.0, 0.5, -3.0]).unsqueeze();
        for options in every_smoothing() {
            let before = measure(swinging(4.0), &options);
            let after = measure(moved.clone(), &options);
            for part in Component::ALL {
                let (before, after) = (component(&before, part), component(&after, part));
                let change = largest(after - before.clone()) / largest(before);
                // The rounding of positions of some metres is a quarter of a micrometre.
                assert!(change < 5e-4, "{part}: {change}");
            }
        }
    }

    #[test]
    fn turning_the_motion_changes_nothing_but_shape() {
        let (sin, cos) = 0.7f32.sin_cos();
        let turn = Tensor::<2>::from([[cos, 0.0, -sin], [0.0, 1.0, 0.0], [sin, 0.0, cos]]);
        let turned = swinging(4.0).matmul(turn.unsqueeze());
        for options in every_smoothing() {
            let before = measure(swinging(4.0), &options);
            let after = measure(turned.clone(), &options);
            for effort in [Component::Weight, Component::Time, Component::Flow] {
                let (before, after) = (component(&before, effort), component(&after, effort));
                let change = largest(after - before.clone()) / largest(before);
                assert!(change < 1e-4, "{effort}: {change}");
            }
            let shape = |features| component(features, Component::Shape);
            assert!(largest(shape(&after) - shape(&before)) > 0.01);
        }
    }

    #[test]
    fn a_heading_is_a_turn_of_the_motion() {
        let angle = 0.7;
        let turned = turned(swinging(4.0), angle);
        for options in every_smoothing() {
            let expected = measure(turned.clone(), &options);
            let features = LabanFeatures::new(&options, FRAMES, &[FRAMES], &Device::flex());
            let found = features.with_heading(angle).measure(swinging(4.0));
            for part in Component::ALL {
                let (expected, found) = (component(&expected, part), component(&found, part));
                let change = largest(found - expected.clone()) / largest(expected);
                assert!(change < 1e-4, "{part}: {change}");
            }
        }
    }

    #[test]
    fn twice_the_step_is_four_times_the_weight() {
        for options in every_smoothing() {
            let ramp = |step: f32| {
                let frames: Vec<f32> = (0..FRAMES).map(|t| step * t as f32).collect();
                let path: Tensor<4> = Tensor::<1>::from_floats(frames.as_slice(), &Device::flex())
                    .reshape([1, FRAMES, 1, 1]);
                path.repeat(&[1, 1, JOINTS, 3])
            };
            let weight = |step| component(&measure(ramp(step), &options), Component::Weight);
            let difference = largest(weight(0.02) - weight(0.01) * 4.0);
            assert!(difference < 1e-5 * largest(weight(0.02)), "{difference}");
        }
    }

    #[test]
    fn the_first_frames_hold_zero() {
        let features = measure(swinging(1.0), &LabanOptions::default());
        let values = features.into_data().try_to_vec::<f32>().unwrap();
        for component in Component::ALL {
            let zeros = [1, 2, 3, 0][component.index()];
            for frame in 0..4 {
                let value = values[frame * COMPONENTS + component.index()];
                assert_eq!(
                    value == 0.0,
                    frame < zeros,
                    "{component} at {frame}: {value}"
                );
            }
        }
    }

    #[test]
    fn padding_frames_change_nothing() {
        let device = Device::flex();
        for options in every_smoothing() {
            let alone = measure(swinging(1.0).narrow(1, 0, 17), &options);
            let noise = swinging(5.0).narrow(1, 17, FRAMES - 17) * 9.0;
            let padded = Tensor::cat(vec![swinging(1.0).narrow(1, 0, 17), noise], 1);
            let batch = Tensor::cat(vec![padded, swinging(2.0)], 0);
            let features = LabanFeatures::new(&options, FRAMES, &[17, FRAMES], &device);
            let batch = features.measure(batch);

            let first = batch.clone().narrow(0, 0, 1);
            assert!(largest(first.clone().narrow(1, 0, 17) - alone) < 1e-6);
            assert_eq!(largest(first.narrow(1, 17, FRAMES - 17)), 0.0);
            let second = measure(swinging(2.0), &options);
            assert!(largest(batch.narrow(0, 1, 1) - second) < 1e-6);
        }
    }

    #[test]
    fn short_motions_have_the_features_that_their_frames_allow() {
        for frames in 1..5 {
            for size in [1, 11, 41] {
                let gaussian = GaussianKernel::new(size, 10.0).unwrap();
                for smoothing in [
                    Smoothing::Positions(gaussian),
                    Smoothing::EachDifference(gaussian),
                ] {
                    let options = LabanOptions {
                        smoothing,
                        ..LabanOptions::default()
                    };
                    let features = measure(swinging(4.0).narrow(1, 0, frames), &options);
                    assert_eq!(features.dims(), [1, frames, COMPONENTS]);
                    for part in Component::ALL {
                        let first = [1, 2, 3, 0][part.index()];
                        let has_any = largest(component(&features, part)) > 0.0;
                        assert_eq!(has_any, frames > first, "{part}, {frames} frames");
                    }
                }
            }
        }
    }

    #[test]
    fn only_weight_uses_the_masses() {
        let heavy = LabanOptions {
            end_effectors: EndEffectors::new(EndEffectors::default().joints().map(|j| (j, 3.0)))
                .unwrap(),
            ..LabanOptions::default()
        };
        let once = measure(swinging(1.0), &LabanOptions::default());
        let thrice = measure(swinging(1.0), &heavy);
        let weight =
            component(&thrice, Component::Weight) - component(&once, Component::Weight) * 3.0;
        assert!(largest(weight) < 1e-6);
        assert_eq!(largest(thrice.narrow(2, 1, 3) - once.narrow(2, 1, 3)), 0.0);
    }
}
