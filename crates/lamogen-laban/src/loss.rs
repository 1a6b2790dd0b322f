//! How far a motion's features are from what is asked for.

use burn::tensor::{Tensor, TensorData};

use crate::tags::{COMPONENTS, Component, Scale};

/// Keeps the relative loss finite where the baseline rests (paper, appendix "Hyperparameters").
const DELTA: f32 = 1e-6;

/// What differences are divided by in the relative loss.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Divisor {
    /// The baseline's value at the same frame (paper, equation "Laban loss"). Frames where the
    /// baseline rests weigh most.
    #[default]
    Frame,
    /// The baseline's mean over the motion's frames, per component. All frames weigh alike.
    Mean,
}

/// The features to reach: the baseline's, scaled; and the relative loss towards them.
#[derive(Clone, Debug)]
pub struct Target {
    features: Tensor<3>,
    weight: Tensor<3>,
}

impl Target {
    /// The target of each motion of a batch: `scale ⊙ baseline` (paper, section "Step 1").
    ///
    /// `emphasis` weighs components that a scale changes in the loss; the others weigh 1.
    ///
    /// # Shapes
    ///
    /// - `baseline`: `[batch, frames, 4]`, with 0 past each motion's length
    /// - `lengths`: frames of each motion
    /// - `scales`: one for each motion
    ///
    /// # Panics
    ///
    /// If the numbers of motions differ.
    pub fn new(
        baseline: Tensor<3>,
        lengths: &[usize],
        scales: &[Scale],
        divisor: Divisor,
        emphasis: f32,
    ) -> Target {
        let [batch, frames, _] = baseline.dims();
        assert_eq!([lengths.len(), scales.len()], [batch, batch]);
        let device = baseline.device();
        let row = |value: &dyn Fn(&Scale, Component) -> f32| {
            let values: Vec<f32> = scales
                .iter()
                .flat_map(|scale| Component::ALL.map(|component| value(scale, component)))
                .collect();
            Tensor::<3>::from_data(TensorData::new(values, [batch, 1, COMPONENTS]), &device)
        };
        let scale = row(&|scale, component| scale.of(component));
        // The loss is squared, so the weight enters as its root.
        let emphasis = row(&|scale, component| match scale.changes(component) {
            true => emphasis.sqrt(),
            false => 1.0,
        });
        let divisor = match divisor {
            Divisor::Frame => baseline.clone(),
            Divisor::Mean => {
                let lengths: Vec<f32> = lengths.iter().map(|&length| length as f32).collect();
                let lengths = TensorData::new(lengths, [batch, 1, 1]);
                (baseline.clone().sum_dim(1) / Tensor::from_data(lengths, &device))
                    .repeat_dim(1, frames)
            }
        };
        Target {
            features: baseline * scale,
            weight: emphasis / (divisor + DELTA),
        }
    }

    /// The features to reach `[batch, frames, 4]`.
    pub fn features(&self) -> Tensor<3> {
        self.features.clone()
    }

