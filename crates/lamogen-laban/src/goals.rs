//! What Laban components shall become.

use std::fmt;

use crate::curve::ScaleCurve;
use crate::effectors::EndEffectors;
use crate::factor::{Factor, FactorError, words};
use crate::parts::PartScale;
use crate::series::{LabanSeries, mean};
use crate::tags::{COMPONENTS, Component, Scale, ScaleError};

/// What one Laban component shall become.
///
/// As text it is a [`Factor`], `peak=` or `mean=` with a number in the component's own unit, or `any`:
///
/// ```
/// use lamogen_laban::{Component, Factor, Goal};
///
/// assert_eq!(Goal::parse(Component::Weight, "strong")?, Goal::Factor(Factor::constant(1.5)?));
/// assert_eq!(Goal::parse(Component::Shape, "peak=0.9")?, Goal::Peak(0.9));
/// assert_eq!(Goal::parse(Component::Flow, "any")?, Goal::Any);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub enum Goal {
    /// The baseline, times a factor; a factor of 1 keeps it as it is.
    Factor(Factor),
    /// The baseline, scaled so that this is its largest value over time. A baseline at rest stays at rest.
    Peak(f32),
    /// The baseline, scaled so that this is its mean over time. A baseline at rest stays at rest.
    Mean(f32),
    /// These values, stretched to the motion's length: those of another motion, for instance.
    Series(Vec<f32>),
    /// Whatever comes of the others.
    Any,
}

/// What cannot be a goal.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[allow(missing_docs)]
pub enum GoalError {
    /// A factor.
    #[error(transparent)]
    Factor(#[from] FactorError),
    /// A peak, mean or value of a series that is negative, infinite or not a number.
    #[error("a {what} must be a finite number of at least 0, found {found}")]
    Value { what: &'static str, found: String },
    /// A series too short to be stretched.
    #[error("a series needs at least 4 frames, found {found}")]
    Series { found: usize },
    /// Shape of a part of the body.
    #[error(
        "Shape is of the whole body, not of {part}; of a part Weight, Time and Flow can be asked for"
    )]
    PartShape { part: String },
    /// An end-effector in two parts.
    #[error("expected parts of the body that have no end-effector in common, found {joint} in two")]
    Shared { joint: &'static str },
    /// A part beside a goal that the rest of the body cannot have.
    #[error(
        "expected factors on {component} where parts of the body have their own, found {component} {found}"
    )]
    Beside { component: Component, found: String },
    /// A factor on a body whose end-effectors are all in parts with a factor of their own.
    #[error(
        "{component} {found} is of what the parts leave, and they leave nothing: expected an end-effector in no part, or a part without {component}"
    )]
    NoRest { component: Component, found: String },
    /// Text that is no goal.
    #[error(
        "expected a number, a word ({}), keys such as \"0:1 1:1.5\" (seconds:factor), peak= or mean= with a number, or any; found {found:?}",
        words(.component)
    )]
    Text { component: Component, found: String },
    /// A part whose component is given twice.
    #[error(
        "{part}: expected at most one word or factor for each component, found two for {component}"
    )]
    Twice { part: String, component: Component },
    /// A key past the motion's end.
    #[error(transparent)]
    Scale(#[from] ScaleError),
    /// Text that is no part with its words.
    #[error(
        "expected a part of the body with words or factors of Weight, Time and Flow, such as \"arms:strong,sudden\" or \"legs:weight=0.7\", found {found:?}"
    )]
    Part { found: String },
    /// A word that is no part of the body.
    #[error("expected one of {expected}, found {found:?}")]
    BodyPart { expected: String, found: String },
}

impl Goal {
    /// No change.
    pub const KEEP: Goal = Goal::Factor(Factor::NEUTRAL);

    /// A goal from its text; see [`Goal`]. Words are tags of `component`.
    ///
    /// # Errors
    ///
    /// If the text is of another form, or a number is negative or not finite.
    pub fn parse(component: Component, text: &str) -> Result<Goal, GoalError> {
        let number = |what, text: &str| {
            let found = text.trim();
            let found = if found.is_empty() { "nothing" } else { found };
            found.parse().map_err(|_| GoalError::Value {
                what,
                found: found.into(),
            })
        };
        let lower = text.trim().to_lowercase();
        let goal = match lower.split_once('=') {
            Some(("peak", value)) => Goal::Peak(number("peak", value)?),
            Some(("mean", value)) => Goal::Mean(number("mean", value)?),
            None if lower == "any" => Goal::Any,
            _ => Goal::Factor(Factor::parse(component, text).map_err(|error| match error {
                FactorError::Word { found, component } if found == text.trim() => {
                    GoalError::Text { component, found }
                }
                error => error.into(),
            })?),
        };
        goal.check()?;
        Ok(goal)
    }

