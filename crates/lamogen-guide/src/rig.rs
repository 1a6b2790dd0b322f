//! The network's motions on a rigid body, and there towards their targets.

use std::ops::ControlFlow;

use burn::tensor::{Device, Tensor, TensorData};
use lamogen_body::{FitInput, FitObjective, FitProgress};
use lamogen_laban::Goals;
use lamogen_motion::{JOINTS, Motion, RestPose, Rotations};

use crate::error::{GuideError, Quantity};
use crate::guidance::Guidance;
use crate::guided::{Comparisons, LabanComparison, Targets};
use crate::loss_term::TermComparison;

/// How much more a component that shall change, or another term of the loss, counts on the body than in the network's pass. The body's motion can follow where the
/// network's would leave what the sentence says.
const EMPHASIS: f32 = 3.5;

/// The body that motions of pose features are on: that of HumanML3D, which all of its motions have.
///
/// It turns the network's motions, whose bones stretch and whose feet slide, into those of rigid bones, and draws guided ones to
/// their target: features of the *rigid* baseline times the factors, reached by the *rigid* motion. What is reported is what files hold.
#[derive(Clone, Debug)]
pub struct Rig<'a> {
    guidance: &'a Guidance,
    body: RestPose,
    device: Device,
}

/// What guidance on a body gives.
#[derive(Clone, Debug)]
pub struct RigGuided {
    /// The rotations of every motion.
    pub rotations: Vec<Rotations>,
    /// Whether the observer stopped the fit; what is here is the best until then.
    pub is_stopped: bool,
    /// The Laban features of the whole body.
    pub whole: LabanComparison,
    /// The Laban features of each part of the body that any motion of the batch has goals for, and of the rest of the body beside it.
    pub parts: Vec<LabanComparison>,
    /// The values of the terms of [`Guidance::loss_terms`].
    pub terms: Vec<TermComparison>,
}

impl<'a> Rig<'a> {
    /// A body that follows these options: [`Guidance::fit`] and how Laban features are measured, divided and weighed. Features are
    /// computed on the device.
    pub fn new(guidance: &'a Guidance, device: &Device) -> Self {
        Rig {
            guidance,
            body: RestPose::humanml3d(),
            device: device.clone(),
        }
    }

    /// The rigid motions that are nearest to the network's, and whether the observer stopped the fit before its end.
    pub fn fit(
        &self,
        motions: &[Motion],
        watch: &mut dyn FnMut(FitProgress) -> ControlFlow<()>,
    ) -> (Vec<Rotations>, bool) {
        let fitted = self.guidance.fit.run(&self.inputs(motions), None, watch);
        (fitted.rotations, fitted.is_stopped)
    }

    /// The rigid motions that reach the features of the rigid baselines as the goals ask, near the network's guided motions.
    ///
    /// # Errors
    ///
    /// If a loss of the motions as they are given is not finite.
    ///
    /// # Panics
    ///
    /// If there are not as many motions, baselines and goals, or a motion is not as long as its baseline.
    pub fn guide(
        &self,
        motions: &[Motion],
        baselines: &[Motion],
        goals: &[Goals],
        watch: &mut dyn FnMut(FitProgress) -> ControlFlow<()>,
    ) -> Result<RigGuided, GuideError> {
        let lengths: Vec<usize> = motions.iter().map(Motion::frames).collect();
        let of_baselines: Vec<usize> = baselines.iter().map(Motion::frames).collect();
        assert_eq!(
            lengths, of_baselines,
            "motions are as long as their baselines"
        );
        let baselines: Vec<&[[[f32; 3]; JOINTS]]> = baselines.iter().map(Motion::joints).collect();
        let guidance = Guidance {
            emphasis: self.guidance.emphasis.map(|emphasis| EMPHASIS * emphasis),
            ..self.guidance.clone()
        };
        let targets = Targets::new(
            &self.tensor(&baselines),
            &lengths,
            goals,
            &guidance,
            EMPHASIS,
        )?;
        let mut goal = LossObjective {
            rig: self,
            targets: &targets,
            is_first: true,
            non_finite: None,
        };
        let inputs = self.inputs(motions);
        let fitted = { self.guidance.fit }.run(&inputs, Some(&mut goal), watch);
        if let Some((motion, value)) = goal.non_finite {
            return Err(GuideError::NotFinite {
                quantity: Quantity::Loss,
                value: targets.value_name(value),
                index: 0,
                steps: self.guidance.fit.goal_evaluations,
                timestep: 0,
                motion,
            });
        }
        let joints: Vec<Vec<[[f32; 3]; JOINTS]>> =
            fitted.rotations.iter().map(Rotations::joints).collect();
        let joints: Vec<&[[[f32; 3]; JOINTS]]> = joints.iter().map(Vec::as_slice).collect();
        let Comparisons {
            whole,
            parts,
            terms,
        } = targets.compare(&self.tensor(&joints));
        Ok(RigGuided {
            rotations: fitted.rotations,
            is_stopped: fitted.is_stopped,
            whole,
            parts,
            terms,
        })
    }