    /// The Laban loss `Σ ((f - target) / (divisor + δ))²` over frames, per motion and component
    /// (paper, equation "Laban loss"); the sum over components is what guidance lowers.
    ///
    /// # Shapes
    ///
    /// - `features`: `[batch, frames, 4]`, with 0 past each motion's length
    /// - output: `[batch, 4]`
    pub fn loss(&self, features: Tensor<3>) -> Tensor<2> {
        let [batch, _, components] = features.dims();
        ((features - self.features.clone()) * self.weight.clone())
            .square()
            .sum_dim(1)
            .reshape([batch, components])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::features::{LabanFeatures, LabanOptions};
    use burn::tensor::Device;
    use lamogen_motion::JOINTS;

    fn scale(factors: [f32; COMPONENTS]) -> Scale {
        Scale::new(factors).unwrap()
    }

    #[test]
    fn a_relative_loss_is_known_by_hand() {
        let baseline = Tensor::<3>::from([[[2.0, 1.0, 1.0, 4.0], [2.0, 1.0, 1.0, 8.0]]]);
        let scales = [scale([1.5, 1.0, 1.0, 0.5])];
        for (divisor, shape) in [(Divisor::Frame, 0.5), (Divisor::Mean, 20.0 / 36.0)] {
            let target = Target::new(baseline.clone(), &[2], &scales, divisor, 1.0);
            let loss = target.loss(baseline.clone()).into_data();
            let loss = loss.as_slice::<f32>().unwrap();
            // Weight is 1 from 3 of 2 at both frames: 2 · (1/2)².
            for (loss, expected) in loss.iter().zip([0.5, 0.0, 0.0, shape]) {
                assert!((loss - expected).abs() < 1e-5, "{divisor:?}: {loss}");
            }
        }
    }

    #[test]
    fn emphasis_weighs_what_the_scale_changes() {
        let baseline = Tensor::<3>::from([[[2.0, 1.0, 1.0, 4.0]]]);
        let scales = [scale([1.5, 1.0, 1.0, 1.0])];
        let loss = |emphasis| {
            Target::new(baseline.clone(), &[1], &scales, Divisor::Frame, emphasis)
                .loss(baseline.clone() * 2.0)
                .into_data()
                .try_to_vec::<f32>()
                .unwrap()
        };
        let (plain, heavy) = (loss(1.0), loss(10.0));
        assert!((heavy[0] / plain[0] - 10.0).abs() < 1e-3);
        assert_eq!(heavy[1..], plain[1..]);
    }

    #[test]
    fn a_resting_baseline_keeps_the_loss_finite() {
        let still = Tensor::<3>::zeros([1, 5, COMPONENTS], &Device::flex());
        let target = Target::new(still.clone(), &[5], &[Scale::NEUTRAL], Divisor::Frame, 1.0);
        assert_eq!(target.loss(still).sum().into_scalar::<f32>(), 0.0);
    }

    #[test]
    fn gradients_agree_with_finite_differences() {
        let device = Device::flex();
        let frames = 12;
        let wave = |t: usize, j: usize, axis: usize| {
            let phase = (3 * j + axis) as f32;
            (phase * 1.3).sin() + 0.2 * (0.5 * t as f32 + phase).sin()
        };
        let positions: Vec<f32> = (0..frames * JOINTS * 3)
            .map(|i| wave(i / (JOINTS * 3), i / 3 % JOINTS, i % 3))
            .collect();
        let joints = |positions: &[f32]| {
            let data = TensorData::new(positions.to_vec(), [1, frames, JOINTS, 3]);
            Tensor::<4>::from_data(data, &device)
        };
        let features = LabanFeatures::new(&LabanOptions::default(), frames, &[frames], &device);
        let scales = [scale([1.5, 0.8, 1.2, 0.5])];
        for divisor in [Divisor::Frame, Divisor::Mean] {
            let baseline = features.measure(joints(&positions));
            let target = Target::new(baseline, &[frames], &scales, divisor, 2.0);
            let loss = |joints: Tensor<4>| target.loss(features.measure(joints)).sum();

            let leaf = joints(&positions).autodiff().require_grad();
            let gradient = leaf.grad(&loss(leaf.clone()).backward()).unwrap();
            let gradient = gradient.into_data().try_to_vec::<f32>().unwrap();
            let largest = gradient.iter().fold(0.0f32, |m, g| m.max(g.abs()));
            // Wrists, head and a foot; knees count for Shape alone.
            for joint in [20, 21, 15, 10, 4] {
                for (frame, axis) in [(0, 0), (5, 1), (11, 2)] {
                    let index = (frame * JOINTS + joint) * 3 + axis;
                    let step = 1e-3;
                    let at = |offset: f32| {
                        let mut moved = positions.clone();
                        moved[index] += offset;
                        f64::from(loss(joints(&moved)).into_scalar::<f32>())
                    };
                    let numeric = ((at(step) - at(-step)) / (2.0 * f64::from(step))) as f32;
                    let error = (numeric - gradient[index]).abs() / largest;
                    assert!(
                        error < 5e-3,
                        "joint {joint}, frame {frame}: {numeric} {}",
                        gradient[index]
                    );
                }
            }
        }
    }
}