    /// Whether it is anything else than what was there before.
    pub fn changes(&self) -> bool {
        match self {
            Goal::Factor(factor) => factor.changes(),
            Goal::Peak(_) | Goal::Mean(_) | Goal::Series(_) => true,
            Goal::Any => false,
        }
    }

    /// Whether the numbers make sense.
    ///
    /// # Errors
    ///
    /// If one is negative or not finite, or a series is too short.
    fn check(&self) -> Result<(), GoalError> {
        let finite = |what, number: f32| match number.is_finite() && number >= 0.0 {
            true => Ok(()),
            false => Err(GoalError::Value {
                what,
                found: number.to_string(),
            }),
        };
        match self {
            Goal::Factor(_) | Goal::Any => Ok(()),
            Goal::Peak(peak) => finite("peak", *peak),
            Goal::Mean(mean) => finite("mean", *mean),
            Goal::Series(values) if values.len() < 4 => Err(GoalError::Series {
                found: values.len(),
            }),
            Goal::Series(values) => {
                let mut values = values.iter();
                values.try_for_each(|&value| finite("value of a series", value))
            }
        }
    }

    /// The values to reach for a baseline, frame by frame.
    pub(crate) fn target(&self, component: Component, baseline: &[f32]) -> Vec<f32> {
        let scaled = |asked: f32, found: f32| {
            let factor = if found > 0.0 { asked / found } else { 1.0 };
            baseline.iter().map(|value| value * factor).collect()
        };
        match self {
            Goal::Any => baseline.to_vec(),
            Goal::Factor(factor) => {
                let factors = factor.frames(baseline.len());
                baseline.iter().zip(factors).map(|(b, f)| b * f).collect()
            }
            Goal::Peak(peak) => scaled(*peak, baseline.iter().copied().fold(0.0, f32::max)),
            Goal::Mean(asked) => scaled(*asked, mean(baseline.iter().copied())),
            Goal::Series(values) => {
                // The first frames have no differences, however long the motion is.
                let first = component.first_frame().min(baseline.len());
                let rest = baseline.len() - first;
                let mut target = vec![0.0; first];
                target.extend(stretched(&values[component.first_frame()..], rest));
                target
            }
        }
    }
}

/// As many values over the same time, in straight lines between the given ones.
fn stretched(values: &[f32], count: usize) -> impl Iterator<Item = f32> + '_ {
    let last = values.len() - 1;
    (0..count).map(move |place| {
        let at = place as f64 * last as f64 / count.saturating_sub(1).max(1) as f64;
        let before = (at as usize).min(last);
        let (way, after) = (at - before as f64, (before + 1).min(last));
        let [before, after] = [before, after].map(|place| f64::from(values[place]));
        (before + way * (after - before)) as f32
    })
}

impl From<Factor> for Goal {
    fn from(factor: Factor) -> Self {
        Goal::Factor(factor)
    }
}

/// The text that [`Goal::parse`] reads, but for a series, which has none.
impl fmt::Display for Goal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Goal::Factor(factor) => factor.fmt(f),
            Goal::Peak(peak) => write!(f, "peak={peak}"),
            Goal::Mean(mean) => write!(f, "mean={mean}"),
            Goal::Series(values) => write!(f, "as a series of {} frames", values.len()),
            Goal::Any => f.write_str("any"),
        }
    }
}

/// What all components of a motion shall become, and parts of the body by themselves. The default keeps everything.
///
/// ```
/// use lamogen_laban::{BodyPart, Component, Goal, Goals, PartScale, Tag};
///
/// let goals = Goals::default()
///     .with(Component::Shape, Goal::Peak(1.2))
///     .with_part(PartScale::new(BodyPart::Arms).tag(Tag::Strong)?);
/// assert_eq!(goals.to_string(), "Shape peak=1.2, arms Weight 1.5");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Goals {
    whole: [Goal; COMPONENTS],
    parts: Vec<PartScale>,
}

