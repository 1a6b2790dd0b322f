//! The Laban loss of one motion in main memory, with its gradient.
//!
//! ```text
//! joints ──smooth──▶ positions ──difference──▶ velocity ──difference──▶ acceleration ──difference──▶ jerk
//!                        │ box                     │ energy                 │ norm                    │ norm
//!                        ▼                         ▼                        ▼                         ▼
//!                      Shape                     Weight                   Time                      Flow
//! ```
//!
//! The gradient goes the same way back. Fits of bodies need it hundreds of times a motion; going through a tensor library's
//! autodiff would take most of their time.

use lamogen_motion::JOINTS;

use crate::features::{LabanOptions, ORDERS, SQUARED_NORM_OFFSET};
use crate::smoothing::{GaussianKernel, Smoothing};
use crate::tags::{COMPONENTS, Component};

/// The numbers of a frame of joint positions.
const WIDTH: usize = 3 * JOINTS;

/// The Laban loss of one motion, as a function of its joints: what [`LabanFeatures`](crate::LabanFeatures) and
/// [`LabanTarget`](crate::LabanTarget) compute for batches of tensors, in 64 bits and with a gradient by hand.
#[derive(Clone, Debug)]
pub struct MotionLoss {
    /// The weights of the smoothing of positions, velocity and acceleration; none where nothing is smoothed.
    kernels: [Option<Vec<f64>>; ORDERS],
    /// The index and the mass of each end-effector.
    effectors: Vec<(usize, f64)>,
    target: Vec<[f64; COMPONENTS]>,
    weight: Vec<[f64; COMPONENTS]>,
    /// The direction of the motion in the room, in radians.
    heading: f64,
    /// The travel of a cycle in metres, if the motion is a loop.
    loop_travel: Option<[f64; 3]>,
}

/// A table with a row for each frame.
#[derive(Clone, Debug)]
struct Series {
    width: usize,
    values: Vec<f64>,
}

impl MotionLoss {
    /// Creates the loss of a motion.
    ///
    /// # Shapes
    ///
    /// - `target`: the features to reach at each frame, `[Weight, Time, Flow, Shape]`
    /// - `weight`: the factor on each difference before it is squared
    ///
    /// # Panics
    ///
    /// If target and weight differ in length.
    pub fn new(
        options: &LabanOptions,
        target: &[[f32; COMPONENTS]],
        weight: &[[f32; COMPONENTS]],
    ) -> MotionLoss {
        assert_eq!(target.len(), weight.len(), "a weight for every target");
        let kernel = |gaussian: &GaussianKernel| {
            let weights = gaussian.kernel().into_iter().map(f64::from);
            Some(weights.collect())
        };
        let kernels = match &options.smoothing {
            Smoothing::None => [None, None, None],
            Smoothing::Positions(gaussian) => [kernel(gaussian), None, None],
            Smoothing::EachDifference(gaussian) => std::array::from_fn(|_| kernel(gaussian)),
        };
        let effectors = &options.end_effectors;
        let masses = effectors.masses().map(f64::from);
        let wide = |rows: &[[f32; COMPONENTS]]| rows.iter().map(|row| row.map(f64::from)).collect();
        MotionLoss {
            kernels,
            effectors: { effectors.joints().map(|joint| joint.index()) }
                .zip(masses)
                .collect(),
            target: wide(target),
            weight: wide(weight),
            heading: 0.0,
            loop_travel: None,
        }
    }

    /// Sets the direction in which the motion's own +Z points in the room, as in
    /// [`LabanFeatures::with_heading`](crate::LabanFeatures::with_heading).
    pub fn with_heading(self, heading: f32) -> MotionLoss {
        MotionLoss {
            heading: f64::from(heading),
            ..self
        }
    }

