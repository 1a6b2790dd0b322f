//! Terms of the loss that guidance lowers.
//!
//! ```text
//! joints of the baseline ──measure──▶ values ──target──▶ LossTarget: values to reach, weights
//! joints of a prediction ──measure──▶ values ──────────────▶ Σ ((values - target) · weight)²
//! ```

use std::fmt;
use std::sync::Arc;

use burn::tensor::{Device, Tensor};
use lamogen_motion::frame_mask;

use crate::error::GuideError;
use crate::host::first_non_finite;

/// One term of a loss: values that are measured on motions, the values to reach, and the weight of each difference.
///
/// Guidance adds the terms of [`Guidance::loss_terms`](crate::Guidance::loss_terms) to the Laban loss. The Laban loss
/// itself consists of such terms ([`LabanTerm`](crate::LabanTerm)). `lamogen-train` takes them too, with the motion of
/// the data in the place of the baseline. The loss of a motion is
///
/// ```text
/// Σ ((measured - target) · weight)²    over the motion's frames and values
/// ```
///
/// so if the product of a difference and its weight is 1 at one frame, the difference adds as much to the loss as a
/// Laban feature that is off by 100 % at one frame.
///
/// ```
/// use burn::tensor::Tensor;
/// use lamogen_guide::{LossTarget, LossTerm};
/// use lamogen_motion::Joint;
///
/// /// Keeps the head at a height above the floor.
/// #[derive(Debug)]
/// struct HeadHeight {
///     metres: f32,
/// }
///
/// impl LossTerm for HeadHeight {
///     fn name(&self) -> String {
///         "height of the head".into()
///     }
///
///     fn measure(&self, joints: Tensor<4>, _lengths: &[usize]) -> Tensor<3> {
///         let head = joints.narrow(2, Joint::Head as usize, 1).narrow(3, 1, 1);
///         head.squeeze_dim(3)
///     }
///
///     fn target(&self, baseline: Tensor<3>, _lengths: &[usize]) -> LossTarget {
///         LossTarget::constant(&[self.metres], 5.0, &baseline.device())
///     }
/// }
/// ```
pub trait LossTerm: fmt::Debug + Send + Sync {
    /// Returns the name of the term in errors and reports.
    fn name(&self) -> String;

    /// Returns the name of a value, counted from 0, for errors and reports.
    fn value_name(&self, value: usize) -> String {
        format!("value {} of {}", value + 1, self.name())
    }

    /// Measures the values of each frame of each motion. The function must be differentiable by autodiff: values and
    /// gradients must be finite for any finite joints (the gradient of `sqrt` at 0 is not; add a small number).
    ///
    /// # Shapes
    ///
    /// - `joints`: `[batch, frames, 22, 3]`, positions in metres in the order of [`Joint`](lamogen_motion::Joint), y
    ///   up, at [`FRAMES_PER_SECOND`](lamogen_motion::FRAMES_PER_SECOND); positions past a motion's length have no
    ///   meaning
    /// - `lengths`: the number of frames of each motion
    /// - output: `[batch, frames, values]`, with at least one value; values past a motion's length are ignored
    fn measure(&self, joints: Tensor<4>, lengths: &[usize]) -> Tensor<3>;

    /// Measures the values of the baselines. The default measures them as those of all motions.
    ///
    /// # Shapes
    ///
    /// As in [`measure`](Self::measure).
    fn measure_baseline(&self, joints: Tensor<4>, lengths: &[usize]) -> Tensor<3> {
        self.measure(joints, lengths)
    }

    /// Returns the values to reach, and the weight of each difference. It is called once, with the values measured on
    /// the baseline, `[batch, frames, values]`.
    fn target(&self, baseline: Tensor<3>, lengths: &[usize]) -> LossTarget;
}

/// The values that a [`LossTerm`] shall reach, and their weights.
///
/// Both have the axes `[batch, frames, values]`. An axis may also have the size 1; it is then broadcast.
#[derive(Clone, Debug)]
pub struct LossTarget {
    /// The values to reach.
    pub values: Tensor<3>,
    /// The factors on differences before they are squared; 0 where a value may be anything.
    pub weight: Tensor<3>,
}

impl LossTarget {
    /// Creates a target with the same values at all frames of all motions, and one weight.
    pub fn constant(values: &[f32], weight: f32, device: &Device) -> Self {
        LossTarget {
            values: Tensor::<1>::from_data(values, device).reshape([1, 1, values.len()]),
            weight: Tensor::full([1, 1, 1], weight, device),
        }
    }

    /// Keeps the weights of one frame, counted from 0, and sets those of all others to 0.
    pub fn at_frame(self, frame: usize, frames: usize) -> Self {
        let device = self.weight.device();
        let mut marks = vec![0.0; frames];
        if let Some(mark) = marks.get_mut(frame) {
            *mark = 1.0;
        }
        let marks = Tensor::<1>::from_data(&marks[..], &device).reshape([1, frames, 1]);
        LossTarget {
            weight: self.weight * marks,
            ..self
        }
    }
}

/// A list of loss terms that all motions of a run share.
///
/// Two lists are equal if they hold the same terms by pointer (`Arc::ptr_eq`), because the contents of a term are
/// unknown. Requests with equal guidance run together.
#[derive(Clone, Debug, Default)]
pub struct LossTerms(Vec<Arc<dyn LossTerm>>);

impl LossTerms {
    /// Returns the list with one more term.
    pub fn with(mut self, term: Arc<dyn LossTerm>) -> Self {
        self.0.push(term);
        self
    }