/// Goals of some end-effectors.
#[derive(Clone, Debug, PartialEq)]
pub struct EndEffectorGoals {
    /// Whose Weight, Time and Flow are meant.
    pub end_effectors: EndEffectors,
    /// What the components shall become.
    pub goals: [Goal; COMPONENTS],
}

impl Goals {
    /// Returns goals that ask for nothing: every component may become anything.
    pub fn anything() -> Self {
        Component::ALL
            .into_iter()
            .fold(Goals::default(), |goals, component| {
                goals.with(component, Goal::Any)
            })
    }

    /// Each component of another motion, stretched in time.
    pub fn like(series: &LabanSeries) -> Goals {
        let whole =
            Component::ALL.map(|component| Goal::Series(series.component(component).collect()));
        Goals {
            whole,
            parts: Vec::new(),
        }
    }

    /// Sets the goal of a component.
    pub fn with(mut self, component: Component, goal: impl Into<Goal>) -> Self {
        self.whole[component.index()] = goal.into();
        self
    }

    /// Gives a part of the body factors of its own. What the whole body's factors say is then said of the rest of it, and of
    /// components that the part leaves open.
    pub fn with_part(mut self, part: PartScale) -> Self {
        self.parts.push(part);
        self
    }

    /// The goal of a component.
    pub fn of(&self, component: Component) -> &Goal {
        &self.whole[component.index()]
    }

    /// Those of all components of the whole body.
    pub fn whole(&self) -> &[Goal; COMPONENTS] {
        &self.whole
    }

    /// Whether a component of the whole body may become anything: because its goal says so, or because parts and the rest have
    /// goals instead.
    pub fn is_free(&self, component: Component) -> bool {
        let by_parts = !self.parts.is_empty() && component != Component::Shape;
        by_parts || *self.of(component) == Goal::Any
    }

    /// The parts that have factors of their own.
    pub fn parts(&self) -> &[PartScale] {
        &self.parts
    }

    /// The factors on the whole body: 1 where the goal is none.
    pub fn scale(&self) -> ScaleCurve {
        let factors = Component::ALL.map(|component| match self.of(component) {
            Goal::Factor(factor) => (component, factor.clone()),
            _ => (component, Factor::NEUTRAL),
        });
        let start = ScaleCurve::default();
        { factors.into_iter() }.fold(start, |all, (component, factor)| {
            all.with(component, factor)
        })
    }

    /// Whether anything shall change.
    pub fn change(&self) -> bool {
        self.whole.iter().any(Goal::changes) || self.parts.iter().any(PartScale::changes)
    }

    /// Whether the goals make sense for a motion of `frames` frames.
    ///
    /// # Errors
    ///
    /// If a number is negative or not finite, a key cannot act, parts overlap or stand beside goals that the rest of the body
    /// cannot have, or nothing is left of the end-effectors `all` for a factor of the whole body; the message says which.
    pub fn check(&self, frames: usize, all: &EndEffectors) -> Result<(), GoalError> {
        self.whole.iter().try_for_each(Goal::check)?;
        self.scale().check(frames)?;
        let mut seen = Vec::new();
        for part in &self.parts {
            part.check(frames)?;
            for joint in part.end_effectors().joints() {
                if seen.contains(&joint) {
                    let joint = joint.name();
                    return Err(GoalError::Shared { joint });
                }
                seen.push(joint);
            }
        }
        if self.parts.is_empty() {
            return Ok(());
        }
        let has_rest = all.without(&seen).is_some();
        for component in Component::EFFORTS {
            let goal = self.of(component);
            let found = goal.to_string();
            let is_heard = has_rest || self.parts.iter().any(|part| part.of(component).is_none());
            match goal {
                Goal::Factor(_) | Goal::Any if is_heard || !goal.changes() => {}
                Goal::Factor(_) | Goal::Any => return Err(GoalError::NoRest { component, found }),
                _ => return Err(GoalError::Beside { component, found }),
            }
        }
        Ok(())
    }

