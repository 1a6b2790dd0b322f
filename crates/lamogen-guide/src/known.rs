//! Frames of a motion that are known before it is generated, such as the end of a motion to go on from.

use std::ops::Range;

use burn::tensor::{Device, Tensor, TensorData};
use lamogen_motion::{FeatureGroup, Normalization, POSE_FEATURES};

/// The number of frames over which what is left of a jump beside known frames is spread: one second.
const SPREAD: usize = 20;

/// The number of frames over which a speed goes on changing as it did in the known frames. Led on for a second, the speed of a body
/// that speeds up at the border would grow by three times its last change, and the body would rush on.
const SPEED_SPREAD: usize = 6;

/// The first or the last frames of a motion, or both, that are known before it is generated.
///
/// At every step of both passes, these frames of the prediction are replaced by the known ones, so that the frames between are
/// made to fit (Lugmayr et al. 2022 for images; for motion MDM, Tevet et al. 2022, section 4.2), and a jump between both is spread
/// over a second. Gradients of guidance do not pass through known frames.
#[derive(Clone, Debug)]
pub struct KnownFrames {
    /// The known frames, normalised, and zeros elsewhere, `[1, frames, features]`.
    values: Tensor<3>,
    /// 1 where a frame is not known, else 0, `[1, frames, 1]`.
    unknown: Tensor<3>,
    /// The known frames at the beginning.
    start: Range<usize>,
    /// The known frames at the end.
    end: Range<usize>,
    /// The known frames with the noise of each step of a pass, and zeros elsewhere; empty before
    /// [`with_noise`](Self::with_noise).
    noisy: Vec<Tensor<3>>,
    /// The transitions between known frames and the frames beside them.
    transitions: Vec<Transition>,
}

impl KnownFrames {
    /// Creates the known frames of a motion with `frames` frames. `start` and `end` are pose features, not normalised.
    ///
    /// # Panics
    ///
    /// If there are more known frames than frames.
    pub fn new(
        frames: usize,
        start: &[[f32; POSE_FEATURES]],
        end: &[[f32; POSE_FEATURES]],
        normalization: &Normalization,
        device: &Device,
    ) -> KnownFrames {
        let between = frames.checked_sub(start.len() + end.len());
        let between = between.expect("a motion is at least as long as its known frames");
        let gap = vec![[0.0; POSE_FEATURES]; between];
        let rows = [start, &gap, end].concat();
        let shape = [1, frames, POSE_FEATURES];
        let rows = TensorData::new(rows.into_flattened(), shape);
        let unknown = (0..frames).map(|frame| {
            let is_known = frame < start.len() || frame >= start.len() + between;
            if is_known { 0.0 } else { 1.0 }
        });
        let unknown: Vec<f32> = unknown.collect();
        let unknown = Tensor::<3>::from_data(TensorData::new(unknown, [1, frames, 1]), device);
        let values = normalization.normalize(Tensor::from_data(rows, device));
        KnownFrames {
            values: values * (1.0 - unknown.clone()),
            unknown,
            start: 0..start.len(),
            end: frames - end.len()..frames,
            noisy: Vec::new(),
            transitions: transitions(start.len(), end.len(), frames, device),
        }
    }

    /// Returns the known frames alone, `[1, known frames, features]`: those of the start, and those of the end.
    pub fn clips(&self) -> [Option<Tensor<3>>; 2] {
        [&self.start, &self.end].map(|frames| {
            (!frames.is_empty()).then(|| self.values.clone().narrow(1, frames.start, frames.len()))
        })
    }

    /// Sets the noisy known frames of each step of a pass ([`Sampler::invert`](crate::Sampler::invert)), `[1, known frames,
    /// features]`, of the clips of the start and of the end.
    pub fn with_noise(mut self, noisy: [Option<Vec<Tensor<3>>>; 2]) -> Self {
        let [start, end] = noisy;
        let steps = [&start, &end].into_iter().flatten().map(Vec::len).max();
        self.noisy = (0..steps.unwrap_or(0))
            .map(|step| {
                let mut all = self.values.zeros_like();
                for (frames, clip) in [(&self.start, &start), (&self.end, &end)] {
                    if let Some(clip) = clip {
                        let [_, _, features] = all.dims();
                        let place = [0..1, frames.clone(), 0..features];
                        all = all.slice_assign(place, clip[step].clone());
                    }
                }
                all
            })
            .collect();
        self
    }

