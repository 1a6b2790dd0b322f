//! What motions shall become, and how far they are from it.

use burn::tensor::Tensor;
use lamogen_laban::{COMPONENTS, Component, LabanFeatures, ScaleCurve, Target};
use lamogen_motion::{Normalization, joints};

use crate::error::Quantity;
use crate::guidance::Guidance;

/// Laban features to reach, and the loss of not reaching them.
pub(super) struct Objective<'a> {
    normalization: &'a Normalization,
    features: LabanFeatures,
    target: Target,
    /// Of the baseline, `[batch, frames, 4]`.
    pub(super) baseline: Tensor<3>,
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

impl<'a> Objective<'a> {
    pub(super) fn new(
        normalization: &'a Normalization,
        baseline: Tensor<3>,
        lengths: &[usize],
        scales: &[ScaleCurve],
        guidance: &Guidance,
    ) -> Self {
        let [_, frames, _] = baseline.dims();
        let features = LabanFeatures::new(&guidance.laban, frames, lengths, &baseline.device());
        let baseline = features.measure(joints(normalization.denormalize(baseline)));
        let target = Target::new(
            baseline.clone(),
            lengths,
            scales,
            guidance.divisor,
            guidance.emphasis,
        );
        Objective {
            normalization,
            features,
            target,
            baseline,
        }
    }

    /// Laban features of normalised motions, `[batch, frames, 4]`.
    pub(super) fn measure(&self, motions: Tensor<3>) -> Tensor<3> {
        self.features
            .measure(joints(self.normalization.denormalize(motions)))
    }

    /// The features to reach, `[batch, frames, 4]`.
    pub(super) fn target(&self) -> Tensor<3> {
        self.target.features()
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
        let features = self.measure(clean(leaf.clone()));
        (leaf, self.target.loss(features))
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
