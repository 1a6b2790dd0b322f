//! The goal of one Laban component, and its text form.

use std::fmt;
use std::ops::Range;

use lamogen_motion::FRAMES_PER_SECOND;

use crate::factor::{Factor, FactorError};
use crate::goal_error::GoalError;
use crate::series::mean;
use crate::tags::Component;

/// The goal of one Laban component: the values that it shall reach.
///
/// The text form is a [`Factor`], `peak=` or `mean=` with a number in the component's own unit, or `any`:
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
    /// The component is the baseline times this factor. A factor of 1 keeps the baseline as it is.
    Factor(Factor),
    /// The baseline is scaled so that its largest value over time is this number. A baseline at rest stays at rest.
    Peak(f32),
    /// The baseline is scaled so that its mean over time is this number. A baseline at rest stays at rest.
    Mean(f32),
    /// The component takes these values, stretched in time to the motion's length. They may be those of another motion.
    Series(Vec<f32>),
    /// The component may take any values; the loss ignores it.
    Any,
    /// Other goals in turn: each holds from its frame to that of the next, as if these frames were a motion of their own.
    /// The first one holds from frame 0. [`Goals::then`](crate::Goals::then) makes such goals.
    InTurn(Vec<GoalTurn>),
}

/// A goal that holds for some of the frames of a motion.
#[derive(Clone, Debug, PartialEq)]
pub struct GoalTurn {
    /// The first frame. The goal holds up to the first frame of the next.
    pub start: usize,
    /// The numbers of frames at the beginning and at the end in which the values to reach pass from those of the baseline to those
    /// of the goal, and back. A motion that goes on from another cannot begin with another speed.
    pub ease: [usize; 2],
    /// The goal.
    pub goal: Goal,
}

impl Goal {
    /// The goal that keeps the baseline: a factor of 1.
    pub const KEEP: Goal = Goal::Factor(Factor::NEUTRAL);

