//! The loss that guidance lowers, its targets, and its gradient.

use std::sync::Arc;

use burn::tensor::{Device, Tensor};
use lamogen_laban::{
    COMPONENTS, Component, EndEffectors, Goal, Goals, LabanFeatures, LabanSeries, LabanTarget,
    MotionLoss,
};
use lamogen_motion::{JOINTS, Joint, Motion, Normalization, joints, smooth_step};

use crate::error::{GuideError, Quantity};
use crate::guidance::Guidance;
use crate::host::{first_non_finite, joint_tensor, to_host};
use crate::laban_term::LabanTerm;
use crate::loss_term::{LossTerm, PreparedTerm, TermComparison};

/// The number of frames after held ones over which a target comes to what is asked for: twice as many as smoothing and differences
/// look back.
const LEAD_FRAMES: usize = 16;

/// Lets targets pass from a motion's own features, at the last of its held frames, to what is asked for. A target that changes at
/// once where the frames before cannot move could only be reached there by a leap and steps back. The features of the last held
/// frames are made of the frames after them, too, so they count as much as those of the first free frame: a leap would otherwise
/// be free there.
fn lead_on(
    held: usize,
    own: &[[f32; COMPONENTS]],
    target: &mut [[f32; COMPONENTS]],
    weight: &mut [[f32; COMPONENTS]],
) {
    if let Some(&first) = weight.get(held) {
        weight[..held].fill(first);
    }
    for (frame, (own, target)) in own.iter().zip(target).enumerate().take(held + LEAD_FRAMES) {
        let after = (frame + 1).saturating_sub(held);
        let share = smooth_step(after as f64 / (LEAD_FRAMES + 1) as f64) as f32;
        for (own, target) in own.iter().zip(target) {
            *target = own + share * (*target - own);
        }
    }
}

/// The number of frames on either side over which the speed of a body on its path is averaged: half a second, which is about a step.
const STEP_FRAMES: usize = 10;

/// Raises the targets of Weight, if they are too low altogether, to what the body needs to travel as a motion on a path does: the
/// energy of its end-effectors, of `masses` altogether, if all of them moved at the mean speed of the pelvis. They have to come
/// along, and no other way of moving has less; a lower target could only be approached by standing still and leaping from place to
/// place.
fn raise_to_travel(motion: &Motion, masses: f32, target: &mut [[f32; COMPONENTS]]) {
    let frames = motion.frames();
    let needed = |frame: usize| {
        let from = frame.saturating_sub(STEP_FRAMES);
        let until = (frame + STEP_FRAMES).min(frames - 1);
        let [start, end] = [from, until].map(|frame| motion.position(frame, Joint::Pelvis));
        let way = (end[0] - start[0]).hypot(end[2] - start[2]);
        masses * (way / (until - from).max(1) as f32).powi(2)
    };
    let needed: Vec<f32> = (0..frames).map(needed).collect();
    let weight = Component::Weight.index();
    if { target.iter() }.map(|values| values[weight]).sum::<f32>() < needed.iter().sum() {
        for (target, needed) in target.iter_mut().zip(needed) {
            target[weight] = target[weight].max(needed);
        }
    }
}

/// The frames at the beginning of motions that stay as they are.
pub(crate) struct HeldFrames {
    /// The number of these frames.
    pub frames: usize,
    /// The joint positions of each whole motion on the body, at which its fit begins.
    pub starts: Vec<Vec<[[f32; 3]; JOINTS]>>,
}

/// The loss of predicted motions, which are given as normalised pose features.
pub(super) struct Objective<'a> {
    normalization: &'a Normalization,
    targets: Targets,
}

/// All terms of the loss with their targets, as functions of joints.
pub(crate) struct Targets {
    /// The Laban features of the whole body, then those of each set of end-effectors that any motion of the batch has
    /// goals for.
    laban: Vec<LabanSet>,
    /// The terms of [`Guidance::loss_terms`].
    others: Vec<PreparedTerm>,
    /// The terms of [`Guidance::places`].
    places: Vec<PreparedTerm>,
}

/// The Laban features of one set of end-effectors as a term of the loss.
struct LabanSet {
    end_effectors: EndEffectors,
    /// The goals of each motion.
    goals: Vec<[Goal; COMPONENTS]>,
    term: PreparedTerm,
}