    /// Returns whether there is no term.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Iterates over the terms.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = &Arc<dyn LossTerm>> {
        self.0.iter()
    }
}

impl PartialEq for LossTerms {
    fn eq(&self, other: &Self) -> bool {
        let pairs = || self.0.iter().zip(&other.0);
        self.0.len() == other.0.len() && pairs().all(|(own, other)| Arc::ptr_eq(own, other))
    }
}

impl FromIterator<Arc<dyn LossTerm>> for LossTerms {
    fn from_iter<I: IntoIterator<Item = Arc<dyn LossTerm>>>(terms: I) -> Self {
        LossTerms(terms.into_iter().collect())
    }
}

/// The values of a [`LossTerm`] before and after guidance, and the values to reach. Each tensor is
/// `[batch, frames, values]`.
#[derive(Clone, Debug)]
pub struct TermComparison {
    /// The name of the term.
    pub name: String,
    /// The names of its values.
    pub value_names: Vec<String>,
    /// The values of the baseline.
    pub baseline: Tensor<3>,
    /// The values to reach.
    pub target: Tensor<3>,
    /// The factors on differences; 0 past each motion's length.
    pub weight: Tensor<3>,
    /// The values of the guided motions.
    pub guided: Tensor<3>,
}

/// A term with its target for one batch of motions.
#[derive(Clone, Debug)]
pub struct PreparedTerm {
    term: Arc<dyn LossTerm>,
    lengths: Vec<usize>,
    baseline: Tensor<3>,
    target: Tensor<3>,
    weight: Tensor<3>,
}

impl PreparedTerm {
    /// Measures a term on baselines and sets its target. `importance` multiplies the loss of the term.
    ///
    /// # Shapes
    ///
    /// - `joints`: `[batch, frames, 22, 3]`
    /// - `lengths`: the number of frames of each motion
    ///
    /// # Errors
    ///
    /// If the term's values or its target are of the wrong shape, or its target or weight is not finite.
    ///
    /// # Panics
    ///
    /// If a length is 0 or beyond the frames of the joints.
    pub fn new(
        term: Arc<dyn LossTerm>,
        joints: Tensor<4>,
        lengths: &[usize],
        importance: f32,
    ) -> Result<Self, GuideError> {
        let [batch, frames, ..] = joints.dims();
        let device = joints.device();
        let baseline = term.measure_baseline(joints, lengths);
        let shape = baseline.dims();
        let problem = |what: &str, expected: String, found: [usize; 3]| {
            Err(GuideError::LossTerm {
                term: term.name(),
                reason: format!("expected {what} of the shape {expected}, found {found:?}"),
                motion: None,
            })
        };
        if shape[..2] != [batch, frames] || shape[2] == 0 {
            let expected = format!("[{batch}, {frames}, 1 or more]");
            return problem("values", expected, shape);
        }
        let LossTarget { values, weight } = term.target(baseline.clone(), lengths);
        for (what, tensor) in [("a target", &values), ("weights", &weight)] {
            let found = tensor.dims();
            if !found
                .iter()
                .zip(shape)
                .all(|(&own, all)| own == all || own == 1)
            {
                return problem(
                    what,
                    format!("{shape:?}, or 1 in the place of an axis"),
                    found,
                );
            }
            if let Some(motion) = first_non_finite(tensor) {
                return Err(GuideError::LossTerm {
                    term: term.name(),
                    reason: format!("expected {what} of finite numbers, found infinities or NaN"),
                    // One row for all motions is no motion's.
                    motion: (found[0] == batch).then_some(motion),
                });
            }
        }
        let weight = (weight.to_device(&device) * importance.sqrt()).expand(shape);
        Ok(PreparedTerm {
            target: values.to_device(&device).expand(shape),
            weight: match frame_mask(lengths, frames, &device) {
                Some(mask) => weight * mask,
                None => weight,
            },
            lengths: lengths.to_vec(),
            baseline,
            term,
        })
    }

    /// Returns the loss of each value of each motion, `[batch, values]`.
    ///
    /// # Shapes
    ///
    /// - `joints`: `[batch, frames, 22, 3]`, as many frames as the baselines
    pub fn loss(&self, joints: Tensor<4>) -> Tensor<2> {
        let [batch, _, values] = self.target.dims();
        let measured = self.term.measure(joints, &self.lengths);
        ((measured - self.target.clone()) * self.weight.clone())
            .square()
            .sum_dim(1)
            .reshape([batch, values])
    }

    /// Returns how many values the term measures.
    pub(crate) fn values(&self) -> usize {
        self.target.dims()[2]
    }

    /// Returns the name of a value, for errors.
    pub(crate) fn value_name(&self, value: usize) -> String {
        self.term.value_name(value)
    }

    /// Returns the values to reach, `[batch, frames, values]`.
    pub(crate) fn target(&self) -> Tensor<3> {
        self.target.clone()
    }

    /// Returns the factors on differences, `[batch, frames, values]`; 0 past each motion's length.
    pub(crate) fn weight(&self) -> Tensor<3> {
        self.weight.clone()
    }

    /// Compares finished motions with the baselines and the target.
    ///
    /// # Shapes
    ///
    /// - `joints`: `[batch, frames, 22, 3]`, as many frames as the baselines
    pub fn compare(self, joints: Tensor<4>) -> TermComparison {
        let value_names = (0..self.values()).map(|value| self.value_name(value));
        TermComparison {
            name: self.term.name(),
            value_names: value_names.collect(),
            guided: self.term.measure(joints, &self.lengths),
            baseline: self.baseline,
            target: self.target,
            weight: self.weight,
        }
    }
}
