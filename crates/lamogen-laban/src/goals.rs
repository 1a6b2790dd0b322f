//! The goals of a motion: those of the whole body, and those of its parts.

use std::fmt;
use std::ops::Range;

use lamogen_motion::FRAMES_PER_SECOND;

use crate::curve::ScaleCurve;
use crate::effectors::EndEffectors;
use crate::factor::Factor;
use crate::goal::{Goal, GoalTurn};
use crate::goal_error::GoalError;
use crate::parts::PartScale;
use crate::series::LabanSeries;
use crate::tags::{COMPONENTS, Component, Scale};

/// The goals of one motion: one for each component of the whole body, and factors on parts of the body. The default
/// keeps everything.
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
    /// Goals that hold in the place of these from a frame on, in the order of the frames. They have no later goals of their
    /// own.
    later: Vec<(usize, Goals)>,
    /// The numbers of frames in which the goals set in and end: see [`Goals::eased`].
    ease: [usize; 2],
}

/// The goals of one set of end-effectors.
#[derive(Clone, Debug, PartialEq)]
pub struct EndEffectorGoals {
    /// The end-effectors of which Weight, Time and Flow are measured.
    pub end_effectors: EndEffectors,
    /// The goal of each component, in the order of [`Component::ALL`].
    pub goals: [Goal; COMPONENTS],
}

impl Goals {
    /// Returns goals that ask for nothing: every component may take any values.
    pub fn anything() -> Self {
        Component::ALL
            .into_iter()
            .fold(Goals::default(), |goals, component| {
                goals.with(component, Goal::Any)
            })
    }

    /// Returns the goals to reach the features of another motion, stretched in time.
    pub fn like(series: &LabanSeries) -> Goals {
        let whole =
            Component::ALL.map(|component| Goal::Series(series.component(component).collect()));
        Goals {
            whole,
            parts: Vec::new(),
            later: Vec::new(),
            ease: [0, 0],
        }
    }

    /// Sets the goal of a component.
    pub fn with(mut self, component: Component, goal: impl Into<Goal>) -> Self {
        self.whole[component.index()] = goal.into();
        self
    }

    /// Adds a part of the body with factors of its own. The goals of the whole body then hold for the rest of the body,
    /// and for the components of the part that have no factor.
    pub fn with_part(mut self, part: PartScale) -> Self {
        self.parts.push(part);
        self
    }

    /// Sets the goals that hold in the place of these from a frame of the motion on, as the goals of a second sentence do. The
    /// frames from there to the end, or to those of the next such goals, are treated as a motion of their own: a peak is the
    /// peak among them, and factors over time begin with them.
    ///
    /// ```
    /// use lamogen_laban::{Goals, Scale, Tag};
    ///
    /// let strong = Goals::from(Scale::from_tags(&[Tag::Strong])?);
    /// let goals = Goals::default().then(60, strong);
    /// assert_eq!(goals.to_string(), "no change; from 3 s Weight 1.5");
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn then(mut self, frame: usize, mut goals: Goals) -> Self {
        let later = std::mem::take(&mut goals.later);
        self.later.push((frame, goals));
        let later = later.into_iter();
        self.later
            .extend(later.map(|(start, goals)| (frame + start, goals)));
        self
    }

    /// Lets the goals set in and end gradually: the values to reach pass from those of the baseline to those of the goals in so many
    /// frames at the beginning, and back in so many at the end. Of goals that hold one after another, these are the beginning of
    /// the first and the end of the last.
    pub fn eased(mut self, [begin, end]: [usize; 2]) -> Self {
        self.ease[0] = begin;
        match self.later.last_mut() {
            Some((_, last)) => last.ease[1] = end,
            None => self.ease[1] = end,
        }
        self
    }

    /// Returns the goals of some of a motion's `frames` frames, as if these were a motion of their own. Peaks and means stay as they
    /// are: see [`for_baseline`](Self::for_baseline).
    ///
    /// # Panics
    ///
    /// If the section is empty or reaches beyond the frames.
    pub fn section(&self, section: Range<usize>, frames: usize) -> Goals {
        assert!(!section.is_empty() && section.end <= frames);
        let segments = self.segments_within(frames).into_iter();
        let within = segments.filter(|(own, _)| own.start < section.end && section.start < own.end);
        let sections = within.map(|(own, goals)| {
            let frames = own.start.max(section.start)..own.end.min(section.end);
            let eases = [frames.start == own.start, frames.end == own.end];
            let place = frames.start - section.start;
            let frames = frames.start - own.start..frames.end - own.start;
            (place, goals.segment_section(&frames, own.len(), eases))
        });
        Goals::in_turn(sections)
    }