/// The comparison of finished motions with all targets.
pub(crate) struct Comparisons {
    /// The Laban features of the whole body.
    pub(crate) whole: LabanComparison,
    /// The Laban features of the parts.
    pub(crate) parts: Vec<LabanComparison>,
    /// The values of the terms of [`Guidance::loss_terms`], and then of [`Guidance::places`].
    pub(crate) terms: Vec<TermComparison>,
}

/// The Laban features of one set of end-effectors before and after guidance, and the features to reach. Each tensor is
/// `[batch, frames, 4]`.
#[derive(Clone, Debug)]
pub struct LabanComparison {
    /// The end-effectors of which Weight, Time and Flow are measured; Shape is that of the whole body.
    pub end_effectors: EndEffectors,
    /// The features of the baseline.
    pub baseline: Tensor<3>,
    /// The features to reach; those of the baseline where a component may take any values.
    pub target: Tensor<3>,
    /// The features of the guided motions.
    pub guided: Tensor<3>,
}

/// A differentiable path from the variable that guidance moves to the predicted motions.
pub(super) struct MotionPath<'w, const D: usize> {
    /// The tensor where autodiff begins, `[batch, frames, features]`; not tracked.
    pub(super) leaf: Tensor<3>,
    /// The output of the network's unconditional evaluation, if there was one.
    pub(super) unconditional: Option<Tensor<3>>,
    /// Turns the leaf into clean motions, normalised.
    pub(super) clean: Box<dyn Fn(Tensor<3>) -> Tensor<3> + 'w>,
    /// Turns the gradient with respect to the leaf into the gradient with respect to the variable.
    pub(super) pull: Box<dyn FnOnce(Tensor<3>) -> Tensor<D> + 'w>,
}

/// The loss with its gradient. No tensor is tracked by autodiff.
pub(super) struct LossGradient<const D: usize> {
    /// The leaf of the path.
    pub(super) leaf: Tensor<3>,
    /// The output of the network's unconditional evaluation, if there was one.
    pub(super) unconditional: Option<Tensor<3>>,
    /// The loss of each motion, summed over all values of all terms.
    pub(super) loss: Vec<f32>,
    /// The gradient with respect to the variable.
    pub(super) gradient: Tensor<D>,
}

/// A loss or gradient that is infinite or NaN.
#[derive(Debug)]
pub(super) struct NonFinite {
    pub(super) quantity: Quantity,
    /// The name of the value with this loss or gradient.
    pub(super) value: String,
    /// The place of the motion in the batch.
    pub(super) motion: usize,
}

impl Targets {
    /// Measures the baseline and sets the targets. The importances multiply the loss of [`Guidance::loss_terms`] and that
    /// of [`Guidance::places`].
    ///
    /// # Shapes
    ///
    /// - `joints`: the joints of the baseline, `[batch, frames, 22, 3]`
    /// - `lengths`, `goals`: one for each motion
    pub(crate) fn new(
        joints: &Tensor<4>,
        lengths: &[usize],
        goals: &[Goals],
        guidance: &Guidance,
        [importance, place_importance]: [f32; 2],
    ) -> Result<Self, GuideError> {
        let [_, frames, ..] = joints.dims();
        let laban = goals_by_end_effectors(goals, &guidance.laban.end_effectors);
        let laban = laban.into_iter().map(|(end_effectors, goals)| {
            let batch = (frames, lengths);
            let term = LabanTerm::new(
                end_effectors.clone(),
                goals.clone(),
                guidance,
                batch,
                &joints.device(),
            );
            let term = PreparedTerm::new(Arc::new(term), joints.clone(), lengths, 1.0)?;
            Ok(LabanSet {
                end_effectors,
                goals,
                term,
            })
        });
        // Places are checked against every length, so those of the longest motion hold for all.
        let longest = lengths.iter().copied().max().unwrap_or(0);
        let prepare = |term: &Arc<dyn LossTerm>, importance| {
            PreparedTerm::new(term.clone(), joints.clone(), lengths, importance)
        };
        let others = guidance.loss_terms.iter();
        let others = others.map(|term| prepare(term, importance));
        let places = guidance
            .places
            .terms(guidance.place_origin.as_ref(), longest);
        let places = places.iter().map(|term| prepare(term, place_importance));
        Ok(Targets {
            laban: laban.collect::<Result<_, GuideError>>()?,
            others: others.collect::<Result<_, _>>()?,
            places: places.collect::<Result<_, _>>()?,
        })
    }

