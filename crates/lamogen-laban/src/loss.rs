//! The relative loss between a motion's Laban features and their targets.

use burn::tensor::{Tensor, TensorData};

use crate::goal::Goal;
use crate::series::mean;
use crate::tags::{COMPONENTS, Component};

/// The number δ that is added to divisors, so that the relative loss is finite where the baseline is at rest
/// (paper, appendix "Hyperparameters").
const DELTA: f32 = 1e-6;

/// The divisor of differences in the relative loss.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LossDivisor {
    /// The baseline's value at the same frame (paper, equation "Laban loss"). Frames at which the
    /// baseline is at rest have the largest weights.
    #[default]
    Frame,
    /// The baseline's mean over the motion's frames, per component. All frames have the same weight.
    Mean,
}

/// The features to reach, usually the baseline's times a scale, with the weights of the relative loss.
#[derive(Clone, Debug)]
pub struct LabanTarget {
    features: Tensor<3>,
    weight: Tensor<3>,
}

impl LabanTarget {
    /// Computes the target of each motion of a batch. For a factor it is `scale(t) ⊙ baseline(t)` at every frame t
    /// (paper, section "Step 1", where the scale is the same at all frames); for other goals see [`Goal`].
    ///
    /// `emphasis` is the weight of each component in the loss. It holds at all frames of a motion whose goal asks for a
    /// change of the component at any time. Components that keep the baseline have the weight 1, and those with
    /// [`Goal::Any`] the weight 0. For a target that is no multiple of the baseline, the divisor is the larger of
    /// target and baseline.
    ///
    /// # Shapes
    ///
    /// - `baseline`: `[batch, frames, 4]`, with 0 past each motion's length
    /// - `lengths`: the number of frames of each motion
    /// - `goals`: the goals of each motion's components
    ///
    /// # Panics
    ///
    /// If `baseline`, `lengths` and `goals` differ in the number of motions, or a series has fewer than 4 values.
    pub fn new(
        baseline: Tensor<3>,
        lengths: &[usize],
        goals: &[[Goal; COMPONENTS]],
        divisor: LossDivisor,
        emphasis: [f32; COMPONENTS],
    ) -> LabanTarget {
        let [batch, frames, _] = baseline.dims();
        assert_eq!([lengths.len(), goals.len()], [batch, batch]);
        let device = baseline.device();
        let measured: Vec<f32> = baseline.try_into_vec_as().expect("floats convert to f32");
        let (mut features, mut weights) = (measured.clone(), vec![0.0; measured.len()]);
        for (motion, (&length, goals)) in lengths.iter().zip(goals).enumerate() {
            for (component, goal) in Component::ALL.into_iter().zip(goals) {
                let index = |frame| (motion * frames + frame) * COMPONENTS + component.index();
                let before: Vec<f32> = (0..length).map(|frame| measured[index(frame)]).collect();
                let target = goal.target(component, &before);
                let emphasis = emphasis[component.index()];
                let rows = goal.weights(&before, &target, divisor, emphasis);
                for (frame, (value, weight)) in target.into_iter().zip(rows).enumerate() {
                    features[index(frame)] = value;
                    weights[index(frame)] = weight;
                }
            }
        }
        let tensor = |values| {
            let data = TensorData::new(values, [batch, frames, COMPONENTS]);
            Tensor::<3>::from_data(data, &device)
        };
        LabanTarget {
            features: tensor(features),
            weight: tensor(weights),
        }
    }

    /// Returns the features to reach, `[batch, frames, 4]`.
    pub fn features(&self) -> Tensor<3> {
        self.features.clone()
    }

    /// Returns the weights of differences from the target, `[batch, frames, 4]`. A difference is multiplied by its
    /// weight before it is squared.
    pub fn weight(&self) -> Tensor<3> {
        self.weight.clone()
    }