    /// Returns the first goals for some of the frames for which they hold. They set in or end gradually where these frames begin or
    /// end as those do.
    fn segment_section(&self, section: &Range<usize>, frames: usize, eases: [bool; 2]) -> Goals {
        let goal = |component: Component| {
            self.whole[component.index()].section(component, section, frames)
        };
        let ease = |end: usize| if eases[end] { self.ease[end] } else { 0 };
        Goals {
            whole: Component::ALL.map(goal),
            parts: { self.parts.iter() }
                .map(|part| part.section(section))
                .collect(),
            later: Vec::new(),
            ease: [ease(0), ease(1)],
        }
    }

    /// Turns peaks and means into the factors that they mean for a baseline, so that they hold for sections of it.
    pub fn for_baseline(&self, baseline: &LabanSeries) -> Goals {
        let segments = self.segments_within(baseline.frames().len()).into_iter();
        Goals::in_turn(segments.map(|(frames, goals)| {
            let start = frames.start;
            let baseline = baseline.section(frames);
            let goal = |component: Component| {
                let values: Vec<f32> = baseline.component(component).collect();
                goals.whole[component.index()].for_baseline(&values)
            };
            let goals = Goals {
                whole: Component::ALL.map(goal),
                later: Vec::new(),
                ..goals.clone()
            };
            (start, goals)
        }))
    }

    /// Returns the goals that hold one after another in a motion of `frames` frames, each with its frames.
    fn segments_within(&self, frames: usize) -> Vec<(Range<usize>, &Goals)> {
        let ends = self.later.iter().map(|(start, _)| *start).chain([frames]);
        let segments = self.segments().zip(ends);
        segments
            .map(|((start, goals), end)| (start.min(frames)..end.min(frames), goals))
            .collect()
    }

    /// Joins goals that hold one after another, each from a frame on; the first from frame 0.
    fn in_turn(goals: impl Iterator<Item = (usize, Goals)>) -> Goals {
        { goals }
            .reduce(|(_, first), (start, goals)| (0, first.then(start, goals)))
            .map(|(_, goals)| goals)
            .unwrap_or_default()
    }

    /// Returns the goals that hold one after another, each with its first frame.
    pub fn segments(&self) -> impl Iterator<Item = (usize, &Goals)> {
        let later = self.later.iter();
        [(0, self)]
            .into_iter()
            .chain(later.map(|(start, goals)| (*start, goals)))
    }

    /// Returns the whole body's goal for a component. Of goals that hold one after another, it is the first one, as in the
    /// other functions that do not say otherwise.
    pub fn of(&self, component: Component) -> &Goal {
        &self.whole[component.index()]
    }

    /// Returns the whole body's goals for all components, in the order of [`Component::ALL`].
    pub fn whole(&self) -> &[Goal; COMPONENTS] {
        &self.whole
    }

    /// Returns whether a component of the whole body may take any values throughout, because its goal is [`Goal::Any`] or
    /// because the parts and the rest of the body have goals instead.
    pub fn is_free(&self, component: Component) -> bool {
        self.segments().all(|(_, goals)| {
            let by_parts = !goals.parts.is_empty() && component != Component::Shape;
            by_parts || *goals.of(component) == Goal::Any
        })
    }

    /// Returns the parts of the body that have factors of their own.
    pub fn parts(&self) -> &[PartScale] {
        &self.parts
    }

    /// Returns the factors on the whole body; a component whose goal is no factor has the factor 1.
    pub fn scale(&self) -> ScaleCurve {
        let factors = Component::ALL.map(|component| match self.of(component) {
            Goal::Factor(factor) => (component, factor.clone()),
            _ => (component, Factor::NEUTRAL),
        });
        let start = ScaleCurve::default();
        { factors.into_iter() }.fold(start, |curve, (component, factor)| {
            curve.with(component, factor)
        })
    }