    fn inputs<'m>(&'m self, motions: &'m [Motion]) -> Vec<FitInput<'m>> {
        let input = |motion| FitInput {
            motion,
            body: &self.body,
            // Pose features count heights from the ground.
            ground: 0.0,
        };
        motions.iter().map(input).collect()
    }

    /// Joints of motions, padded by zeros to the longest: `[batch, frames, 22, 3]`.
    fn tensor(&self, motions: &[&[[[f32; 3]; JOINTS]]]) -> Tensor<4> {
        let frames = motions.iter().map(|motion| motion.len()).max().unwrap_or(0);
        let width = JOINTS * 3;
        let mut values = Vec::with_capacity(motions.len() * frames * width);
        for (place, motion) in motions.iter().enumerate() {
            values.extend_from_slice(motion.as_flattened().as_flattened());
            values.resize((place + 1) * frames * width, 0.0);
        }
        let data = TensorData::new(values, [motions.len(), frames, JOINTS, 3]);
        Tensor::from_data(data, &self.device)
    }
}

/// The loss of all terms as the objective of a fit.
struct LossObjective<'g> {
    rig: &'g Rig<'g>,
    targets: &'g Targets,
    /// Whether no trial was evaluated yet. Later ones may be too bold, and are stepped back from.
    is_first: bool,
    /// The first motion whose loss was not finite at the first evaluation, and the value of the loss.
    non_finite: Option<(usize, usize)>,
}

impl FitObjective for LossObjective<'_> {
    fn evaluate(
        &mut self,
        joints: &[Vec<[[f32; 3]; JOINTS]>],
    ) -> Vec<(f64, Vec<[[f32; 3]; JOINTS]>)> {
        let poses: Vec<&[[[f32; 3]; JOINTS]]> = joints.iter().map(Vec::as_slice).collect();
        let leaf = self.rig.tensor(&poses).autodiff().require_grad();
        let [_, frames, ..] = leaf.dims();
        let loss = self.targets.loss(leaf.clone());
        let losses: Vec<f32> = host(loss.clone().inner());
        let gradient = match loss.is_tracked() {
            true => leaf.grad(&loss.sum().backward()),
            false => None,
        };
        let gradient: Vec<f32> = host(gradient.unwrap_or_else(|| leaf.inner().zeros_like()));
        let (poses, _) = gradient.as_chunks::<3>();
        let (poses, _) = poses.as_chunks::<JOINTS>();
        let motions = losses
            .chunks_exact(self.targets.values())
            .zip(poses.chunks_exact(frames));
        let motions = motions.zip(joints).enumerate();
        let is_first = std::mem::replace(&mut self.is_first, false);
        motions
            .map(|(motion, ((losses, gradient), joints))| {
                let non_finite = losses.iter().position(|loss| !loss.is_finite());
                if let Some(value) = non_finite.filter(|_| is_first) {
                    self.non_finite.get_or_insert((motion, value));
                }
                let loss = losses.iter().copied().map(f64::from).sum();
                (loss, gradient[..joints.len()].to_vec())
            })
            .collect()
    }
}

fn host<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor.try_into_vec_as().expect("floats convert to f32")
}
