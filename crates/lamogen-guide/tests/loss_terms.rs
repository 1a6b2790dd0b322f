//! Loss terms besides the Laban features.

mod batches;
mod toy;

use std::sync::Arc;

use batches::batch;
use burn::tensor::{Device, Tensor};
use lamogen_guide::{
    Guidance, GuideError, LabanTerm, LossTarget, LossTerm, LossTerms, PreparedTerm, Quantity,
    Sampler,
};
use lamogen_laban::{Component, Goals, LabanFeatures, LabanTarget, Scale};
use lamogen_model::DenoiserInput;
use lamogen_motion::{JOINTS, Joint, POSE_FEATURES};
use toy::{ToyDenoiser, ToyNetwork, normalization};

/// A network whose output is a swing in all features, times the embedding.
struct SwingNetwork;

impl ToyNetwork for SwingNetwork {
    fn output(&self, input: DenoiserInput) -> Tensor<3> {
        let [_, frames, _] = input.x_t.dims();
        let swing = (0..frames * POSE_FEATURES)
            .map(|i| (0.5 * (i / POSE_FEATURES) as f32 + (i % POSE_FEATURES) as f32).sin());
        let swing: Vec<f32> = swing.collect();
        let swing = Tensor::<1>::from_floats(&swing[..], &Device::flex());
        swing.reshape([1, frames, POSE_FEATURES]) * input.embedding.unsqueeze_dim::<3>(2)
    }
}

/// The distance between the hands.
#[derive(Debug)]
struct HandDistance {
    /// The number that is added to the squared distance.
    shift: f32,
    target: f32,
    values: usize,
}

impl Default for HandDistance {
    fn default() -> Self {
        HandDistance {
            shift: 1e-6,
            target: 0.9,
            values: 1,
        }
    }
}

impl LossTerm for HandDistance {
    fn name(&self) -> String {
        "distance of the hands".into()
    }

    fn measure(&self, joints: Tensor<4>, _lengths: &[usize]) -> Tensor<3> {
        let [left, right] = [Joint::LeftWrist, Joint::RightWrist]
            .map(|joint| joints.clone().narrow(2, joint.index(), 1));
        let squares = (left - right).square().sum_dim(3).squeeze_dim::<3>(3);
        (squares + self.shift).sqrt().repeat_dim(2, self.values)
    }

    fn target(&self, baseline: Tensor<3>, _lengths: &[usize]) -> LossTarget {
        LossTarget::constant(&[self.target], 4.0, &baseline.device())
    }
}

fn with(term: HandDistance) -> Guidance {
    Guidance {
        loss_terms: LossTerms::default().with(Arc::new(term)),
        ..Guidance::fast()
    }
}

fn guided(guidance: &Guidance) -> Result<lamogen_guide::GuidedMotions, GuideError> {
    let (network, normalization) = (ToyDenoiser(SwingNetwork), normalization(0.3));
    let batch = batch(&[40, 24], 40);
    let sampler = Sampler::new(&network, &normalization, 20).unwrap();
    let baseline = sampler.baseline(&batch, &mut ()).unwrap();
    let goals = [Goals::anything(), Goals::anything()];
    sampler.guided(&batch, baseline, &goals, guidance, &mut ())
}

fn host<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor.try_into_vec_as().unwrap()
}

/// Returns the joints of two moving motions, `[2, frames, 22, 3]`. The last 4 frames of the second motion hold
/// `padding`.
fn joints(frames: usize, padding: f32) -> Tensor<4> {
    let value = |i: usize| match (i / (JOINTS * 3 * frames), i / (JOINTS * 3) % frames) {
        (1, frame) if frame >= frames - 4 => padding,
        (_, frame) => (0.3 * frame as f32 + (i % (JOINTS * 3)) as f32).sin(),
    };
    let values: Vec<f32> = (0..2 * frames * JOINTS * 3).map(value).collect();
    Tensor::<1>::from_floats(&values[..], &Device::flex()).reshape([2, frames, JOINTS, 3])
}

#[test]
fn guidance_lowers_the_loss_of_a_custom_term_and_reports_it() {
    let result = guided(&with(HandDistance::default())).unwrap();
    let [term] = &result.terms[..] else {
        panic!("expected one term")
    };
    assert_eq!(term.name, "distance of the hands");
    assert_eq!(term.value_names, ["value 1 of distance of the hands"]);
    let [before, after] = [&term.baseline, &term.guided].map(|values| {
        let errors = (values.clone() - term.target.clone()) * term.weight.clone();
        let losses = host(errors.square().sum_dim(1));
        assert_eq!(losses.len(), 2);
        losses
    });
    for (before, after) in before.iter().zip(&after) {
        assert!(*after < 0.7 * before, "{before} {after}");
    }
    // The term is the only one with a loss, so the reported loss of the last step is that of the term.
    let last = result.loss.last().unwrap();
    assert!(
        last.iter()
            .zip(&after)
            .all(|(loss, after)| *loss > 0.5 * after)
    );
    // Without the term the loss is 0.
    let without = guided(&Guidance::fast()).unwrap();
    assert!(without.terms.is_empty());
    assert!(without.loss.iter().flatten().all(|loss| *loss == 0.0));
}