    /// Returns whether any goal of the whole body or of a part asks for a change, at any time.
    pub fn change(&self) -> bool {
        self.segments().any(|(_, goals)| {
            goals.whole.iter().any(Goal::changes) || goals.parts.iter().any(PartScale::changes)
        })
    }

    /// Checks the goals for a motion of `frames` frames. `all` are the end-effectors of the whole body.
    ///
    /// # Errors
    ///
    /// If a number is negative or not finite, a key cannot act, two parts overlap, there are parts and the whole body
    /// has a goal that the rest of the body cannot have, or the whole body has a factor but the parts leave none of the
    /// end-effectors `all` for it. The message says which.
    pub fn check(&self, frames: usize, all: &EndEffectors) -> Result<(), GoalError> {
        let starts: Vec<usize> = self.segments().map(|(start, _)| start).collect();
        let ends = starts[1..].iter().copied().chain([frames]);
        for ((start, goals), end) in self.segments().zip(ends) {
            if start >= end {
                return Err(GoalError::Turn { start, frames });
            }
            goals.check_segment(end - start, all)?;
        }
        Ok(())
    }

    /// Checks the first goals for a segment of `frames` frames.
    fn check_segment(&self, frames: usize, all: &EndEffectors) -> Result<(), GoalError> {
        self.whole.iter().try_for_each(Goal::check)?;
        self.scale().check(frames)?;
        let mut part_joints = Vec::new();
        for part in &self.parts {
            part.check(frames)?;
            for joint in part.end_effectors().joints() {
                if part_joints.contains(&joint) {
                    let joint = joint.name();
                    return Err(GoalError::Shared { joint });
                }
                part_joints.push(joint);
            }
        }
        if self.parts.is_empty() {
            return Ok(());
        }
        let has_rest = all.without(&part_joints).is_some();
        for component in Component::EFFORTS {
            let goal = self.of(component);
            let found = goal.to_string();
            // The goal has an effect where end-effectors are left to it, or where a part has no factor of its own.
            let has_effect = has_rest || self.parts.iter().any(|part| part.of(component).is_none());
            match goal {
                Goal::Factor(_) | Goal::Any if has_effect || !goal.changes() => {}
                Goal::Factor(_) | Goal::Any => return Err(GoalError::NoRest { component, found }),
                _ => return Err(GoalError::Beside { component, found }),
            }
        }
        Ok(())
    }

    /// Returns the goals of each set of end-effectors. The first term is that of the whole body, with the end-effectors
    /// `all`. Where parts have factors of their own, the whole body's goals for Weight, Time and Flow move to a term of
    /// the rest of the body.
    pub fn terms(&self, all: &EndEffectors) -> Vec<EndEffectorGoals> {
        if self.later.is_empty() && self.ease == [0, 0] {
            return self.segment_terms(all);
        }
        let segments: Vec<(usize, [usize; 2], Vec<EndEffectorGoals>)> = { self.segments() }
            .map(|(start, goals)| (start, goals.ease, goals.segment_terms(all)))
            .collect();
        let mut sets: Vec<&EndEffectors> = Vec::new();
        for term in segments.iter().flat_map(|(_, _, terms)| terms) {
            if !sets.contains(&&term.end_effectors) {
                sets.push(&term.end_effectors);
            }
        }
        let in_turn = |set: &EndEffectors, component: Component| {
            let turns = segments.iter().map(|(start, ease, terms)| {
                let mut terms = terms.iter().filter(|term| term.end_effectors == *set);
                // A segment may lack a set, or have two terms of one: then it is a part that is all of the rest.
                let goals = terms.find_map(|term| match &term.goals[component.index()] {
                    Goal::Any => None,
                    goal => Some(goal.clone()),
                });
                GoalTurn {
                    start: *start,
                    ease: *ease,
                    goal: goals.unwrap_or(Goal::Any),
                }
            });
            Goal::InTurn(turns.collect())
        };
        let terms = sets.into_iter().map(|set| EndEffectorGoals {
            end_effectors: set.clone(),
            goals: Component::ALL.map(|component| in_turn(set, component)),
        });
        terms.collect()
    }