    /// Computes the Laban loss `Σ ((f - target) / (divisor + δ))²` over frames, per motion and component
    /// (paper, equation "Laban loss"). Guidance lowers the sum over components.
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

impl Goal {
    /// Computes the weight of the difference from the target at each frame. The difference is multiplied by its weight
    /// before it is squared.
    pub(crate) fn weights(
        &self,
        baseline: &[f32],
        target: &[f32],
        divisor: LossDivisor,
        emphasis: f32,
    ) -> Vec<f32> {
        // The weight is squared in the loss, so that the root of the emphasis enters it.
        let root = match self {
            Goal::Any => return vec![0.0; baseline.len()],
            Goal::InTurn(turns) => {
                let turns = Goal::turns(turns, baseline.len()).into_iter();
                let weights = turns.flat_map(|(frames, turn)| {
                    let values = (&baseline[frames.clone()], &target[frames.clone()]);
                    let weights = turn.goal.weights(values.0, values.1, divisor, emphasis);
                    let shares = turn.shares(frames.len());
                    let pairs = weights.into_iter().zip(shares);
                    pairs
                        .map(|(weight, share)| weight * share)
                        .collect::<Vec<f32>>()
                });
                return weights.collect();
            }
            goal if goal.changes() => emphasis.sqrt(),
            _ => 1.0,
        };
        let is_multiple = !matches!(self, Goal::Series(_));
        let choose = |baseline: f32, target: f32| match is_multiple {
            true => baseline,
            false => baseline.max(target),
        };
        let pairs = baseline.iter().zip(target);
        let divisors: Vec<f32> = match divisor {
            LossDivisor::Frame => pairs.map(|(b, t)| choose(*b, *t)).collect(),
            LossDivisor::Mean => {
                let means = [baseline, target].map(|values| mean(values.iter().copied()));
                vec![choose(means[0], means[1]); baseline.len()]
            }
        };
        let weights = divisors.into_iter().map(|divisor| root / (divisor + DELTA));
        weights.collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::ScaleCurve;
    use crate::factor::Factor;
    use crate::features::{LabanFeatures, LabanOptions};
    use crate::tags::Scale;
    use burn::tensor::Device;
    use lamogen_motion::JOINTS;

    type ComponentGoals = [Goal; COMPONENTS];

    fn goals(scale: ScaleCurve) -> ComponentGoals {
        Component::ALL.map(|component| scale.of(component).clone().into())
    }

    fn scale(factors: [f32; COMPONENTS]) -> ComponentGoals {
        goals(Scale::new(factors).unwrap().into())
    }

    fn factor_over_time(component: Component, text: &str) -> ComponentGoals {
        let factor = Factor::parse(component, text).unwrap();
        goals(ScaleCurve::default().with(component, factor))
    }

    #[test]
    fn the_relative_loss_agrees_with_a_calculation_by_hand() {
        let baseline = Tensor::<3>::from([[[2.0, 1.0, 1.0, 4.0], [2.0, 1.0, 1.0, 8.0]]]);
        let scales = [scale([1.5, 1.0, 1.0, 0.5])];
        for (divisor, shape) in [(LossDivisor::Frame, 0.5), (LossDivisor::Mean, 20.0 / 36.0)] {
            let target =
                LabanTarget::new(baseline.clone(), &[2], &scales, divisor, [1.0; COMPONENTS]);
            let loss = target.loss(baseline.clone()).into_data();
            let loss = loss.as_slice::<f32>().unwrap();
            // Weight is 2 where 3 is asked for, at both frames: 2 · (1/2)².
            for (loss, expected) in loss.iter().zip([0.5, 0.0, 0.0, shape]) {
                assert!((loss - expected).abs() < 1e-5, "{divisor:?}: {loss}");
            }
        }
    }

    /// Computes the loss of twice the baseline, with an emphasis of 1 and of 10.
    fn losses_by_emphasis(
        baseline: &Tensor<3>,
        goals: &[ComponentGoals],
        divisor: LossDivisor,
    ) -> [Vec<f32>; 2] {
        [1.0, 10.0].map(|emphasis| {
            let lengths = [baseline.dims()[1]];
            let emphasis = [emphasis; COMPONENTS];
            let target = LabanTarget::new(baseline.clone(), &lengths, goals, divisor, emphasis);
            let loss = target.loss(baseline.clone() * 2.0).into_data();
            loss.try_to_vec().unwrap()
        })
    }

    #[test]
    fn emphasis_is_the_weight_of_components_that_change() {
        let baseline = Tensor::<3>::from([[[2.0, 1.0, 1.0, 4.0]]]);
        let scales = [scale([1.5, 1.0, 1.0, 1.0])];
        let [plain, heavy] = losses_by_emphasis(&baseline, &scales, LossDivisor::Frame);
        assert!((heavy[0] / plain[0] - 10.0).abs() < 1e-3);
        assert_eq!(heavy[1..], plain[1..]);
    }

    #[test]
    fn the_target_of_each_motion_follows_its_own_scale_over_time() {
        // 30 frames are 1.5 s; the second motion ends after 1 s.
        let frames = 30;
        let values = (0..2 * frames * COMPONENTS).map(|i| match i / COMPONENTS < frames + 20 {
            true => 1.0 + i as f32,
            false => 0.0,
        });
        let data = TensorData::new(values.collect(), [2, frames, COMPONENTS]);
        let baseline = Tensor::<3>::from_data(data, &Device::flex());
        let scales = [
            factor_over_time(Component::Weight, "0.5:1.5 1:0.5"),
            factor_over_time(Component::Shape, "0:1 ~ 1:2"),
        ];
        let target = LabanTarget::new(
            baseline.clone(),
            &[30, 20],
            &scales,
            LossDivisor::Frame,
            [1.0; COMPONENTS],
        );
        let [target, baseline] =
            [target.features(), baseline].map(|t| t.into_data().try_to_vec::<f32>().unwrap());
        for (i, (target, before)) in target.iter().zip(&baseline).enumerate() {
            let (motion, frame, component) = (
                i / frames / COMPONENTS,
                i / COMPONENTS % frames,
                i % COMPONENTS,
            );
            let factor = match (motion, component) {
                (0, 0) => [1.0, 1.5, 0.5][frame / 10],
                (1, 3) => 1.0 + (frame as f32 / 20.0).min(1.0),
                _ => 1.0,
            };
            let error = (target - before * factor).abs();
            assert!(
                error <= 1e-5 * before,
                "{motion} {frame} {component}: {target}"
            );
        }
    }

    #[test]
    fn a_change_at_any_time_is_emphasised_at_all_frames() {
        let baseline = Tensor::<3>::ones([1, 40, COMPONENTS], &Device::flex());
        let scales = [factor_over_time(Component::Time, "1:1.2")];
        let [plain, heavy] = losses_by_emphasis(&baseline, &scales, LossDivisor::Mean);
        // Half the frames ask for 1, the other half for 1.2, and all are at 2.
        assert!(
            (plain[1] - 20.0 * (1.0 + 0.8 * 0.8)).abs() < 1e-3,
            "{plain:?}"
        );
        assert!((heavy[1] / plain[1] - 10.0).abs() < 1e-3);
        assert_eq!(
            [heavy[0], heavy[2], heavy[3]],
            [plain[0], plain[2], plain[3]]
        );
    }

    #[test]
    fn a_target_that_is_no_multiple_is_compared_relative_to_the_larger_value() {
        let baseline = Tensor::<3>::ones([1, 4, COMPONENTS], &Device::flex());
        let mut goals = goals(ScaleCurve::default());
        goals[Component::Shape.index()] = Goal::Series(vec![3.0; 4]);
        goals[Component::Time.index()] = Goal::Any;
        for divisor in [LossDivisor::Frame, LossDivisor::Mean] {
            let target = LabanTarget::new(
                baseline.clone(),
                &[4],
                &[goals.clone()],
                divisor,
                [2.0; COMPONENTS],
            );
            let loss = target.loss(baseline.clone() * 2.0).into_data();
            let loss = loss.as_slice::<f32>().unwrap();
            // Shape is 2 where 3 is asked for, the divisor is 3 and the emphasis 2: 4 · 2 · (1/3)². Time may take any
            // value.
            for (found, expected) in loss.iter().zip([4.0, 0.0, 4.0, 8.0 / 9.0]) {
                assert!((found - expected).abs() < 1e-5, "{loss:?}");
            }
        }
    }

    #[test]
    fn a_resting_baseline_keeps_the_loss_finite() {
        let still = Tensor::<3>::zeros([1, 5, COMPONENTS], &Device::flex());
        let target = LabanTarget::new(
            still.clone(),
            &[5],
            &[goals(ScaleCurve::default())],
            LossDivisor::Frame,
            [1.0; COMPONENTS],
        );
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
        for divisor in [LossDivisor::Frame, LossDivisor::Mean] {
            let baseline = features.measure(joints(&positions));
            let target = LabanTarget::new(baseline, &[frames], &scales, divisor, [2.0; COMPONENTS]);
            let loss = |joints: Tensor<4>| target.loss(features.measure(joints)).sum();

            let leaf = joints(&positions).autodiff().require_grad();
            let gradient = leaf.grad(&loss(leaf.clone()).backward()).unwrap();
            let gradient = gradient.into_data().try_to_vec::<f32>().unwrap();
            let largest = gradient.iter().fold(0.0f32, |m, g| m.max(g.abs()));
            // These are wrists, head and a foot, and a knee, which only Shape depends on.
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