    /// Makes the motion a loop, which moves by `travel` in metres, `[x, y, z]`, from cycle to cycle: its first frame follows its last
    /// one. Target and weight are then those of a motion that has been going on, as measured in the middle of several cycles.
    pub fn set_loop_travel(&mut self, travel: [f64; 3]) {
        self.loop_travel = Some(travel);
    }

    /// Returns the loss of each component, and adds the gradient of their sum to `gradient`.
    ///
    /// # Shapes
    ///
    /// - `joints`: positions in metres, `[frames][joint]`
    /// - `gradient`: the same
    ///
    /// # Panics
    ///
    /// If joints or gradient have not as many frames as the target.
    pub fn evaluate(
        &self,
        joints: &[[[f32; 3]; JOINTS]],
        gradient: &mut [[[f64; 3]; JOINTS]],
    ) -> [f64; COMPONENTS] {
        let frames = self.target.len();
        assert_eq!([joints.len(), gradient.len()], [frames, frames]);
        let beside = self.frames_beside();
        let mut positions = Series::zeros(frames + 2 * beside, WIDTH);
        for row in 0..positions.frames() {
            let (frame, travel) = self.source(row);
            let points = positions.row_mut(row).as_chunks_mut::<3>().0;
            for (point, own) in points.iter_mut().zip(&joints[frame]) {
                *point = std::array::from_fn(|axis| f64::from(own[axis]) + travel[axis]);
            }
        }
        let smoothed = self.smooth(0, &positions);
        let mut losses = [0.0; COMPONENTS];
        let mut smoothed_gradient = Series::zeros(positions.frames(), WIDTH);
        losses[Component::Shape.index()] = self.add_shape(&smoothed, &mut smoothed_gradient);
        self.add_efforts(&smoothed, &mut losses, &mut smoothed_gradient);
        let pulled = self.pull_smoothing(0, smoothed_gradient);
        for row in 0..pulled.frames() {
            let (frame, _) = self.source(row);
            let sums = gradient[frame].as_flattened_mut().iter_mut();
            for (sum, value) in sums.zip(pulled.row(row)) {
                *sum += value;
            }
        }
        losses
    }

    /// Returns the number of frames of the cycles before and after that are measured with a loop, so that what smoothing and
    /// differences make of the ends does not reach its own frames; 0 for other motions.
    fn frames_beside(&self) -> usize {
        match self.loop_travel {
            Some(_) => {
                let windows = self.kernels.iter().flatten();
                ORDERS + windows.map(|kernel| kernel.len() / 2).sum::<usize>()
            }
            None => 0,
        }
    }

    /// Returns the frame that a row of the measured positions is, and how far it has moved since.
    fn source(&self, row: usize) -> (usize, [f64; 3]) {
        let Some(travel) = self.loop_travel else {
            return (row, [0.0; 3]);
        };
        let (place, frames) = (
            row as isize - self.frames_beside() as isize,
            self.target.len() as isize,
        );
        let cycle = place.div_euclid(frames) as f64;
        (
            place.rem_euclid(frames) as usize,
            travel.map(|step| cycle * step),
        )
    }

    /// Returns the loss of a feature at a row of the measured positions, and the derivative with respect to the feature.
    fn difference(&self, row: usize, component: Component, feature: f64) -> (f64, f64) {
        let frame = row.checked_sub(self.frames_beside());
        let Some(frame) = frame.filter(|frame| *frame < self.target.len()) else {
            return (0.0, 0.0);
        };
        let weight = self.weight[frame][component.index()];
        let off = (feature - self.target[frame][component.index()]) * weight;
        (off * off, 2.0 * off * weight)
    }

