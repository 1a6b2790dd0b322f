//! How far a motion's features are from what is asked for.

use burn::tensor::{Tensor, TensorData};

use crate::goals::Goal;
use crate::series::mean;
use crate::tags::{COMPONENTS, Component};

/// Keeps the relative loss finite where the baseline rests (paper, appendix "Hyperparameters").
const DELTA: f32 = 1e-6;

/// What differences are divided by in the relative loss.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LossDivisor {
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
    /// The target of each motion of a batch: `scale(t) ⊙ baseline(t)` at every frame t (paper, section
    /// "Step 1", where the scale is the same at all frames), or what else its goals say.
    ///
    /// `emphasis` weighs components in the loss that shall change at any moment, at all frames, each its own; the
    /// others weigh 1, and those that may be anything 0. Differences from a target that is no multiple of the baseline are divided by
    /// the larger of both.
    ///
    /// # Shapes
    ///
    /// - `baseline`: `[batch, frames, 4]`, with 0 past each motion's length
    /// - `lengths`: frames of each motion
    /// - `goals`: those of each motion's components
    ///
    /// # Panics
    ///
    /// If the numbers of motions differ, or a series has fewer than 4 values.
    pub fn new(
        baseline: Tensor<3>,
        lengths: &[usize],
        goals: &[[Goal; COMPONENTS]],
        divisor: LossDivisor,
        emphasis: [f32; COMPONENTS],
    ) -> Target {
        let [batch, frames, _] = baseline.dims();
        assert_eq!([lengths.len(), goals.len()], [batch, batch]);
        let device = baseline.device();
        let measured: Vec<f32> = baseline.try_into_vec_as().expect("floats convert to f32");
        let (mut features, mut weights) = (measured.clone(), vec![0.0; measured.len()]);
        for (motion, (&length, goals)) in lengths.iter().zip(goals).enumerate() {
            for (component, goal) in Component::ALL.into_iter().zip(goals) {
                let place = |frame| (motion * frames + frame) * COMPONENTS + component.index();
                let before: Vec<f32> = (0..length).map(|frame| measured[place(frame)]).collect();
                let asked = goal.target(component, &before);
                let emphasis = emphasis[component.index()];
                let rows = goal.weights(&before, &asked, divisor, emphasis);
                for (frame, (asked, weight)) in asked.into_iter().zip(rows).enumerate() {
                    features[place(frame)] = asked;
                    weights[place(frame)] = weight;
                }
            }
        }
        let tensor = |values| {
            let data = TensorData::new(values, [batch, frames, COMPONENTS]);
            Tensor::<3>::from_data(data, &device)
        };
        Target {
            features: tensor(features),
            weight: tensor(weights),
        }
    }

    /// The features to reach `[batch, frames, 4]`.
    pub fn features(&self) -> Tensor<3> {
        self.features.clone()
    }

    /// What differences from the target are multiplied by before they are squared, `[batch, frames, 4]`.
    pub fn weight(&self) -> Tensor<3> {
        self.weight.clone()
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

impl Goal {
    /// What the difference from the target is multiplied by at each frame, before it is squared.
    fn weights(
        &self,
        baseline: &[f32],
        target: &[f32],
        divisor: LossDivisor,
        emphasis: f32,
    ) -> Vec<f32> {
        // The loss is squared, so the weight enters as its root.
        let root = match self {
            Goal::Any => return vec![0.0; baseline.len()],
            goal if goal.changes() => emphasis.sqrt(),
            _ => 1.0,
        };
        let is_multiple = !matches!(self, Goal::Series(_));
        let larger = |before: f32, asked: f32| match is_multiple {
            true => before,
            false => before.max(asked),
        };
        let divisors = baseline.iter().zip(target);
        let divisors: Vec<f32> = match divisor {
            LossDivisor::Frame => divisors.map(|(b, t)| larger(*b, *t)).collect(),
            LossDivisor::Mean => {
                let [before, asked] = [baseline, target].map(|values| mean(values.iter().copied()));
                vec![larger(before, asked); baseline.len()]
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

    type Goals = [Goal; COMPONENTS];

    fn goals(scale: ScaleCurve) -> Goals {
        Component::ALL.map(|component| scale.of(component).clone().into())
    }

    fn scale(factors: [f32; COMPONENTS]) -> Goals {
        goals(Scale::new(factors).unwrap().into())
    }

    fn over_time(component: Component, text: &str) -> Goals {
        let factor = Factor::parse(component, text).unwrap();
        goals(ScaleCurve::default().with(component, factor))
    }

    #[test]
    fn a_relative_loss_is_known_by_hand() {
        let baseline = Tensor::<3>::from([[[2.0, 1.0, 1.0, 4.0], [2.0, 1.0, 1.0, 8.0]]]);
        let scales = [scale([1.5, 1.0, 1.0, 0.5])];
        for (divisor, shape) in [(LossDivisor::Frame, 0.5), (LossDivisor::Mean, 20.0 / 36.0)] {
            let target = Target::new(baseline.clone(), &[2], &scales, divisor, [1.0; COMPONENTS]);
            let loss = target.loss(baseline.clone()).into_data();
            let loss = loss.as_slice::<f32>().unwrap();
            // Weight is 1 from 3 of 2 at both frames: 2 · (1/2)².
            for (loss, expected) in loss.iter().zip([0.5, 0.0, 0.0, shape]) {
                assert!((loss - expected).abs() < 1e-5, "{divisor:?}: {loss}");
            }
        }
    }

    /// The loss of twice the baseline, with an emphasis of 1 and of 10.
    fn emphasised(baseline: &Tensor<3>, goals: &[Goals], divisor: LossDivisor) -> [Vec<f32>; 2] {
        [1.0, 10.0].map(|emphasis| {
            let lengths = [baseline.dims()[1]];
            let emphasis = [emphasis; COMPONENTS];
            let target = Target::new(baseline.clone(), &lengths, goals, divisor, emphasis);
            let loss = target.loss(baseline.clone() * 2.0).into_data();
            loss.try_to_vec().unwrap()
        })
    }

    #[test]
    fn emphasis_weighs_what_the_scale_changes() {
        let baseline = Tensor::<3>::from([[[2.0, 1.0, 1.0, 4.0]]]);
        let scales = [scale([1.5, 1.0, 1.0, 1.0])];
        let [plain, heavy] = emphasised(&baseline, &scales, LossDivisor::Frame);
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
            over_time(Component::Weight, "0.5:1.5 1:0.5"),
            over_time(Component::Shape, "0:1 ~ 1:2"),
        ];
        let target = Target::new(
            baseline.clone(),
            &[30, 20],
            &scales,
            LossDivisor::Frame,
            [1.0; COMPONENTS],
        );
        let [asked, baseline] =
            [target.features(), baseline].map(|t| t.into_data().try_to_vec::<f32>().unwrap());
        for (i, (asked, before)) in asked.iter().zip(&baseline).enumerate() {
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
            let error = (asked - before * factor).abs();
            assert!(
                error <= 1e-5 * before,
                "{motion} {frame} {component}: {asked}"
            );
        }
    }

    #[test]
    fn a_change_at_any_moment_is_emphasised_at_all() {
        let baseline = Tensor::<3>::ones([1, 40, COMPONENTS], &Device::flex());
        let scales = [over_time(Component::Time, "1:1.2")];
        let [plain, heavy] = emphasised(&baseline, &scales, LossDivisor::Mean);
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
    fn a_target_that_is_no_multiple_is_held_against_the_larger_of_both() {
        let baseline = Tensor::<3>::ones([1, 4, COMPONENTS], &Device::flex());
        let mut asked = goals(ScaleCurve::default());
        asked[Component::Shape.index()] = Goal::Series(vec![3.0; 4]);
        asked[Component::Time.index()] = Goal::Any;
        for divisor in [LossDivisor::Frame, LossDivisor::Mean] {
            let target = Target::new(
                baseline.clone(),
                &[4],
                &[asked.clone()],
                divisor,
                [2.0; COMPONENTS],
            );
            let loss = target.loss(baseline.clone() * 2.0).into_data();
            let loss = loss.as_slice::<f32>().unwrap();
            // Shape is 2 of 3, of 3, with twice the weight; Time may be anything.
            for (found, expected) in loss.iter().zip([4.0, 0.0, 4.0, 8.0 / 9.0]) {
                assert!((found - expected).abs() < 1e-5, "{loss:?}");
            }
        }
    }

    #[test]
    fn a_resting_baseline_keeps_the_loss_finite() {
        let still = Tensor::<3>::zeros([1, 5, COMPONENTS], &Device::flex());
        let target = Target::new(
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
            let target = Target::new(baseline, &[frames], &scales, divisor, [2.0; COMPONENTS]);
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
