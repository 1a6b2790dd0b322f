//! What motions shall become, and how far they are from it.

use burn::tensor::Tensor;
use lamogen_laban::{
    COMPONENTS, Component, EndEffectors, Goal, Goals, LabanFeatures, LabanOptions, LabanSeries,
    Target,
};
use lamogen_motion::{Normalization, joints};

use crate::error::Quantity;
use crate::guidance::Guidance;

/// Laban features that the joints of predicted motions shall reach, and the loss of not reaching them.
pub(super) struct Objective<'a> {
    normalization: &'a Normalization,
    targets: Targets,
}

/// Laban features that joints shall reach: first those of the whole body, then those of parts that any motion of the batch asks
/// something of.
pub(crate) struct Targets {
    terms: Vec<Term>,
}

/// The same of one set of end-effectors.
struct Term {
    end_effectors: EndEffectors,
    features: LabanFeatures,
    target: Target,
    /// Of the baseline, `[batch, frames, 4]`.
    baseline: Tensor<3>,
}

/// Laban features of one set of end-effectors, before, asked for and after: `[batch, frames, 4]`.
#[derive(Clone, Debug)]
pub struct LabanComparison {
    /// The joints whose Weight, Time and Flow it is; Shape is that of the whole body.
    pub end_effectors: EndEffectors,
    /// Of the baseline.
    pub baseline: Tensor<3>,
    /// To reach; the baseline's where nothing is asked for.
    pub target: Tensor<3>,
    /// Of the motions that guidance made.
    pub guided: Tensor<3>,
}

/// How what is moved becomes motions.
pub(super) struct Way<'w, const D: usize> {
    /// Where autodiff begins, `[batch, frames, features]`; not tracked.
    pub(super) leaf: Tensor<3>,
    /// The clean motions, normalised, that the leaf becomes.
    pub(super) clean: Box<dyn Fn(Tensor<3>) -> Tensor<3> + 'w>,
    /// What turns a gradient with respect to the leaf into that with respect to what is moved.
    pub(super) pull: Box<dyn FnOnce(Tensor<3>) -> Tensor<D> + 'w>,
}

/// A loss with its gradient; nothing of it on the tape.
pub(super) struct Gradient<const D: usize> {
    /// The way's leaf.
    pub(super) leaf: Tensor<3>,
    /// Of each motion, summed over components.
    pub(super) loss: Vec<f32>,
    /// With respect to what is moved.
    pub(super) gradient: Tensor<D>,
}

/// A number that left the range of 32-bit floats, or was never in it.
#[derive(Debug)]
pub(super) struct Broken {
    pub(super) quantity: Quantity,
    pub(super) component: Component,
    pub(super) motion: usize,
}

impl Targets {
    /// What joints `[batch, frames, 22, 3]` of such lengths shall become.
    pub(crate) fn new(
        joints: &Tensor<4>,
        lengths: &[usize],
        goals: &[Goals],
        guidance: &Guidance,
    ) -> Self {
        let [_, frames, ..] = joints.dims();
        let terms = by_end_effectors(goals, &guidance.laban.end_effectors);
        let terms = terms.into_iter().map(|(end_effectors, goals)| {
            let options = LabanOptions {
                end_effectors: end_effectors.clone(),
                ..guidance.laban.clone()
            };
            let features = LabanFeatures::new(&options, frames, lengths, &joints.device());
            let baseline = features.measure(joints.clone());
            let (divisor, emphasis) = (guidance.divisor, guidance.emphasis);
            Term {
                target: Target::new(baseline.clone(), lengths, &goals, divisor, emphasis),
                end_effectors,
                features,
                baseline,
            }
        });
        Targets {
            terms: terms.collect(),
        }
    }

    /// The Laban loss `[batch, 4]` of joints.
    pub(crate) fn loss(&self, joints: Tensor<4>) -> Tensor<2> {
        let losses = { self.terms.iter() }
            .map(|term| term.target.loss(term.features.measure(joints.clone())));
        let loss = losses.reduce(|all, loss| all + loss);
        loss.expect("the whole body is a term")
    }

    /// The means over time of the whole body's target, over the frames that have a difference of the feature's order.
    fn told(&self, lengths: &[usize]) -> Vec<[Option<f32>; COMPONENTS]> {
        let target = self.terms[0].target.features();
        let [_, frames, _] = target.dims();
        let series = |motion: usize| {
            let rows = target.clone().narrow(0, motion, 1);
            LabanSeries::from_tensor(rows.reshape([frames, COMPONENTS]))
        };
        let means = { lengths.iter().enumerate() }
            .map(|(motion, &length)| series(motion).known_means(0..length).map(Some));
        means.collect()
    }

    /// What became of it in finished motions: of the whole body first.
    pub(crate) fn reached(self, joints: &Tensor<4>) -> Vec<LabanComparison> {
        let terms = self.terms.into_iter();
        terms
            .map(|term| LabanComparison {
                end_effectors: term.end_effectors,
                baseline: term.baseline,
                target: term.target.features(),
                guided: term.features.measure(joints.clone()),
            })
            .collect()
    }
}