    /// Returns the loss of Shape, and adds its gradient with respect to the smoothed positions.
    fn add_shape(&self, positions: &Series, gradient: &mut Series) -> f64 {
        let mut sum = 0.0;
        let (sin, cos) = self.heading.sin_cos();
        for frame in 0..positions.frames() {
            let mut row = [0.0; WIDTH];
            row.copy_from_slice(positions.row(frame));
            for point in row.as_chunks_mut::<3>().0 {
                let [x, _, z] = *point;
                (point[0], point[2]) = (x * cos + z * sin, z * cos - x * sin);
            }
            // The numbers of the joints at both ends of the box along each axis.
            let mut ends = [[0; 2]; 3];
            for (axis, [low, high]) in ends.iter_mut().enumerate() {
                [*low, *high] = [axis; 2];
                for place in (axis..WIDTH).step_by(3) {
                    if row[place] < row[*low] {
                        *low = place;
                    }
                    // A place that is not a number is one end, so that the volume is none either.
                    if row[place] > row[*high] || row[place].is_nan() {
                        *high = place;
                    }
                }
            }
            let side = ends.map(|[low, high]| row[high] - row[low]);
            let volume = side[0] * side[1] * side[2];
            let (loss, slope) = self.difference(frame, Component::Shape, volume);
            sum += loss;
            // The directions of the box's axes, in the motion's own.
            let axes = [[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]];
            let gradient = gradient.row_mut(frame).as_chunks_mut::<3>().0;
            for (axis, [low, high]) in ends.into_iter().enumerate() {
                let share = slope * side[(axis + 1) % 3] * side[(axis + 2) % 3];
                for own in 0..3 {
                    gradient[high / 3][own] += share * axes[axis][own];
                    gradient[low / 3][own] -= share * axes[axis][own];
                }
            }
        }
        sum
    }

    /// Adds the losses of Weight, Time and Flow, and their gradient with respect to the smoothed positions.
    fn add_efforts(
        &self,
        positions: &Series,
        losses: &mut [f64; COMPONENTS],
        gradient: &mut Series,
    ) {
        let frames = positions.frames();
        let width = 3 * self.effectors.len();
        let mut series = Series::zeros(frames, width);
        for frame in 0..frames {
            let (from, to) = (positions.row(frame), series.row_mut(frame));
            for (&(joint, _), to) in self.effectors.iter().zip(to.as_chunks_mut::<3>().0) {
                to.copy_from_slice(&from[3 * joint..3 * joint + 3]);
            }
        }
        // The gradients with respect to velocity, acceleration and jerk.
        let mut slopes = Vec::with_capacity(ORDERS);
        for (order, component) in Component::EFFORTS.into_iter().enumerate() {
            let rows = frames.saturating_sub(order + 1);
            let smoothed = match order {
                0 => series,
                _ => self.smooth(order, &series),
            };
            series = smoothed.differences();
            let mut slope = Series::zeros(rows, width);
            // The first frames have no difference, and hold 0.
            let known = frames - rows;
            for frame in 0..known {
                losses[component.index()] += self.difference(frame, component, 0.0).0;
            }
            for row in 0..rows {
                let difference = series.row(row).as_chunks::<3>().0;
                let squared = |v: &[f64; 3]| v.iter().map(|x| x * x).sum::<f64>();
                let size = |&(_, mass): &(usize, f64), v: &[f64; 3]| match component {
                    Component::Weight => mass * squared(v),
                    _ => (squared(v) + f64::from(SQUARED_NORM_OFFSET)).sqrt(),
                };
                let pairs = || self.effectors.iter().zip(difference);
                let effort = pairs().map(|(effector, v)| size(effector, v)).sum();
                let (loss, outer) = self.difference(known + row, component, effort);
                losses[component.index()] += loss;
                let to = slope.row_mut(row).as_chunks_mut::<3>().0;
                for ((effector, v), to) in pairs().zip(to) {
                    let inner = match component {
                        Component::Weight => 2.0 * effector.1,
                        _ => 1.0 / size(effector, v),
                    };
                    *to = v.map(|x| outer * inner * x);
                }
            }
            slopes.push(slope);
        }
        let mut pulled = slopes.pop().expect("there are three differences");
        while let Some(mut slope) = slopes.pop() {
            let order = slopes.len() + 1;
            let rows = frames.saturating_sub(order);
            slope.add(&self.pull_smoothing(order, pulled.pull_differences(rows)));
            pulled = slope;
        }
        let pulled = pulled.pull_differences(frames);
        for frame in 0..frames {
            let to = gradient.row_mut(frame);
            let from = pulled.row(frame).as_chunks::<3>().0;
            for (&(joint, _), from) in self.effectors.iter().zip(from) {
                for (sum, value) in to[3 * joint..].iter_mut().zip(from) {
                    *sum += value;
                }
            }
        }
    }