    /// Parses a goal from its text form (see [`Goal`]). Words are tags of `component`.
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
        let parts = lower.split_once('=');
        let goal = match parts.map(|(key, value)| (key.trim_end(), value)) {
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

    /// Returns whether the goal asks for values other than those of the baseline.
    pub fn changes(&self) -> bool {
        match self {
            Goal::Factor(factor) => factor.changes(),
            Goal::Peak(_) | Goal::Mean(_) | Goal::Series(_) => true,
            Goal::Any => false,
            Goal::InTurn(turns) => turns.iter().any(|turn| turn.goal.changes()),
        }
    }

    /// Splits goals in turn into the frames of each, for a motion of `frames` frames.
    pub(crate) fn turns(turns: &[GoalTurn], frames: usize) -> Vec<(Range<usize>, &GoalTurn)> {
        let starts = turns.iter().map(|turn| turn.start);
        let ends = starts.skip(1).chain([frames]);
        let turns = turns.iter().zip(ends);
        turns
            .map(|(turn, end)| (turn.start.min(frames)..end.min(frames), turn))
            .collect()
    }

    /// Checks that the numbers of the goal are valid.
    ///
    /// # Errors
    ///
    /// If a number is negative or not finite, or a series has fewer than 4 values.
    pub(crate) fn check(&self) -> Result<(), GoalError> {
        let check_number = |what, number: f32| match number.is_finite() && number >= 0.0 {
            true => Ok(()),
            false => Err(GoalError::Value {
                what,
                found: number.to_string(),
            }),
        };
        match self {
            Goal::Factor(_) | Goal::Any => Ok(()),
            Goal::Peak(peak) => check_number("peak", *peak),
            Goal::Mean(mean) => check_number("mean", *mean),
            Goal::Series(values) if values.len() < 4 => Err(GoalError::Series {
                found: values.len(),
            }),
            Goal::Series(values) => {
                let mut values = values.iter();
                values.try_for_each(|&value| check_number("value of a series", value))
            }
            Goal::InTurn(turns) => turns.iter().try_for_each(|turn| turn.goal.check()),
        }
    }

    /// Returns the goal of some of a motion's `frames` frames, as if these were a motion of their own. Peaks and means stay as
    /// they are.
    pub(crate) fn section(
        &self,
        component: Component,
        section: &Range<usize>,
        frames: usize,
    ) -> Goal {
        match self {
            Goal::Factor(factor) => Goal::Factor(factor.section(section)),
            Goal::Series(_) => {
                // The first values of a series are skipped, as those of frames without differences.
                let skipped = component.first_frame().min(section.start);
                let stretched = self.target(component, &vec![0.0; frames]);
                Goal::Series(stretched[section.start - skipped..section.end].to_vec())
            }
            Goal::InTurn(turns) => {
                let turns = Goal::turns(turns, frames).into_iter();
                let turns =
                    turns.filter(|(turn, _)| turn.start < section.end && section.start < turn.end);
                Goal::InTurn(
                    turns
                        .map(|(own, turn)| {
                            let from = own.start.max(section.start);
                            let until = own.end.min(section.end);
                            let within = from - own.start..until - own.start;
                            let ends = [from == own.start, until == own.end];
                            let ease = ends.into_iter().zip(turn.ease);
                            let mut ease = ease.map(|(is_end, ease)| if is_end { ease } else { 0 });
                            GoalTurn {
                                start: from - section.start,
                                ease: std::array::from_fn(|_| ease.next().unwrap_or(0)),
                                goal: turn.goal.section(component, &within, own.len()),
                            }
                        })
                        .collect(),
                )
            }
            Goal::Peak(_) | Goal::Mean(_) | Goal::Any => self.clone(),
        }
    }

    /// Turns a peak or a mean into the factor that it means for a baseline.
    pub(crate) fn for_baseline(&self, baseline: &[f32]) -> Goal {
        let (requested, measured) = match self {
            Goal::Peak(peak) => (*peak, baseline.iter().copied().fold(0.0, f32::max)),
            Goal::Mean(requested) => (*requested, mean(baseline.iter().copied())),
            _ => return self.clone(),
        };
        Goal::Factor(Factor::unchecked(ratio(requested, measured)))
    }

    /// Returns the value to reach at each frame, for a baseline.
    pub(crate) fn target(&self, component: Component, baseline: &[f32]) -> Vec<f32> {
        self.target_after(component, component.first_frame(), baseline)
    }

    /// Returns the value to reach at each frame of a baseline whose first `without` frames have no differences.
    fn target_after(&self, component: Component, without: usize, baseline: &[f32]) -> Vec<f32> {
        let scaled = |requested: f32, measured: f32| {
            let factor = ratio(requested, measured);
            baseline.iter().map(|value| value * factor).collect()
        };
        match self {
            Goal::Any => baseline.to_vec(),
            Goal::Factor(factor) => {
                let factors = factor.frames(baseline.len());
                baseline.iter().zip(factors).map(|(b, f)| b * f).collect()
            }
            Goal::Peak(peak) => scaled(*peak, baseline.iter().copied().fold(0.0, f32::max)),
            Goal::Mean(requested) => scaled(*requested, mean(baseline.iter().copied())),
            Goal::Series(values) => {
                // The first frames have no differences, however long the motion is, so they are not stretched.
                let first = without.min(baseline.len());
                let rest = baseline.len() - first;
                let mut target = vec![0.0; first];
                target.extend(resample(&values[component.first_frame()..], rest));
                target
            }
            Goal::InTurn(turns) => { Goal::turns(turns, baseline.len()).into_iter() }
                .flat_map(|(frames, turn)| {
                    let without = without.saturating_sub(frames.start);
                    let baseline = &baseline[frames];
                    let target = turn.goal.target_after(component, without, baseline);
                    turn.eased(baseline, target)
                })
                .collect(),
        }
    }
}

impl GoalTurn {
    /// Leads from a baseline to a target and back.
    fn eased(&self, baseline: &[f32], target: Vec<f32>) -> Vec<f32> {
        let pairs = baseline.iter().zip(&target);
        pairs
            .zip(self.shares(target.len()))
            .map(|((baseline, target), share)| baseline + share * (target - baseline))
            .collect()
    }