    /// Puts the noisy known frames of a step in the place of those of a pass, `[1, frames, features]`.
    pub(crate) fn at_step(&self, x: Tensor<3>, step: usize) -> Tensor<3> {
        match self.noisy.get(step) {
            Some(noisy) => x * self.unknown.clone() + noisy.clone(),
            None => x,
        }
    }

    /// Puts the known frames in the place of those that are predicted, `[1, frames, features]`.
    pub(crate) fn restore(&self, predicted: Tensor<3>) -> Tensor<3> {
        predicted * self.unknown.clone() + self.values.clone()
    }

    /// Puts the known frames in the place of those that are predicted, `[1, frames, features]`, and leads the frames beside them
    /// on from there.
    pub(crate) fn replace(&self, predicted: Tensor<3>) -> Tensor<3> {
        let replaced = self.restore(predicted);
        { self.transitions.iter() }.fold(replaced.clone(), |motion, transition| {
            motion + transition.change(&replaced)
        })
    }
}

/// Returns 1 for the features that are speeds, and 1 for all others, `[1, 1, features]` each.
fn are_speeds(device: &Device) -> [Tensor<3>; 2] {
    let mut row = [0.0; POSE_FEATURES];
    for group in [
        FeatureGroup::RootYaw,
        FeatureGroup::RootVelocity,
        FeatureGroup::Velocities,
    ] {
        row[group.range()].fill(1.0);
    }
    let row = TensorData::new(row.to_vec(), [1, 1, POSE_FEATURES]);
    let speeds = Tensor::<3>::from_data(row, device);
    [speeds.clone(), 1.0 - speeds]
}

/// Returns the transitions of a motion with known frames at its start and its end.
fn transitions(start: usize, end: usize, frames: usize, device: &Device) -> Vec<Transition> {
    let between = start..frames - end;
    let spread = SPREAD.min(between.len());
    let mut all = Vec::new();
    // A jump of speed needs two frames on either side.
    if start >= 2 && spread >= 2 {
        let beside: Vec<usize> = (start..start + spread).collect();
        all.push(Transition::new(
            [start - 1, start - 2],
            &beside,
            frames,
            device,
        ));
    }
    if end >= 2 && spread >= 2 {
        let beside: Vec<usize> = (between.end - spread..between.end).rev().collect();
        let before = [between.end, between.end + 1];
        all.push(Transition::new(before, &beside, frames, device));
    }
    all
}

/// A border between known frames and others. What is left of a jump of values and of their speed is spread over the others, so
/// that they begin as the known ones go on ("inertialization", Bollo 2018). A network of little memory for its neighbours would
/// otherwise go on in another phase of a step.
#[derive(Clone, Debug)]
struct Transition {
    /// The two known frames at the border, the nearer one first.
    before: [usize; 2],
    /// The two frames beside them, the nearer one first.
    beside: [usize; 2],
    /// The share of a jump of values at every frame, `[1, frames, 1]`.
    of_jump: Tensor<3>,
    /// The share of a jump of the speed of values at every frame, `[1, frames, features]`.
    of_velocity_jump: Tensor<3>,
}

impl Transition {
    /// Creates a transition. `beside` are the frames over which a jump is spread, the nearest first, and at least two.
    fn new(before: [usize; 2], beside: &[usize], frames: usize, device: &Device) -> Transition {
        // Cubic curves that end level at 0: one begins level at 1, the other at 0 with a slope of 1.
        let of_jump = |place: usize, spread: usize| {
            let part = (place as f32 / spread as f32).min(1.0);
            1.0 + part * part * (2.0 * part - 3.0)
        };
        let of_velocity_jump = |place: usize, spread: usize| {
            let part = (place as f32 / spread as f32).min(1.0);
            place as f32 * (1.0 - part) * (1.0 - part)
        };
        let column = |curve: &dyn Fn(usize, usize) -> f32, spread: usize| {
            let mut weights = vec![0.0; frames];
            for (place, frame) in beside.iter().enumerate() {
                weights[*frame] = curve(place, spread);
            }
            Tensor::<3>::from_data(TensorData::new(weights, [1, frames, 1]), device)
        };
        let spread = beside.len();
        let [of_speeds, of_others] = are_speeds(device);
        Transition {
            before,
            beside: [beside[0], beside[1]],
            of_jump: column(&of_jump, spread),
            of_velocity_jump: column(&of_velocity_jump, spread) * of_others
                + column(&of_velocity_jump, spread.min(SPEED_SPREAD)) * of_speeds,
        }
    }