    /// Smooths the derivative of the given order.
    fn smooth(&self, order: usize, series: &Series) -> Series {
        let Some(kernel) = &self.kernels[order] else {
            return series.clone();
        };
        let mut smoothed = Series::zeros(series.frames(), series.width);
        neighbours(kernel.len(), series.frames(), |frame, neighbour, k| {
            let to = smoothed.row_mut(frame);
            for (to, from) in to.iter_mut().zip(series.row(neighbour)) {
                *to += kernel[k] * from;
            }
        });
        smoothed
    }

    /// Turns the gradient with respect to a smoothed series into that with respect to the series.
    fn pull_smoothing(&self, order: usize, gradient: Series) -> Series {
        let Some(kernel) = &self.kernels[order] else {
            return gradient;
        };
        let mut pulled = Series::zeros(gradient.frames(), gradient.width);
        neighbours(kernel.len(), gradient.frames(), |frame, neighbour, k| {
            let to = pulled.row_mut(neighbour);
            for (to, from) in to.iter_mut().zip(gradient.row(frame)) {
                *to += kernel[k] * from;
            }
        });
        pulled
    }
}

/// Calls `visit` with every frame, the frames of a window around it, and the place in the window. Beyond the ends, the first
/// and the last frame repeat.
fn neighbours(window: usize, frames: usize, mut visit: impl FnMut(usize, usize, usize)) {
    let radius = window / 2;
    for frame in 0..frames {
        for k in 0..window {
            let neighbour = (frame + k).saturating_sub(radius).min(frames - 1);
            visit(frame, neighbour, k);
        }
    }
}

impl Series {
    fn zeros(frames: usize, width: usize) -> Series {
        Series {
            width,
            values: vec![0.0; frames * width],
        }
    }

    fn frames(&self) -> usize {
        self.values.len() / self.width
    }

    fn row(&self, frame: usize) -> &[f64] {
        &self.values[frame * self.width..(frame + 1) * self.width]
    }

    fn row_mut(&mut self, frame: usize) -> &mut [f64] {
        &mut self.values[frame * self.width..(frame + 1) * self.width]
    }

    fn add(&mut self, other: &Series) {
        for (sum, value) in self.values.iter_mut().zip(&other.values) {
            *sum += value;
        }
    }

    /// Returns the differences between neighbouring frames.
    fn differences(&self) -> Series {
        let later = self.values.iter().skip(self.width);
        let values = later
            .zip(&self.values)
            .map(|(later, earlier)| later - earlier);
        Series {
            width: self.width,
            values: values.collect(),
        }
    }

    /// Turns the gradient with respect to differences into that with respect to the `frames` frames.
    fn pull_differences(&self, frames: usize) -> Series {
        let mut pulled = Series::zeros(frames, self.width);
        let later = pulled.values.iter_mut().skip(self.width);
        for (sum, value) in later.zip(&self.values) {
            *sum += value;
        }
        for (sum, value) in pulled.values.iter_mut().zip(&self.values) {
            *sum -= value;
        }
        pulled
    }
}

#[cfg(test)]
mod tests {
    use burn::tensor::{Device, Tensor, TensorData};
    use lamogen_motion::Joint;

    use super::*;
    use crate::effectors::EndEffectors;
    use crate::features::LabanFeatures;

