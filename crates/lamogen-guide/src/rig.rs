//! The fit of the network's motions to a rigid body, without and with targets.

use std::ops::ControlFlow;

use burn::tensor::Device;
use lamogen_body::{FitInput, FitObjective, FitProgress};
use lamogen_laban::{Goals, MotionLoss};
use lamogen_motion::{JOINTS, Motion, RestPose, Rotations};
use rayon::prelude::*;

use crate::error::GuideError;
use crate::guidance::Guidance;
use crate::guided::{Comparisons, HeldFrames, LabanComparison, Targets};
use crate::host::{joint_tensor, to_host};
use crate::loss_term::TermComparison;

/// The factor on the emphasis of components that shall change, and on the loss of other terms, relative to the
/// network's pass. On the body a larger weight is possible: in the network's pass it would move the motion away from
/// the sentence.
const RIG_EMPHASIS: f32 = 5.0;
/// The factor on the loss of places, relative to the network's pass. In that pass a position that a hand is far from
/// would count more than everything else, and the network leaves the sentence for it; the body has to be there.
const PLACE_EMPHASIS: f32 = 500.0;
/// The factor on the weight of all goals beside places. Goals that count as much as by themselves would push the body off places
/// at which they cannot be reached, as a light walk cannot on a path at the speed of a usual one.
const GOALS_BESIDE_PLACES: f64 = 0.35;

/// The distance in metres that a foot may slide on a path before it takes a step.
const STRIDE: f64 = 0.4;

/// Fits motions of pose features to the rigid body of HumanML3D, which all motions of the data set have.
///
/// The bones of the network's motions stretch and their feet slide; [`fit`](Self::fit) turns them into motions of rigid
/// bones. [`guide`](Self::guide) also moves guided motions to their target: the features of the *rigid* baseline,
/// changed as the goals ask, are reached by the *rigid* motion. The reported features are therefore those of the
/// motions in files.
#[derive(Clone, Debug)]
pub struct Rig<'a> {
    guidance: &'a Guidance,
    body: RestPose,
    device: Device,
    /// The frames with which every motion begins.
    start: Option<Rotations>,
}

/// The result of guidance on a rigid body.
#[derive(Clone, Debug)]
pub struct RigMotions {
    /// The rotations of every motion.
    pub rotations: Vec<Rotations>,
    /// Whether the observer stopped the fit. The result is then the best one that was reached before.
    pub is_stopped: bool,
    /// The Laban features of the whole body.
    pub whole: LabanComparison,
    /// The Laban features of each part of the body that any motion of the batch has goals for, and of the rest of the
    /// body beside it.
    pub parts: Vec<LabanComparison>,
    /// The values of the terms of [`Guidance::loss_terms`], and then of [`Guidance::places`].
    pub terms: Vec<TermComparison>,
}

impl<'a> Rig<'a> {
    /// Creates a rig with the options of guidance: [`Guidance::fit`], the measurement of Laban features, divisor,
    /// emphasis and loss terms. Features are computed on `device`.
    pub fn new(guidance: &'a Guidance, device: &Device) -> Self {
        Rig {
            guidance,
            body: RestPose::humanml3d(),
            device: device.clone(),
            start: None,
        }
    }

    /// Sets the frames with which every motion begins, on HumanML3D's body and where the motions are: they stay as they are,
    /// and the fit goes on from them.
    pub fn with_start(self, start: Option<Rotations>) -> Self {
        Rig { start, ..self }
    }

    /// Returns the rigid motions that are nearest to the network's motions, and whether `on_progress` stopped the fit
    /// before its end.
    pub fn fit(
        &self,
        motions: &[Motion],
        on_progress: &mut dyn FnMut(FitProgress) -> ControlFlow<()>,
    ) -> (Vec<Rotations>, bool) {
        let inputs = self.fit_inputs(motions);
        let fit = self.guidance.fit.run(&inputs, None, on_progress);
        (fit.rotations, fit.is_stopped)
    }