    /// Returns the change of a motion, `[1, frames, features]`, of which known frames have been replaced.
    fn change(&self, motion: &Tensor<3>) -> Tensor<3> {
        let frame = |frame: usize| motion.clone().narrow(1, frame, 1);
        let ([near, far], [first, second]) = (self.before.map(frame), self.beside.map(frame));
        let speed = near.clone() - far;
        let velocity_jump = speed.clone() - (second - first.clone());
        let jump = near + speed - first;
        jump * self.of_jump.clone() + velocity_jump * self.of_velocity_jump.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(values: impl IntoIterator<Item = f32>) -> Vec<[f32; POSE_FEATURES]> {
        values
            .into_iter()
            .map(|value| [value; POSE_FEATURES])
            .collect()
    }

    fn feature(motion: &Tensor<3>, group: FeatureGroup) -> Vec<f32> {
        let values: Vec<f32> = motion.clone().try_into_vec_as().unwrap();
        let place = group.range().start;
        values.chunks(POSE_FEATURES).map(|row| row[place]).collect()
    }

    fn heights(motion: &Tensor<3>) -> Vec<f32> {
        feature(motion, FeatureGroup::RootHeight)
    }

    fn known(start: &[[f32; POSE_FEATURES]], end: &[[f32; POSE_FEATURES]]) -> KnownFrames {
        let device = Device::flex();
        let statistics = [[1.0; POSE_FEATURES], [2.0; POSE_FEATURES]];
        let normalization =
            Normalization::from_slices(&statistics[0], &statistics[1], &device).unwrap();
        KnownFrames::new(60, start, end, &normalization, &device)
    }

    #[test]
    fn a_jump_beside_known_frames_is_spread() {
        // Normalised, the start rises by 0.5 a frame to 2, and the end falls by 1 a frame from 3.
        let known = known(&rows([1.0, 2.0, 3.0, 4.0, 5.0]), &rows([7.0, 5.0, 3.0]));
        let predicted = Tensor::<3>::full([1, 60, POSE_FEATURES], -1.0, &Device::flex());
        let all = known.replace(predicted);
        let motion = heights(&all);
        assert_eq!(motion[..5], [0.0, 0.5, 1.0, 1.5, 2.0]);
        assert_eq!(motion[57..], [3.0, 2.0, 1.0]);
        // The first frame beside the known ones goes on as they do, on both sides.
        assert!((motion[5] - 2.5).abs() < 1e-5 && (motion[56] - 4.0).abs() < 1e-5);
        let accelerations = motion.windows(3).map(|w| (w[2] - 2.0 * w[1] + w[0]).abs());
        assert!(accelerations.fold(0.0, f32::max) < 0.35, "{motion:?}");
        // In the middle there is only what is predicted.
        assert!(motion[25..37].iter().all(|value| *value == -1.0));
        // Speeds change less far than the values: they would otherwise go on growing.
        let most = |values: &[f32]| values.iter().copied().fold(0.0, f32::max);
        for group in [FeatureGroup::RootVelocity, FeatureGroup::Velocities] {
            let speeds = feature(&all, group);
            assert!((speeds[5] - 2.5).abs() < 1e-5 && (speeds[56] - 4.0).abs() < 1e-5);
            assert!(most(&speeds[5..25]) < 2.9 && most(&motion[5..25]) > 3.2);
            assert!(most(&speeds[37..57]) < 4.8 && most(&motion[37..57]) > 5.5);
        }
    }

    #[test]
    fn noisy_known_frames_have_their_steps() {
        let known = known(&rows([1.0, 2.0]), &[]);
        let [clip, none] = known.clips();
        assert_eq!(clip.unwrap().dims(), [1, 2, POSE_FEATURES]);
        assert!(none.is_none());
        let noisy = |value| Tensor::full([1, 2, POSE_FEATURES], value, &Device::flex());
        let x = Tensor::<3>::full([1, 60, POSE_FEATURES], 0.5, &Device::flex());
        assert_eq!(heights(&known.at_step(x.clone(), 0))[..3], [0.5; 3]);
        let known = known.with_noise([Some(vec![noisy(7.0), noisy(8.0)]), None]);
        assert_eq!(heights(&known.at_step(x, 1))[..3], [8.0, 8.0, 0.5]);
    }
}