    /// What is asked of which end-effectors. The first term is that of the whole body, whose end-effectors are `all`; where
    /// parts have factors of their own, those of its Weight, Time and Flow are in a term of the rest.
    pub fn terms(&self, all: &EndEffectors) -> Vec<EndEffectorGoals> {
        let mut terms = vec![EndEffectorGoals {
            end_effectors: all.clone(),
            goals: self.whole.clone(),
        }];
        if self.parts.is_empty() {
            return terms;
        }
        let efforts_as = |goals: &mut [Goal; COMPONENTS], of: &dyn Fn(Component) -> Goal| {
            for component in Component::EFFORTS {
                goals[component.index()] = of(component);
            }
        };
        let nothing = [const { Goal::Any }; COMPONENTS];
        let own = self
            .parts
            .iter()
            .flat_map(|part| part.end_effectors().joints());
        let own: Vec<_> = own.collect();
        let rest = all.without(&own);
        // Parts may be of joints that the whole body's features do not look at.
        if rest.as_ref() != Some(all) {
            efforts_as(&mut terms[0].goals, &|_| Goal::Any);
            if let Some(end_effectors) = rest {
                let mut goals = nothing.clone();
                efforts_as(&mut goals, &|component| self.of(component).clone());
                terms.push(EndEffectorGoals {
                    end_effectors,
                    goals,
                });
            }
        }
        for part in &self.parts {
            let mut goals = nothing.clone();
            efforts_as(&mut goals, &|component| match part.of(component) {
                Some(factor) => Goal::Factor(factor.clone()),
                None => self.of(component).clone(),
            });
            terms.push(EndEffectorGoals {
                end_effectors: part.end_effectors().clone(),
                goals,
            });
        }
        terms
    }
}

impl Default for Goals {
    fn default() -> Self {
        ScaleCurve::default().into()
    }
}

impl From<ScaleCurve> for Goals {
    fn from(scale: ScaleCurve) -> Self {
        Goals {
            whole: Component::ALL.map(|component| Goal::Factor(scale.of(component).clone())),
            parts: Vec::new(),
        }
    }
}

impl From<Scale> for Goals {
    fn from(scale: Scale) -> Self {
        ScaleCurve::from(scale).into()
    }
}