    /// Iterates over all terms, the whole body's Laban features first.
    fn terms(&self) -> impl Iterator<Item = &PreparedTerm> {
        let laban = self.laban.iter().map(|set| &set.term);
        laban.chain(&self.others).chain(&self.places)
    }

    /// Returns how many values all terms have together.
    pub(crate) fn values(&self) -> usize {
        self.terms().map(PreparedTerm::values).sum()
    }

    /// Returns the name of a value, counted over all terms.
    pub(crate) fn value_name(&self, value: usize) -> String {
        let mut before = 0;
        for term in self.terms() {
            if value < before + term.values() {
                return term.value_name(value - before);
            }
            before += term.values();
        }
        unreachable!("there are {before} values, not {value}")
    }

    /// Returns the loss of each value of each motion, `[batch, values]`, over all terms.
    pub(crate) fn loss(&self, joints: Tensor<4>) -> Tensor<2> {
        let mut losses: Vec<Tensor<2>> = { self.terms() }
            .map(|term| term.loss(joints.clone()))
            .collect();
        match losses.len() {
            1 => losses.remove(0),
            _ => Tensor::cat(losses, 1),
        }
    }

    /// Returns the Laban losses of each motion, one for each set of end-effectors, for motions in main memory. Their values are
    /// the first of all [values](Self::values). Baselines that are loops are measured in the middle of several cycles.
    ///
    /// `motions` are the network's guided motions. The targets after held frames [lead on](lead_on) from the features that the
    /// body has there. Those of the network's joints are no measure of them: where its legs are longer than the body's, they
    /// swing faster, and a body that is to follow would leap.
    pub(crate) fn laban_losses(
        &self,
        guidance: &Guidance,
        motions: &[Motion],
        baselines: &[Motion],
        held: Option<&HeldFrames>,
        device: &Device,
    ) -> Vec<Vec<MotionLoss>> {
        let [of_baseline, of_guided] = guidance.headings;
        let mut losses = vec![Vec::with_capacity(self.laban.len()); baselines.len()];
        for set in &self.laban {
            let options = guidance.laban.with_end_effectors(set.end_effectors.clone());
            let measure = |joints: &[[[f32; 3]; JOINTS]], heading| {
                LabanFeatures::new(&options, joints.len(), &[joints.len()], device)
                    .with_heading(heading)
                    .measure(joint_tensor(&[joints], device))
            };
            let [_, frames, _] = set.term.target().dims();
            let [targets, weights] = [set.term.target(), set.term.weight()].map(to_host);
            for (motion, (losses, baseline)) in losses.iter_mut().zip(baselines).enumerate() {
                let length = baseline.frames();
                let rows = |values: &[f32], start: usize| {
                    values.as_chunks::<COMPONENTS>().0[start..start + length].to_vec()
                };
                let [mut target, mut weight] = match baseline.repeated(3) {
                    None => [&targets, &weights].map(|values| rows(values, motion * frames)),
                    Some(cycles) => {
                        let features =
                            measure(cycles.joints(), of_baseline).narrow(1, length, length);
                        let target = LabanTarget::new(
                            features,
                            &[length],
                            &set.goals[motion..=motion],
                            guidance.divisor,
                            guidance.emphasis,
                        );
                        [target.features(), target.weight()].map(|values| rows(&to_host(values), 0))
                    }
                };
                if guidance.places.path.is_some() {
                    let masses = set.end_effectors.masses().sum();
                    raise_to_travel(&motions[motion], masses, &mut target);
                }
                if let Some(held) = held {
                    let own = to_host(measure(&held.starts[motion], of_guided));
                    lead_on(held.frames, &rows(&own, 0), &mut target, &mut weight);
                }
                let loss = MotionLoss::new(&options, &target, &weight);
                losses.push(loss.with_heading(of_guided));
            }
        }
        losses
    }

    /// Returns whether there are values that are no Laban features.
    pub(crate) fn has_others(&self) -> bool {
        !(self.others.is_empty() && self.places.is_empty())
    }

    /// Returns the loss of each value that is no Laban feature, `[batch, values]`.
    ///
    /// # Panics
    ///
    /// If there is no such value.
    pub(crate) fn other_loss(&self, joints: &Tensor<4>) -> Tensor<2> {
        let terms = self.others.iter().chain(&self.places);
        Tensor::cat(terms.map(|term| term.loss(joints.clone())).collect(), 1)
    }