    /// Returns the rigid motions that reach the goals and stay near the network's guided motions. Targets are computed
    /// from the features of the rigid baselines.
    ///
    /// # Errors
    ///
    /// If a loss of the given motions is not finite, or a loss term is invalid.
    ///
    /// # Panics
    ///
    /// If motions, baselines and goals differ in number, or a motion and its baseline differ in length.
    pub fn guide(
        &self,
        motions: &[Motion],
        baselines: &[Motion],
        goals: &[Goals],
        on_progress: &mut dyn FnMut(FitProgress) -> ControlFlow<()>,
    ) -> Result<RigMotions, GuideError> {
        let lengths: Vec<usize> = motions.iter().map(Motion::frames).collect();
        let baseline_lengths: Vec<usize> = baselines.iter().map(Motion::frames).collect();
        assert_eq!(
            lengths, baseline_lengths,
            "motions are as long as their baselines"
        );
        let poses: Vec<&[[[f32; 3]; JOINTS]]> = baselines.iter().map(Motion::joints).collect();
        let guidance = Guidance {
            emphasis: self
                .guidance
                .emphasis
                .map(|emphasis| RIG_EMPHASIS * emphasis),
            ..self.guidance.clone()
        };
        let targets = Targets::new(
            &joint_tensor(&poses, &self.device),
            &lengths,
            goals,
            &guidance,
            [RIG_EMPHASIS, PLACE_EMPHASIS],
        )?;
        let inputs = self.fit_inputs(motions);
        let held = self.start.as_ref().map(|start| HeldFrames {
            frames: start.frames(),
            starts: inputs.iter().map(FitInput::joints).collect(),
        });
        let held = held.as_ref();
        let mut objective = LossObjective {
            rig: self,
            lengths: &lengths,
            targets: &targets,
            laban: targets.laban_losses(&guidance, motions, baselines, held, &self.device),
            is_first: true,
            non_finite: None,
        };
        let mut fit = self.guidance.fit;
        // A path leads bodies on whose feet the sentence would have standing.
        if self.guidance.places.path.is_some() && fit.stride.is_none() {
            fit.stride = Some(STRIDE);
        }
        if !self.guidance.places.is_empty() {
            fit.goal *= GOALS_BESIDE_PLACES;
            // The network's motion leads through the places. A body that may be elsewhere could wait, and leap through them.
            fit.placement = 1.0;
        }
        let fit = fit.run(&inputs, Some(&mut objective), on_progress);
        if let Some((motion, value)) = objective.non_finite {
            return Err(GuideError::Rig {
                value: targets.value_name(value),
                motion,
            });
        }
        let joints: Vec<Vec<[[f32; 3]; JOINTS]>> =
            fit.rotations.iter().map(Rotations::joints).collect();
        let joints: Vec<&[[[f32; 3]; JOINTS]]> = joints.iter().map(Vec::as_slice).collect();
        let Comparisons {
            whole,
            parts,
            terms,
        } = targets.compare(&joint_tensor(&joints, &self.device));
        Ok(RigMotions {
            rotations: fit.rotations,
            is_stopped: fit.is_stopped,
            whole,
            parts,
            terms,
        })
    }

    /// Returns the input of the fit for each motion.
    fn fit_inputs<'m>(&'m self, motions: &'m [Motion]) -> Vec<FitInput<'m>> {
        let input = |motion| FitInput {
            motion,
            body: &self.body,
            // Heights in pose features are measured from the ground.
            ground: 0.0,
            start: self.start.as_ref(),
        };
        motions.iter().map(input).collect()
    }
}

/// The loss of all terms as the objective of a fit.
struct LossObjective<'g> {
    rig: &'g Rig<'g>,
    /// The number of frames of each motion.
    lengths: &'g [usize],
    targets: &'g Targets,
    /// The Laban losses of each motion.
    laban: Vec<Vec<MotionLoss>>,
    /// Whether the next evaluation is the first. At later evaluations the loss may be non-finite because a step was too
    /// large; the fit then makes a smaller step.
    is_first: bool,
    /// The first motion that had a non-finite loss at the first evaluation, and the index of the value with that loss.
    non_finite: Option<(usize, usize)>,
}