    /// Returns joints of which each swings in a way of its own.
    fn swinging(frames: usize) -> Vec<[[f32; 3]; JOINTS]> {
        let number = |frame: usize, place: usize| {
            let phase = place as f32;
            (0.7 * phase).sin() + 0.1 * (0.2 * frame as f32 * (1.0 + 0.1 * phase) + phase).sin()
        };
        let pose = |frame| {
            std::array::from_fn(|joint| std::array::from_fn(|axis| number(frame, 3 * joint + axis)))
        };
        (0..frames).map(pose).collect()
    }

    /// Returns options with every way of smoothing, and other end-effectors than the default's.
    fn every_option() -> Vec<LabanOptions> {
        let gaussian = GaussianKernel::PAPER;
        let wide = GaussianKernel::new(41, 10.0).unwrap();
        let effectors = [(Joint::LeftWrist, 0.5), (Joint::Head, 3.0)];
        let few = EndEffectors::new(effectors).unwrap();
        let smoothings = [
            Smoothing::None,
            Smoothing::Positions(gaussian),
            Smoothing::Positions(wide),
            Smoothing::EachDifference(gaussian),
        ];
        let options = smoothings.into_iter().flat_map(|smoothing| {
            [EndEffectors::default(), few.clone()].map(|end_effectors| LabanOptions {
                smoothing,
                end_effectors,
            })
        });
        options.collect()
    }

    fn target(frames: usize) -> (Vec<[f32; COMPONENTS]>, Vec<[f32; COMPONENTS]>) {
        let number = |frame: usize, factor: f32| (factor * frame as f32).sin().abs();
        let target =
            |t| std::array::from_fn(|component| 0.1 * number(t, 0.3 * component as f32 + 0.2));
        let weight =
            |t| std::array::from_fn(|component| 3.0 * number(t, 0.5 * component as f32 + 0.1));
        (
            (0..frames).map(target).collect(),
            (0..frames).map(weight).collect(),
        )
    }

    #[test]
    fn value_and_gradient_are_those_of_the_tensors() {
        let device = Device::flex();
        for frames in [1, 2, 3, 4, 7, 40] {
            let (target, weight) = target(frames);
            let table = |rows: &[[f32; COMPONENTS]]| {
                let data = TensorData::new(rows.as_flattened().to_vec(), [1, frames, COMPONENTS]);
                Tensor::<3>::from_data(data, &device)
            };
            for (place, options) in every_option().into_iter().enumerate() {
                let heading = 0.5 * place as f32;
                let joints = swinging(frames);
                let mut gradient = vec![[[0.0; 3]; JOINTS]; frames];
                let loss = MotionLoss::new(&options, &target, &weight).with_heading(heading);
                let losses = loss.evaluate(&joints, &mut gradient);

                let places = joints.as_flattened().as_flattened().to_vec();
                let data = TensorData::new(places, [1, frames, JOINTS, 3]);
                let leaf = Tensor::<4>::from_data(data, &device)
                    .autodiff()
                    .require_grad();
                let features = LabanFeatures::new(&options, frames, &[frames], &device);
                let features = features.with_heading(heading);
                let off = (features.measure(leaf.clone()) - table(&target).autodiff())
                    * table(&weight).autodiff();
                let expected = off.square().sum_dim(1).reshape([COMPONENTS]);
                let all = leaf.grad(&expected.clone().sum().backward()).unwrap();
                let expected: Vec<f32> = expected.inner().try_into_vec_as().unwrap();
                for (loss, expected) in losses.iter().zip(&expected) {
                    let expected = f64::from(*expected);
                    assert!((loss - expected).abs() < 1e-5 * expected.abs().max(1e-3));
                }
                let all: Vec<f32> = all.try_into_vec_as().unwrap();
                let largest = all.iter().fold(0.0f32, |largest, x| largest.max(x.abs()));
                let own = gradient.as_flattened().as_flattened();
                for (own, other) in own.iter().zip(&all) {
                    let off = own - f64::from(*other);
                    assert!(
                        off.abs() <= 1e-4 * f64::from(largest),
                        "{options:?}, {frames}"
                    );
                }
            }
        }
    }

