//! Factors on parts of the body.

use std::fmt;
use std::ops::Range;
use std::str::FromStr;

use crate::curve::ScaleCurve;
use crate::effectors::{BodyPart, EndEffectors};
use crate::factor::Factor;
use crate::goal_error::GoalError;
use crate::tags::{Component, Tag};

/// Factors on Weight, Time and Flow of a part of the body: a set of end-effectors. For a component without a factor,
/// the goal of the whole body holds.
///
/// The text form is the name of a [`BodyPart`], a colon, and tags or `component=factor`, with commas between them:
///
/// ```
/// use lamogen_laban::{BodyPart, PartScale, Tag};
///
/// let part: PartScale = "arms:strong,time=1.1".parse()?;
/// assert_eq!(part.to_string(), "arms Weight 1.5, arms Time 1.1");
/// assert_eq!("legs:light".parse(), PartScale::new(BodyPart::Legs).tag(Tag::Light));
/// # Ok::<(), lamogen_laban::GoalError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct PartScale {
    end_effectors: EndEffectors,
    factors: [Option<Factor>; Component::EFFORTS.len()],
}

impl PartScale {
    /// Creates a part without factors.
    pub fn new(end_effectors: impl Into<EndEffectors>) -> Self {
        PartScale {
            end_effectors: end_effectors.into(),
            factors: [const { None }; Component::EFFORTS.len()],
        }
    }

    /// Sets the factor on a component.
    ///
    /// # Errors
    ///
    /// If the component is Shape, which only the whole body has.
    pub fn with(mut self, component: Component, factor: Factor) -> Result<Self, GoalError> {
        match self.factors.get_mut(component.index()) {
            Some(own) => *own = Some(factor),
            None => {
                let part = self.end_effectors.to_string();
                return Err(GoalError::PartShape { part });
            }
        }
        Ok(self)
    }

    /// Sets the factor of a tag on the tag's component.
    ///
    /// # Errors
    ///
    /// If the tag is one of Shape, which only the whole body has.
    pub fn tag(self, tag: Tag) -> Result<Self, GoalError> {
        self.with(tag.component(), tag.into())
    }

    /// Returns the part's end-effectors.
    pub fn end_effectors(&self) -> &EndEffectors {
        &self.end_effectors
    }

    /// Returns the part's factor on a component, if it has one.
    pub fn of(&self, component: Component) -> Option<&Factor> {
        self.factors.get(component.index())?.as_ref()
    }

    /// Returns the factors of some of a motion's frames, as if these were a motion of their own.
    pub(crate) fn section(&self, frames: &Range<usize>) -> PartScale {
        let factor = |factor: &Option<Factor>| factor.as_ref().map(|own| own.section(frames));
        PartScale {
            end_effectors: self.end_effectors.clone(),
            factors: self.factors.each_ref().map(factor),
        }
    }

    /// Returns whether a factor differs from 1 at any time.
    pub fn changes(&self) -> bool {
        self.factors.iter().flatten().any(Factor::changes)
    }

    /// Checks that every key of the factors can act within a motion of `frames` frames.
    pub(crate) fn check(&self, frames: usize) -> Result<(), GoalError> {
        let mut curve = ScaleCurve::default();
        for component in Component::EFFORTS {
            if let Some(factor) = self.of(component) {
                curve = curve.with(component, factor.clone());
            }
        }
        Ok(curve.check(frames)?)
    }
}

impl FromStr for PartScale {
    type Err = GoalError;

    fn from_str(text: &str) -> Result<Self, GoalError> {
        let part_error = || GoalError::Part { found: text.into() };
        let (name, words) = text.split_once(':').ok_or_else(part_error)?;
        let part: BodyPart = name.trim().parse()?;
        let mut scale = PartScale::new(part);
        for word in words.split(',').map(str::trim) {
            let (component, factor) = match word.split_once('=') {
                None => {
                    let tag: Tag = word.parse().map_err(|_| part_error())?;
                    (tag.component(), tag.into())
                }
                Some((component, factor)) => {
                    let name = component.trim();
                    let mut all = Component::ALL.into_iter();
                    let component =
                        all.find(|component| component.to_string().eq_ignore_ascii_case(name));
                    let component = component.ok_or_else(part_error)?;
                    (component, Factor::parse(component, factor)?)
                }
            };
            if scale.of(component).is_some() {
                let part = name.trim().into();
                return Err(GoalError::Twice { part, component });
            }
            scale = scale.with(component, factor)?;
        }
        Ok(scale)
    }
}

/// Writes the factors, each with the part's name.
impl fmt::Display for PartScale {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let factors = Component::EFFORTS.into_iter().zip(&self.factors);
        let texts = factors.filter_map(|(component, factor)| {
            Some(format!(
                "{} {component} {}",
                self.end_effectors,
                factor.as_ref()?
            ))
        });
        let texts: Vec<String> = texts.collect();
        match texts.is_empty() {
            true => write!(f, "{} as the whole", self.end_effectors),
            false => f.write_str(&texts.join(", ")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_of_invalid_texts_say_what_was_found() {
        for (text, part) in [
            ("arms", "\"arms:strong,sudden\""),
            ("wings:strong", "left-arm"),
            ("arms:", "found \"arms:\""),
            ("arms:strong,,", "found \"arms:strong,,\""),
            ("arms:heavy", "found \"arms:heavy\""),
            ("arms:far", "Shape is of the whole body, not of arms"),
            ("arms:shape=2", "Shape is of the whole body"),
            ("arms:speed=2", "found \"arms:speed=2\""),
            ("arms:weight=-1", "at least 0"),
            (
                "arms:strong,light",
                "arms: expected at most one word or factor for each component, found two for Weight",
            ),
            ("arms:strong,time=2,weight=2", "two for Weight"),
        ] {
            let message = text.parse::<PartScale>().unwrap_err().to_string();
            assert!(message.contains(part), "{text}: {message}");
        }
    }

    #[test]
    fn keys_past_the_end_of_the_motion_are_refused() {
        let part: PartScale = "left-leg:weight=0:1 1:strong".parse().unwrap();
        assert_eq!(part.to_string(), "left-leg Weight 0:1 1:1.5");
        assert_eq!(part.check(40), Ok(()));
        assert!(part.check(20).unwrap_err().to_string().contains("Weight"));
        assert!(part.changes());
        assert!(!PartScale::new(BodyPart::Head).changes());
    }
}