/// The losses of one motion that are no Laban features.
struct OtherLosses {
    /// The loss of each value.
    losses: Vec<f64>,
    /// The gradient of their sum with respect to the joint positions.
    gradient: Vec<[[f64; 3]; JOINTS]>,
}

impl FitObjective for LossObjective<'_> {
    fn set_loop_travel(&mut self, motion: usize, travel: [f64; 3]) {
        for loss in &mut self.laban[motion] {
            loss.set_loop_travel(travel);
        }
    }

    fn stiff_frames(&self, motion: usize) -> Vec<usize> {
        let guidance = self.rig.guidance;
        let places = guidance.places.counted_from(guidance.place_origin.as_ref());
        places.frames(self.lengths[motion])
    }

    fn evaluate(
        &mut self,
        joints: &[Vec<[[f32; 3]; JOINTS]>],
    ) -> Vec<(f64, Vec<[[f64; 3]; JOINTS]>)> {
        let others = self.evaluate_others(joints);
        let evaluations = joints.par_iter().zip(&self.laban).zip(others);
        let evaluations: Vec<_> = evaluations
            .map(|((joints, laban), others)| {
                let mut gradient = others.gradient;
                let laban = laban.iter();
                let laban = laban.flat_map(|loss| loss.evaluate(joints, &mut gradient));
                let losses: Vec<f64> = laban.chain(others.losses).collect();
                let non_finite = losses.iter().position(|loss| !loss.is_finite());
                ((losses.iter().sum(), gradient), non_finite)
            })
            .collect();
        if std::mem::replace(&mut self.is_first, false) {
            let values = evaluations.iter().map(|(_, non_finite)| *non_finite);
            self.non_finite = { values.enumerate() }
                .find_map(|(motion, value)| value.map(|value| (motion, value)));
        }
        { evaluations.into_iter().map(|(evaluation, _)| evaluation) }.collect()
    }
}

impl LossObjective<'_> {
    /// Computes the loss of each value that is no Laban feature, for every motion, and the gradient of their sum. The terms
    /// are functions of tensors that anyone may write, so autodiff differentiates them.
    fn evaluate_others(&self, joints: &[Vec<[[f32; 3]; JOINTS]>]) -> Vec<OtherLosses> {
        let poses: Vec<&[[[f32; 3]; JOINTS]]> = joints.iter().map(Vec::as_slice).collect();
        if !self.targets.has_others() {
            return { joints.iter() }
                .map(|joints| OtherLosses {
                    losses: Vec::new(),
                    gradient: vec![[[0.0; 3]; JOINTS]; joints.len()],
                })
                .collect();
        }
        let leaf = joint_tensor(&poses, &self.rig.device)
            .autodiff()
            .require_grad();
        let [_, frames, ..] = leaf.dims();
        let loss = self.targets.other_loss(&leaf);
        let [_, values] = loss.dims();
        let losses: Vec<f32> = to_host(loss.clone().inner());
        let gradient = match loss.is_tracked() {
            true => leaf.grad(&loss.sum().backward()),
            false => None,
        };
        let gradient: Vec<f32> = to_host(gradient.unwrap_or_else(|| leaf.inner().zeros_like()));
        let (poses, _) = gradient.as_chunks::<3>();
        let (poses, _) = poses.as_chunks::<JOINTS>();
        let motions = losses
            .chunks_exact(values)
            .zip(poses.chunks_exact(frames))
            .zip(joints);
        let wide = |pose: &[[f32; 3]; JOINTS]| pose.map(|point| point.map(f64::from));
        motions
            .map(|((losses, gradient), joints)| {
                let gradient = gradient[..joints.len()].iter().map(wide);
                OtherLosses {
                    losses: losses.iter().copied().map(f64::from).collect(),
                    gradient: gradient.collect(),
                }
            })
            .collect()
    }
}