    /// Returns the means over time of the whole body's Laban target, over the frames with known features.
    fn laban_means(&self, lengths: &[usize]) -> Vec<[Option<f32>; COMPONENTS]> {
        let target = self.laban[0].term.target();
        let [_, frames, _] = target.dims();
        let series = |motion: usize| {
            let rows = target.clone().narrow(0, motion, 1);
            LabanSeries::from_tensor(rows.reshape([frames, COMPONENTS]))
        };
        let means = { lengths.iter().enumerate() }
            .map(|(motion, &length)| series(motion).known_means(0..length).map(Some));
        means.collect()
    }

    /// Compares finished motions with all targets.
    pub(crate) fn compare(self, joints: &Tensor<4>) -> Comparisons {
        let mut laban = self.laban.into_iter().map(|set| {
            let LabanSet {
                end_effectors,
                term,
                ..
            } = set;
            let compared = term.compare(joints.clone());
            LabanComparison {
                end_effectors,
                baseline: compared.baseline,
                target: compared.target,
                guided: compared.guided,
            }
        });
        let others = self.others.into_iter().chain(self.places);
        Comparisons {
            whole: laban.next().expect("the whole body is a term"),
            parts: laban.collect(),
            terms: others.map(|term| term.compare(joints.clone())).collect(),
        }
    }
}

impl<'a> Objective<'a> {
    pub(super) fn new(
        normalization: &'a Normalization,
        baseline: Tensor<3>,
        lengths: &[usize],
        goals: &[Goals],
        guidance: &Guidance,
    ) -> Result<Self, GuideError> {
        let baseline = joints(normalization.denormalize(baseline));
        Ok(Objective {
            normalization,
            targets: Targets::new(&baseline, lengths, goals, guidance, [1.0; 2])?,
        })
    }

    /// Compares finished motions, normalised, with all targets.
    pub(super) fn compare(self, motions: Tensor<3>) -> Comparisons {
        let joints = joints(self.normalization.denormalize(motions));
        self.targets.compare(&joints)
    }

    /// Returns the means over time of the whole body's Laban target, over the frames with known features.
    pub(super) fn laban_means(&self, lengths: &[usize]) -> Vec<[Option<f32>; COMPONENTS]> {
        self.targets.laban_means(lengths)
    }

    /// Returns the loss of each motion, summed over all values.
    pub(super) fn loss_of_motions(&self, motions: Tensor<3>) -> Vec<f32> {
        let joints = joints(self.normalization.denormalize(motions));
        self.sum_values(&to_host(self.targets.loss(joints)))
    }

    /// Returns the sums over values of each motion's losses.
    fn sum_values(&self, losses: &[f32]) -> Vec<f32> {
        let motions = losses.chunks_exact(self.targets.values());
        motions.map(|losses| losses.iter().sum()).collect()
    }

    /// Computes the loss and its gradient along a path. The path is built again only to find the value whose gradient
    /// is not finite.
    pub(super) fn gradient<'w, const D: usize>(
        &self,
        path: impl Fn() -> MotionPath<'w, D>,
    ) -> Result<LossGradient<D>, NonFinite> {
        let MotionPath {
            leaf,
            unconditional,
            clean,
            pull,
        } = path();
        let (tracked, loss) = self.loss(&leaf, &clean);
        let losses = to_host(loss.clone().inner());
        let values = self.targets.values();
        if let Some(place) = losses.iter().position(|loss| !loss.is_finite()) {
            return Err(NonFinite {
                quantity: Quantity::Loss,
                value: self.targets.value_name(place % values),
                motion: place / values,
            });
        }
        let gradient = pull(leaf_gradient(&tracked, loss.sum()));
        if let Some(row) = first_non_finite(&gradient) {
            // A motion made of tiles has a row for each of them.
            let motion = row * (losses.len() / values) / gradient.dims()[0];
            let value = self.non_finite_value(path, motion);
            return Err(NonFinite {
                quantity: Quantity::Gradient,
                value: self.targets.value_name(value),
                motion,
            });
        }
        Ok(LossGradient {
            leaf,
            unconditional,
            loss: self.sum_values(&losses),
            gradient,
        })
    }

    /// Returns the tracked leaf, and the loss `[batch, values]` as a function of it.
    fn loss(
        &self,
        leaf: &Tensor<3>,
        clean: &dyn Fn(Tensor<3>) -> Tensor<3>,
    ) -> (Tensor<3>, Tensor<2>) {
        let leaf = leaf.clone().autodiff().require_grad();
        let joints = joints(self.normalization.denormalize(clean(leaf.clone())));
        let loss = self.targets.loss(joints);
        (leaf, loss)
    }

    /// Returns the index of the first value with a non-finite gradient for a motion. If the gradient of each single
    /// value is finite and only their sum is not, it returns 0.
    fn non_finite_value<'w, const D: usize>(
        &self,
        path: impl Fn() -> MotionPath<'w, D>,
        motion: usize,
    ) -> usize {
        let mut values = 0..self.targets.values();
        values
            .find(|&value| {
                let MotionPath {
                    leaf, clean, pull, ..
                } = path();
                let (leaf, loss) = self.loss(&leaf, &clean);
                let loss = loss.narrow(0, motion, 1).narrow(1, value, 1);
                first_non_finite(&pull(leaf_gradient(&leaf, loss.sum()))).is_some()
            })
            .unwrap_or(0)
    }
}