/// The components that shall change, or may, with their goals; then the parts with theirs.
impl fmt::Display for Goals {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let said =
            { Component::ALL.into_iter() }.filter_map(|component| match self.of(component) {
                goal if *goal == Goal::Any || goal.changes() => Some(format!("{component} {goal}")),
                _ => None,
            });
        let said: Vec<String> = said
            .chain(self.parts.iter().map(PartScale::to_string))
            .collect();
        match said.is_empty() {
            true => f.pad("no change"),
            false => f.pad(&said.join(", ")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effectors::BodyPart;
    use crate::tags::Tag;
    use lamogen_motion::Joint;

    const BASELINE: [f32; 6] = [0.0, 1.0, 2.0, 4.0, 2.0, 3.0];

    fn target(goal: Goal) -> Vec<f32> {
        goal.target(Component::Weight, &BASELINE)
    }

    #[test]
    fn peaks_and_means_scale_the_baseline() {
        assert_eq!(target(Goal::Peak(2.0)), [0.0, 0.5, 1.0, 2.0, 1.0, 1.5]);
        assert_eq!(target(Goal::Mean(4.0)), BASELINE.map(|value| 2.0 * value));
        assert_eq!(target(Goal::Any), BASELINE);
        assert_eq!(
            Goal::Peak(2.0).target(Component::Shape, &[0.0; 4]),
            [0.0; 4]
        );
    }

    #[test]
    fn a_series_is_stretched_behind_the_frames_without_differences() {
        let series = Goal::Series(vec![9.0, 1.0, 3.0, 5.0]);
        let found = series.target(Component::Weight, &[7.0; 6]);
        assert_eq!(found, [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]);
        // Flow begins with the fourth frame, Shape with the first.
        let flow = series.target(Component::Flow, &[7.0; 5]);
        assert_eq!(flow, [0.0, 0.0, 0.0, 5.0, 5.0]);
        let shape = series.target(Component::Shape, &[7.0; 4]);
        assert_eq!(shape, [9.0, 1.0, 3.0, 5.0]);
        assert_eq!(series.target(Component::Flow, &[7.0; 2]), [0.0, 0.0]);
        assert_eq!(series.target(Component::Shape, &[7.0]), [9.0]);
    }

    #[test]
    fn text_round_trips() {
        for text in ["1.5", "0:1 ~ 1:0.5", "peak=0.25", "mean=1", "any"] {
            let goal = Goal::parse(Component::Weight, text).unwrap();
            assert_eq!(goal.to_string(), text);
        }
        for (text, part) in [
            (
                "peak=-1",
                "peak must be a finite number of at least 0, found -1",
            ),
            ("mean=inf", "found inf"),
            ("peak=", "found nothing"),
            (
                "max=1",
                "peak= or mean= with a number, or any; found \"max=1\"",
            ),
            ("heavy", "a word (light, strong)"),
            ("0:heavy", "expected a number or one of light, strong"),
            ("sudden", "Time"),
        ] {
            let message = Goal::parse(Component::Weight, text)
                .unwrap_err()
                .to_string();
            assert!(message.contains(part), "{text}: {message}");
        }
    }

    #[test]
    fn parts_take_their_end_effectors_from_the_rest() {
        let all = EndEffectors::default();
        let strong = PartScale::new(BodyPart::Arms).tag(Tag::Strong).unwrap();
        let goals = Goals::from(Scale::from_tags(&[Tag::Sudden, Tag::Far]).unwrap());
        let terms = goals.clone().with_part(strong).terms(&all);
        let [whole, rest, arms] = &terms[..] else {
            panic!("{terms:?}");
        };
        assert_eq!(whole.end_effectors, all);
        assert_eq!(whole.goals[..3], [Goal::Any, Goal::Any, Goal::Any]);
        assert_eq!(whole.goals[3], Factor::constant(1.5).unwrap().into());
        let joints: Vec<Joint> = rest.end_effectors.joints().collect();
        use Joint::*;
        assert_eq!(joints, [LeftFoot, RightFoot, Head, Spine3]);
        assert_eq!(rest.goals[0], Goal::KEEP);
        // The arms leave Time open, so that it is that of the whole.
        let sudden = Goal::from(Factor::constant(1.2).unwrap());
        assert_eq!(rest.goals[1], sudden);
        assert_eq!(arms.goals[0], Factor::constant(1.5).unwrap().into());
        assert_eq!(arms.goals[1..], [sudden.clone(), Goal::KEEP, Goal::Any]);
        assert_eq!(goals.terms(&all).len(), 1);

        // Elbows are none of the whole body's end-effectors.
        let elbows = EndEffectors::new([(LeftElbow, 1.0), (RightElbow, 1.0)]).unwrap();
        let terms = goals.with_part(PartScale::new(elbows)).terms(&all);
        assert_eq!(terms.len(), 2);
        assert_eq!(terms[0].goals[1], sudden);
    }

    #[test]
    fn goals_that_make_no_sense_are_refused() {
        let all = EndEffectors::default();
        let limbs = || {
            let parts = [
                BodyPart::Arms,
                BodyPart::Legs,
                BodyPart::Head,
                BodyPart::Torso,
            ];
            let strong = |part| PartScale::new(part).tag(Tag::Strong).unwrap();
            parts
                .map(strong)
                .into_iter()
                .fold(Goals::default(), Goals::with_part)
        };
        let arms = || PartScale::new(BodyPart::Arms).tag(Tag::Strong).unwrap();
        let left = || PartScale::new(BodyPart::LeftArm).tag(Tag::Light).unwrap();
        let weight = |goal: Goal| Goals::default().with(Component::Weight, goal);
        for (goals, part) in [
            (
                Goals::default().with_part(arms()).with_part(left()),
                "left_wrist in two",
            ),
            (
                weight(Goal::Peak(1.0)).with_part(arms()),
                "factors on Weight",
            ),
            (weight(Goal::Peak(f32::NAN)), "NaN"),
            (
                limbs().with(Component::Weight, Factor::constant(0.5).unwrap()),
                "Weight 0.5 is of what the parts leave",
            ),
            (
                weight(Goal::Series(vec![1.0; 3])),
                "at least 4 frames, found 3",
            ),
            (weight(Goal::Series(vec![1.0, 2.0, -3.0, 1.0])), "found -3"),
        ] {
            let message = goals.check(40, &all).unwrap_err().to_string();
            assert!(message.contains(part), "{message}");
        }
        let shape = Goals::default().with(Component::Shape, Goal::Peak(1.0));
        assert_eq!(shape.with_part(arms()).check(40, &all), Ok(()));
        // All parts leave Time open, so that they hear what is said of the whole.
        let sudden = Factor::constant(1.2).unwrap();
        let goals = limbs().with(Component::Time, sudden);
        assert_eq!(goals.check(40, &all), Ok(()));
    }
}