    #[test]
    fn the_gradient_is_added_and_agrees_with_finite_differences() {
        let frames = 12;
        let (target, weight) = target(frames);
        let loss = MotionLoss::new(&LabanOptions::default(), &target, &weight);
        let joints = swinging(frames);
        let mut gradient = vec![[[2.0; 3]; JOINTS]; frames];
        loss.evaluate(&joints, &mut gradient);
        let value = |step: f32| {
            let mut joints = joints.clone();
            joints[5][Joint::LeftWrist.index()][1] += step;
            let mut gradient = vec![[[0.0; 3]; JOINTS]; frames];
            loss.evaluate(&joints, &mut gradient).iter().sum::<f64>()
        };
        let slope = (value(1e-3) - value(-1e-3)) / 2e-3;
        let found = gradient[5][Joint::LeftWrist.index()][1] - 2.0;
        assert!(
            (found - slope).abs() < 1e-3 * slope.abs(),
            "{found} {slope}"
        );
    }

    #[test]
    fn a_loop_is_measured_as_in_the_middle_of_its_cycles() {
        let frames = 30;
        let travel = [0.4, 0.0, 1.2];
        let cycle = swinging(frames);
        let (target, weight) = target(frames);
        for options in every_option() {
            let mut own = vec![[[0.0; 3]; JOINTS]; frames];
            let mut loss = MotionLoss::new(&options, &target, &weight);
            loss.set_loop_travel(travel);
            let losses = loss.evaluate(&cycle, &mut own);

            let moved = |pose: &[[f32; 3]; JOINTS], cycles: usize| {
                pose.map(|point| {
                    std::array::from_fn(|axis| point[axis] + (cycles as f64 * travel[axis]) as f32)
                })
            };
            let long: Vec<_> = (0..5 * frames)
                .map(|frame| moved(&cycle[frame % frames], frame / frames))
                .collect();
            let nothing = vec![[0.0; COMPONENTS]; 2 * frames];
            let around = |rows: &[_]| [&nothing, rows, &nothing].concat();
            let mut all = vec![[[0.0; 3]; JOINTS]; 5 * frames];
            let expected = MotionLoss::new(&options, &around(&target), &around(&weight))
                .evaluate(&long, &mut all);
            for (found, expected) in losses.iter().zip(expected) {
                assert!((found - expected).abs() < 1e-4 * expected, "{options:?}");
            }
            let folded = |frame: usize, joint: usize, axis: usize| -> f64 {
                let cycles = (0..5).map(|cycle| all[cycle * frames + frame][joint][axis]);
                cycles.sum()
            };
            let largest = own.as_flattened().as_flattened().iter();
            let largest = largest.fold(0.0, |most: f64, x| most.max(x.abs()));
            for (frame, pose) in own.iter().enumerate() {
                for (joint, point) in pose.iter().enumerate() {
                    for (axis, found) in point.iter().enumerate() {
                        let off = found - folded(frame, joint, axis);
                        assert!(off.abs() < 1e-4 * largest, "{options:?}: {off}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_place_that_is_not_a_number_makes_every_loss_none() {
        let frames = 8;
        let (target, weight) = target(frames);
        let loss = MotionLoss::new(&LabanOptions::default(), &target, &weight);
        let mut joints = swinging(frames);
        joints[3][Joint::LeftWrist.index()][0] = f32::NAN;
        let mut gradient = vec![[[0.0; 3]; JOINTS]; frames];
        let losses = loss.evaluate(&joints, &mut gradient);
        assert!(losses.iter().all(|loss| loss.is_nan()), "{losses:?}");
    }
}