/// Groups the goals of all motions by sets of end-effectors: those of the whole body, then each set that any motion has
/// goals for. Each set has the goals of every motion.
fn goals_by_end_effectors(
    goals: &[Goals],
    all: &EndEffectors,
) -> Vec<(EndEffectors, Vec<[Goal; COMPONENTS]>)> {
    let no_goals = || vec![[const { Goal::Any }; COMPONENTS]; goals.len()];
    let mut sets = vec![(all.clone(), no_goals())];
    for (motion, goals) in goals.iter().enumerate() {
        for term in goals.terms(all) {
            let place = sets.iter().position(|(set, _)| *set == term.end_effectors);
            let place = place.unwrap_or_else(|| {
                sets.push((term.end_effectors, no_goals()));
                sets.len() - 1
            });
            let pairs = sets[place].1[motion].iter_mut().zip(term.goals);
            for (own, goal) in pairs.filter(|(_, goal)| *goal != Goal::Any) {
                *own = goal;
            }
        }
    }
    sets
}

/// Computes the gradient of a loss with respect to a leaf: zeros if the loss does not depend on the leaf.
fn leaf_gradient(leaf: &Tensor<3>, loss: Tensor<1>) -> Tensor<3> {
    let gradient = match loss.is_tracked() {
        true => leaf.grad_remove(&mut loss.backward()),
        false => None,
    };
    gradient.unwrap_or_else(|| leaf.clone().inner().zeros_like())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_body_on_a_path_is_not_asked_to_be_lighter_than_its_travel() {
        // 6 cm a frame for two seconds, and then nothing.
        let pose = |frame: usize| [[0.0, 1.0, 0.06 * frame.min(40) as f32]; lamogen_motion::JOINTS];
        let motion = Motion::from_joints((0..80).map(pose).collect()).unwrap();
        let mut target = [[0.008, 1.0, 1.0, 1.0]; 80];
        target[5][0] = 0.1;
        let before = target;
        raise_to_travel(&motion, 6.0, &mut target);
        assert!((target[20][0] - 6.0 * 0.06 * 0.06).abs() < 1e-5);
        assert_eq!((target[5][0], target[70][0]), (0.1, 0.008));
        assert!(target.iter().all(|values| values[1..] == [1.0; 3]));
        // Targets that the travel can have stay as they are, also where it is faster at times.
        let mut strong = before.map(|[_, time, flow, shape]| [0.015, time, flow, shape]);
        raise_to_travel(&motion, 6.0, &mut strong);
        assert!(strong.iter().all(|values| values[0] == 0.015));
    }

    #[test]
    fn a_target_leads_on_from_the_held_frames() {
        let own = [[1.0; COMPONENTS]; 60];
        let mut target = [[3.0; COMPONENTS]; 60];
        let mut weight = [[0.0; COMPONENTS]; 60];
        weight[20..].fill([2.0, 0.0, 1.0, 0.5]);
        lead_on(20, &own, &mut target, &mut weight);
        let values = target.map(|values| values[0]);
        assert!(values[..20].iter().all(|&value| value == 1.0));
        // The way from one to the other is even on both sides.
        assert!((values[27] + values[28] - 4.0).abs() < 1e-5, "{values:?}");
        for pair in values[19..37].windows(2) {
            let step = pair[1] - pair[0];
            assert!((0.0..0.25).contains(&step), "{values:?}");
        }
        assert!(values[36..].iter().all(|&value| value == 3.0));
        // The held frames count as the free ones do, so that a leap after them has its cost in them, too.
        assert!(weight.iter().all(|&row| row == [2.0, 0.0, 1.0, 0.5]));
    }
}