impl<'a> Objective<'a> {
    pub(super) fn new(
        normalization: &'a Normalization,
        baseline: Tensor<3>,
        lengths: &[usize],
        goals: &[Goals],
        guidance: &Guidance,
    ) -> Self {
        let baseline = joints(normalization.denormalize(baseline));
        Objective {
            normalization,
            targets: Targets::new(&baseline, lengths, goals, guidance),
        }
    }

    /// What became of it in finished motions, normalised: of the whole body first.
    pub(super) fn reached(self, motions: Tensor<3>) -> Vec<LabanComparison> {
        let joints = joints(self.normalization.denormalize(motions));
        self.targets.reached(&joints)
    }

    /// The means over time of the whole body's target, over the frames whose features are known.
    pub(super) fn told(&self, lengths: &[usize]) -> Vec<[Option<f32>; COMPONENTS]> {
        self.targets.told(lengths)
    }

    /// The loss of each motion, summed over components.
    pub(super) fn loss_of(&self, motions: Tensor<3>) -> Vec<f32> {
        let joints = joints(self.normalization.denormalize(motions));
        let values = host(self.targets.loss(joints));
        let components = values.chunks_exact(COMPONENTS);
        components.map(|loss| loss.iter().sum()).collect()
    }

    /// The loss, and its gradient back along a way. The way is asked for again only to find what broke.
    pub(super) fn gradient<'w, const D: usize>(
        &self,
        way: impl Fn() -> Way<'w, D>,
    ) -> Result<Gradient<D>, Broken> {
        let Way { leaf, clean, pull } = way();
        let (tracked, loss) = self.loss(&leaf, &clean);
        let values = host(loss.clone().inner());
        if let Some(place) = values.iter().position(|value| !value.is_finite()) {
            return Err(Broken {
                quantity: Quantity::Loss,
                component: Component::ALL[place % COMPONENTS],
                motion: place / COMPONENTS,
            });
        }
        let gradient = pull(slope(&tracked, loss.sum()));
        if let Some(motion) = first_not_finite(&gradient) {
            return Err(Broken {
                quantity: Quantity::Gradient,
                component: self.blame(way, motion),
                motion,
            });
        }
        let components = values.chunks_exact(COMPONENTS);
        Ok(Gradient {
            leaf,
            loss: components.map(|loss| loss.iter().sum()).collect(),
            gradient,
        })
    }

    /// The Laban loss `[batch, 4]` as a function of the tracked leaf, which comes first.
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

    /// The component whose gradient is not finite for a motion; the first where each is finite
    /// alone and only their sum is not.
    fn blame<'w, const D: usize>(&self, way: impl Fn() -> Way<'w, D>, motion: usize) -> Component {
        Component::ALL
            .into_iter()
            .find(|component| {
                let Way { leaf, clean, pull } = way();
                let (leaf, loss) = self.loss(&leaf, &clean);
                let loss = loss.narrow(0, motion, 1).narrow(1, component.index(), 1);
                first_not_finite(&pull(slope(&leaf, loss.sum()))).is_some()
            })
            .unwrap_or(Component::Weight)
    }
}

/// What each motion asks of every set of end-effectors that any of them names; the whole body's first.
fn by_end_effectors(
    goals: &[Goals],
    all: &EndEffectors,
) -> Vec<(EndEffectors, Vec<[Goal; COMPONENTS]>)> {
    let nothing = || vec![[const { Goal::Any }; COMPONENTS]; goals.len()];
    let mut sets = vec![(all.clone(), nothing())];
    for (motion, goals) in goals.iter().enumerate() {
        for term in goals.terms(all) {
            let place = sets.iter().position(|(set, _)| *set == term.end_effectors);
            let place = place.unwrap_or_else(|| {
                sets.push((term.end_effectors, nothing()));
                sets.len() - 1
            });
            let asked = sets[place].1[motion].iter_mut().zip(term.goals);
            for (all, goal) in asked.filter(|(_, goal)| *goal != Goal::Any) {
                *all = goal;
            }
        }
    }
    sets
}

/// The gradient of a loss with respect to a leaf: zeros where it does not depend on it.
fn slope(leaf: &Tensor<3>, loss: Tensor<1>) -> Tensor<3> {
    let gradient = match loss.is_tracked() {
        true => leaf.grad_remove(&mut loss.backward()),
        false => None,
    };
    gradient.unwrap_or_else(|| leaf.clone().inner().zeros_like())
}

/// The first motion whose numbers hold infinities or NaN.
fn first_not_finite<const D: usize>(rows: &Tensor<D>) -> Option<usize> {
    let motions = rows.dims()[0];
    let rows = rows.clone().reshape([motions as i64, -1]);
    // Zero times anything finite is zero.
    let marks = host((rows * 0.0).sum_dim(1));
    marks.iter().position(|mark| !mark.is_finite())
}

fn host(tensor: Tensor<2>) -> Vec<f32> {
    tensor.try_into_vec_as().expect("floats convert to f32")
}
