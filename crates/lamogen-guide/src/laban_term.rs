//! The Laban features of a set of end-effectors as a term of the loss.

use burn::tensor::{Device, Tensor};
use lamogen_laban::{
    COMPONENTS, Component, EndEffectors, Goal, LabanFeatures, LabanTarget, LossDivisor,
};

use crate::guidance::Guidance;
use crate::loss_term::{LossTarget, LossTerm};

/// The Laban loss (paper, equation "Laban loss") of one set of end-effectors, for one batch of motions.
#[derive(Clone, Debug)]
pub struct LabanTerm {
    features: LabanFeatures,
    /// The measurement of the baselines, which may face elsewhere.
    baseline_features: LabanFeatures,
    goals: Vec<[Goal; COMPONENTS]>,
    divisor: LossDivisor,
    emphasis: [f32; COMPONENTS],
}

impl LabanTerm {
    /// Creates the term for a batch of motions. The guidance options give its measurement, divisor and emphasis;
    /// `end_effectors` replaces the end-effectors of the options.
    ///
    /// # Shapes
    ///
    /// - `frames`: the number of frames that the batch is padded to
    /// - `lengths`, `goals`: one for each motion
    ///
    /// # Panics
    ///
    /// If a motion has fewer than 4 frames or more than `frames`.
    pub fn new(
        end_effectors: EndEffectors,
        goals: Vec<[Goal; COMPONENTS]>,
        guidance: &Guidance,
        (frames, lengths): (usize, &[usize]),
        device: &Device,
    ) -> Self {
        let options = guidance.laban.with_end_effectors(end_effectors);
        let features = LabanFeatures::new(&options, frames, lengths, device);
        let [of_baseline, of_guided] = guidance.headings;
        LabanTerm {
            baseline_features: features.clone().with_heading(of_baseline),
            features: features.with_heading(of_guided),
            goals,
            divisor: guidance.divisor,
            emphasis: guidance.emphasis,
        }
    }
}

impl LossTerm for LabanTerm {
    fn name(&self) -> String {
        "Laban features".into()
    }

    fn value_name(&self, value: usize) -> String {
        Component::ALL[value].to_string()
    }

    fn measure(&self, joints: Tensor<4>, _lengths: &[usize]) -> Tensor<3> {
        self.features.measure(joints)
    }

    fn measure_baseline(&self, joints: Tensor<4>, _lengths: &[usize]) -> Tensor<3> {
        self.baseline_features.measure(joints)
    }

    fn target(&self, baseline: Tensor<3>, lengths: &[usize]) -> LossTarget {
        let target = LabanTarget::new(baseline, lengths, &self.goals, self.divisor, self.emphasis);
        LossTarget {
            values: target.features(),
            weight: target.weight(),
        }
    }
}