    /// Returns the goals of each set of end-effectors for the first goals.
    fn segment_terms(&self, all: &EndEffectors) -> Vec<EndEffectorGoals> {
        let mut terms = vec![EndEffectorGoals {
            end_effectors: all.clone(),
            goals: self.whole.clone(),
        }];
        if self.parts.is_empty() {
            return terms;
        }
        let set_efforts = |goals: &mut [Goal; COMPONENTS], goal_of: &dyn Fn(Component) -> Goal| {
            for component in Component::EFFORTS {
                goals[component.index()] = goal_of(component);
            }
        };
        let any = [const { Goal::Any }; COMPONENTS];
        let part_joints = self
            .parts
            .iter()
            .flat_map(|part| part.end_effectors().joints());
        let part_joints: Vec<_> = part_joints.collect();
        let rest = all.without(&part_joints);
        // The joints of a part need not be end-effectors of the whole body; then nothing is taken from it.
        if rest.as_ref() != Some(all) {
            set_efforts(&mut terms[0].goals, &|_| Goal::Any);
            if let Some(end_effectors) = rest {
                let mut goals = any.clone();
                set_efforts(&mut goals, &|component| self.of(component).clone());
                terms.push(EndEffectorGoals {
                    end_effectors,
                    goals,
                });
            }
        }
        for part in &self.parts {
            let mut goals = any.clone();
            set_efforts(&mut goals, &|component| match part.of(component) {
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
            later: Vec::new(),
            ease: [0, 0],
        }
    }
}

impl From<Scale> for Goals {
    fn from(scale: Scale) -> Self {
        ScaleCurve::from(scale).into()
    }
}

/// Writes the goals of the components that shall change or may take any values, then the factors on the parts; and the same of
/// later goals.
impl fmt::Display for Goals {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let whole =
            { Component::ALL.into_iter() }.filter_map(|component| match self.of(component) {
                goal if *goal == Goal::Any || goal.changes() => Some(format!("{component} {goal}")),
                _ => None,
            });
        let goals: Vec<String> = whole
            .chain(self.parts.iter().map(PartScale::to_string))
            .collect();
        let own = match goals.is_empty() {
            true => "no change".to_owned(),
            false => goals.join(", "),
        };
        let later = self.later.iter().map(|(start, goals)| {
            let seconds = *start as f32 / FRAMES_PER_SECOND;
            format!("from {seconds} s {goals}")
        });
        let all: Vec<String> = [own].into_iter().chain(later).collect();
        f.pad(&all.join("; "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effectors::BodyPart;
    use crate::tags::Tag;
    use lamogen_motion::Joint;

    #[test]
    fn end_effectors_of_parts_are_not_in_the_rest() {
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
        // The arms have no factor on Time, so the whole body's goal holds for them.
        let sudden = Goal::from(Factor::constant(1.2).unwrap());
        assert_eq!(rest.goals[1], sudden);
        assert_eq!(arms.goals[0], Factor::constant(1.5).unwrap().into());
        assert_eq!(arms.goals[1..], [sudden.clone(), Goal::KEEP, Goal::Any]);
        assert_eq!(goals.terms(&all).len(), 1);

        // The elbows are not among the whole body's end-effectors.
        let elbows = EndEffectors::new([(LeftElbow, 1.0), (RightElbow, 1.0)]).unwrap();
        let terms = goals.with_part(PartScale::new(elbows)).terms(&all);
        assert_eq!(terms.len(), 2);
        assert_eq!(terms[0].goals[1], sudden);
    }

    #[test]
    fn invalid_goals_are_refused() {
        let all = EndEffectors::default();
        let all_parts = || {
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
                all_parts().with(Component::Weight, Factor::constant(0.5).unwrap()),
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
        // No part has a factor on Time, so the whole body's goal holds for all of them.
        let sudden = Factor::constant(1.2).unwrap();
        let goals = all_parts().with(Component::Time, sudden);
        assert_eq!(goals.check(40, &all), Ok(()));
    }

    #[test]
    fn goals_in_turn_are_those_of_a_motion_each() {
        let all = EndEffectors::default();
        let strong = Goals::from(Scale::from_tags(&[Tag::Strong]).unwrap());
        let arms = PartScale::new(BodyPart::Arms).tag(Tag::Light).unwrap();
        let goals = Goals::default()
            .then(4, strong.with(Component::Shape, Goal::Peak(6.0)))
            .then(8, Goals::default().with_part(arms));
        assert_eq!(goals.check(12, &all), Ok(()));
        assert!(goals.change() && !goals.is_free(Component::Weight));
        let terms = goals.terms(&all);
        // The whole body, the rest beside the arms, and the arms.
        let [whole, rest, arms] = &terms[..] else {
            panic!("{terms:?}");
        };
        let baseline = [1.0; 12];
        let target = |goal: &Goal| goal.target(Component::Weight, &baseline);
        let expected = [[1.0; 4], [1.5; 4], [1.0; 4]].concat();
        assert_eq!(target(&whole.goals[0]), expected);
        assert_eq!(target(&arms.goals[0])[8..], [0.5; 4]);
        let weights = |goal: &Goal| {
            let divisor = crate::LossDivisor::Mean;
            let weights = goal.weights(&baseline, &target(goal), divisor, 4.0);
            weights.into_iter().map(f32::round).collect::<Vec<f32>>()
        };
        // Only what changes is emphasised, and a set is free where no goal speaks of it.
        assert_eq!(
            weights(&whole.goals[0]),
            [[1.0; 4], [2.0; 4], [0.0; 4]].concat()
        );
        assert_eq!(
            weights(&rest.goals[0]),
            [[0.0; 4], [0.0; 4], [1.0; 4]].concat()
        );
        let ramp: Vec<f32> = (0..12).map(|frame| frame as f32).collect();
        let peak = whole.goals[3].target(Component::Shape, &ramp);
        assert_eq!(peak[7], 6.0);
        assert_eq!(peak[..4], ramp[..4]);
        for (frames, start) in [(8, 8), (6, 8)] {
            let error = goals.check(frames, &all).unwrap_err().to_string();
            assert!(error.contains(&format!("frame {start}")), "{error}");
        }
    }

    #[test]
    fn goals_set_in_and_end_gradually() {
        let strong = Goals::default().with(Component::Weight, Factor::constant(2.0).unwrap());
        let goals = Goals::anything()
            .then(2, strong.eased([3, 1]))
            .then(8, Goals::anything());
        let terms = goals.terms(&EndEffectors::default());
        let target = terms[0].goals[0].target(Component::Weight, &[1.0; 10]);
        let eased = [1.0, 1.0, 1.15625, 1.5, 1.84375, 2.0, 2.0, 1.5, 1.0, 1.0];
        assert_eq!(target, eased);
    }

    #[test]
    fn factors_over_time_begin_with_their_turn() {
        let factor = Factor::parse(Component::Weight, "0.1:2").unwrap();
        let later = Goals::default().with(Component::Weight, factor);
        let goals = Goals::default().then(4, later);
        let target =
            goals.terms(&EndEffectors::default())[0].goals[0].target(Component::Weight, &[1.0; 8]);
        assert_eq!(target, [1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 2.0, 2.0]);
    }

    #[test]
    fn sections_of_goals_are_those_of_their_frames() {
        let strong = Goals::from(Scale::from_tags(&[Tag::Strong]).unwrap());
        let far = Goals::default()
            .with(Component::Shape, Goal::Peak(2.0))
            .with_part(PartScale::new(BodyPart::Arms).tag(Tag::Light).unwrap());
        let goals = strong.then(60, far).eased([8, 4]);
        assert_eq!(goals.section(0..100, 100), goals);
        let text = |section| goals.section(section, 100).to_string();
        assert_eq!(text(10..50), "Weight 1.5");
        assert_eq!(text(70..90), "Shape peak=2, arms Weight 0.5");
        assert_eq!(
            text(40..80),
            "Weight 1.5; from 1 s Shape peak=2, arms Weight 0.5"
        );
        assert_eq!(goals.section(0..30, 100).ease, [8, 0]);
        assert_eq!(goals.section(80..100, 100).ease, [0, 4]);
        let frames = (0..100).map(|frame| [1.0, 1.0, 1.0, if frame < 60 { 9.0 } else { 0.5 }]);
        let baseline = LabanSeries::from_frames(frames.collect());
        let known = goals.for_baseline(&baseline);
        assert_eq!(
            known.to_string(),
            "Weight 1.5; from 3 s Shape 4, arms Weight 0.5"
        );
        assert_eq!(known.ease, goals.ease);
    }
}