#[test]
fn frames_past_a_motions_length_are_ignored() {
    let losses = [0.0, 7.0].map(|padding| {
        let term = Arc::new(HandDistance::default());
        let prepared = PreparedTerm::new(term, joints(20, padding), &[20, 16], 1.0).unwrap();
        host(prepared.loss(joints(20, padding)))
    });
    assert_eq!(losses[0], losses[1]);
    assert!(losses[0].iter().all(|loss| *loss > 0.0));
}

#[test]
fn the_laban_term_is_the_laban_loss() {
    let lengths = [20, 16];
    let (before, after) = (joints(20, 0.0), joints(20, 0.0) * 1.3);
    let guidance = Guidance::precise();
    let scale = Scale::new([1.5, 0.8, 1.2, 0.5]).unwrap();
    let goals = Component::ALL.map(|component| {
        let curve = lamogen_laban::ScaleCurve::from(scale);
        curve.of(component).clone().into()
    });
    let goals = vec![goals.clone(), goals];
    let features = LabanFeatures::new(&guidance.laban, 20, &lengths, &Device::flex());
    let (divisor, emphasis) = (guidance.divisor, guidance.emphasis);
    let target = LabanTarget::new(
        features.measure(before.clone()),
        &lengths,
        &goals,
        divisor,
        emphasis,
    );
    let expected = host(target.loss(features.measure(after.clone())));

    let all = guidance.laban.end_effectors.clone();
    let term = LabanTerm::new(all, goals, &guidance, (20, &lengths), &Device::flex());
    let prepared = PreparedTerm::new(Arc::new(term), before, &lengths, 1.0).unwrap();
    assert_eq!(host(prepared.loss(after)), expected);
}

#[test]
fn errors_of_invalid_terms_say_what_is_wrong() {
    /// A term that measures the first frame alone, so that its values have the wrong shape.
    #[derive(Debug)]
    struct OneFrameTerm;
    impl LossTerm for OneFrameTerm {
        fn name(&self) -> String {
            "flat".into()
        }
        fn measure(&self, joints: Tensor<4>, _lengths: &[usize]) -> Tensor<3> {
            joints.narrow(1, 0, 1).narrow(2, 0, 1).squeeze_dim(2)
        }
        fn target(&self, baseline: Tensor<3>, _lengths: &[usize]) -> LossTarget {
            LossTarget::constant(&[0.0], 1.0, &baseline.device())
        }
    }
    let flat = Guidance {
        loss_terms: LossTerms::default().with(Arc::new(OneFrameTerm)),
        ..Guidance::fast()
    };
    let infinite = with(HandDistance {
        target: f32::INFINITY,
        ..HandDistance::default()
    });
    let wide = HandDistance {
        values: 3,
        ..HandDistance::default()
    };
    for (guidance, words) in [
        (&flat, ["`flat`", "[2, 40, 1 or more]", "[2, 1, 3]"]),
        (
            &infinite,
            [
                "`distance of the hands`",
                "a target of finite numbers",
                "infinities",
            ],
        ),
    ] {
        let message = guided(guidance).unwrap_err().to_string();
        assert!(words.iter().all(|word| message.contains(word)), "{message}");
    }
    // A target with one value is broadcast to three values.
    assert_eq!(guided(&with(wide)).unwrap().terms[0].value_names.len(), 3);
}

#[test]
fn the_error_of_a_non_finite_loss_names_its_value() {
    // The square root of a negative number is NaN.
    let negative = with(HandDistance {
        shift: -1e3,
        ..HandDistance::default()
    });
    let error = guided(&negative).unwrap_err();
    assert!(
        matches!(
            error,
            GuideError::NotFinite {
                quantity: Quantity::Loss,
                motion: 0,
                ..
            }
        ),
        "{error}"
    );
    let message = error.to_string();
    assert!(
        message.contains("loss of value 1 of distance of the hands"),
        "{message}"
    );
}

/// Wants the second motion's hands infinitely far apart.
#[derive(Debug)]
struct SecondTooFar;

impl LossTerm for SecondTooFar {
    fn name(&self) -> String {
        "second".into()
    }

    fn measure(&self, joints: Tensor<4>, lengths: &[usize]) -> Tensor<3> {
        HandDistance::default().measure(joints, lengths)
    }

    fn target(&self, baseline: Tensor<3>, _lengths: &[usize]) -> LossTarget {
        let values = Tensor::<1>::from_floats([1.0, f32::INFINITY], &baseline.device());
        LossTarget {
            values: values.reshape([2, 1, 1]),
            ..LossTarget::constant(&[0.0], 1.0, &baseline.device())
        }
    }
}

#[test]
fn a_target_that_is_not_finite_is_one_motions_fault() {
    let guidance = Guidance {
        loss_terms: LossTerms::default().with(Arc::new(SecondTooFar)),
        ..Guidance::fast()
    };
    assert_eq!(guided(&guidance).unwrap_err().motion(), Some(1));
}

#[test]
fn lists_are_equal_if_they_hold_the_same_terms() {
    let term: Arc<dyn LossTerm> = Arc::new(HandDistance::default());
    let other: Arc<dyn LossTerm> = Arc::new(HandDistance::default());
    let list = |term: &Arc<dyn LossTerm>| LossTerms::default().with(term.clone());
    assert_eq!(list(&term), list(&term));
    assert_ne!(list(&term), list(&other));
    assert_ne!(list(&term), LossTerms::default());
}