    /// Returns how much the goal counts at each of its frames: 1, and less where it sets in and ends.
    pub(crate) fn shares(&self, frames: usize) -> impl Iterator<Item = f32> + '_ {
        (0..frames).map(move |frame| {
            let distances = [frame + 1, frames - frame];
            let shares = distances.into_iter().zip(self.ease);
            let share = shares.fold(1.0, |share: f32, (distance, ease)| {
                share.min(distance as f32 / (ease + 1) as f32)
            });
            // A curve that begins and ends level.
            share * share * (3.0 - 2.0 * share)
        })
    }
}

/// Returns the factor that scales a measured value to a requested one. A body at rest stays at rest.
fn ratio(requested: f32, measured: f32) -> f32 {
    match measured > 0.0 {
        true => requested / measured,
        false => 1.0,
    }
}

/// Resamples values to `count` values over the same time, by linear interpolation.
fn resample(values: &[f32], count: usize) -> impl Iterator<Item = f32> + '_ {
    let last = values.len() - 1;
    (0..count).map(move |place| {
        let at = place as f64 * last as f64 / count.saturating_sub(1).max(1) as f64;
        let before = (at as usize).min(last);
        let (fraction, after) = (at - before as f64, (before + 1).min(last));
        let [before, after] = [before, after].map(|place| f64::from(values[place]));
        (before + fraction * (after - before)) as f32
    })
}

impl From<Factor> for Goal {
    fn from(factor: Factor) -> Self {
        Goal::Factor(factor)
    }
}

/// Writes the text that [`Goal::parse`] reads. A series and goals in turn have no such text; the number of frames of the one
/// and the list of the others are written instead.
impl fmt::Display for Goal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Goal::Factor(factor) => factor.fmt(f),
            Goal::Peak(peak) => write!(f, "peak={peak}"),
            Goal::Mean(mean) => write!(f, "mean={mean}"),
            Goal::Series(values) => write!(f, "as a series of {} frames", values.len()),
            Goal::Any => f.write_str("any"),
            Goal::InTurn(turns) => {
                for (place, turn) in turns.iter().enumerate() {
                    if place > 0 {
                        let seconds = turn.start as f32 / FRAMES_PER_SECOND;
                        write!(f, ", from {seconds} s ")?;
                    }
                    turn.goal.fmt(f)?;
                }
                Ok(())
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
    fn a_series_is_stretched_after_the_frames_without_differences() {
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
        let spaced = Goal::parse(Component::Weight, " Peak = 0.25 ").unwrap();
        assert_eq!(spaced, Goal::Peak(0.25));
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
    fn a_section_asks_for_the_values_of_its_frames() {
        let values: Vec<f32> = (0..50)
            .map(|value| (value as f32 * 0.3).sin() + 1.0)
            .collect();
        let turns = vec![
            GoalTurn {
                start: 0,
                ease: [5, 0],
                goal: Goal::parse(Component::Weight, "0:1 ~ 1:2").unwrap(),
            },
            GoalTurn {
                start: 30,
                ease: [0, 0],
                goal: Goal::parse(Component::Weight, "0.5").unwrap(),
            },
        ];
        let baseline: Vec<f32> = (0..60).map(|value| 1.0 + value as f32).collect();
        for component in [Component::Weight, Component::Flow] {
            for goal in [Goal::Series(values.clone()), Goal::InTurn(turns.clone())] {
                let whole = goal.target(component, &baseline);
                let first = goal.section(component, &(0..20), 60);
                let later = goal.section(component, &(20..60), 60);
                let mut found = first.target(component, &baseline[..20]);
                // The frames before a later section are known, so that it has differences from its first frame on.
                found.extend(later.target_after(component, 0, &baseline[20..]));
                for (frame, (found, expected)) in found.iter().zip(&whole).enumerate() {
                    assert!((found - expected).abs() < 1e-4, "{goal}: frame {frame}");
                }
            }
        }
        let peak = Goal::Peak(2.0).for_baseline(&BASELINE);
        assert_eq!(target(peak), target(Goal::Peak(2.0)));
        let mean = Goal::Mean(4.0).for_baseline(&BASELINE);
        assert_eq!(target(mean), target(Goal::Mean(4.0)));
        assert_eq!(Goal::Any.for_baseline(&BASELINE), Goal::Any);
    }
}
