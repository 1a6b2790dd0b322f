//! The error of goals that make no sense or cannot be parsed.

use crate::factor::{FactorError, words};
use crate::tags::{Component, ScaleError};

/// The reason why a goal is invalid or a text is no goal.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[allow(missing_docs)]
pub enum GoalError {
    /// A factor is invalid.
    #[error(transparent)]
    Factor(#[from] FactorError),
    /// A peak, a mean or a value of a series is negative, infinite or not a number.
    #[error("a {what} must be a finite number of at least 0, found {found}")]
    Value { what: &'static str, found: String },
    /// A series is too short to be stretched.
    #[error("a series needs at least 4 frames, found {found}")]
    Series { found: usize },
    /// A part of the body has a goal for Shape.
    #[error(
        "Shape is of the whole body, not of {part}; of a part Weight, Time and Flow can be asked for"
    )]
    PartShape { part: String },
    /// Two parts have an end-effector in common.
    #[error("expected parts of the body that have no end-effector in common, found {joint} in two")]
    Shared { joint: &'static str },
    /// There are parts, and the whole body has a goal that the rest of the body cannot have.
    #[error(
        "expected factors on {component} where parts of the body have their own, found {component} {found}"
    )]
    Beside { component: Component, found: String },
    /// The whole body has a factor, but all of its end-effectors are in parts with a factor of their own.
    #[error(
        "{component} {found} is of what the parts leave, and they leave nothing: expected an end-effector in no part, or a part without {component}"
    )]
    NoRest { component: Component, found: String },
    /// The text is no goal.
    #[error(
        "expected a number, a word ({}), keys such as \"0:1 1:1.5\" (seconds:factor), peak= or mean= with a number, or any; found {found:?}",
        words(.component)
    )]
    Text { component: Component, found: String },
    /// A part has two factors on the same component.
    #[error(
        "{part}: expected at most one word or factor for each component, found two for {component}"
    )]
    Twice { part: String, component: Component },
    /// A key is past the motion's end.
    #[error(transparent)]
    Scale(#[from] ScaleError),
    /// Later goals begin before the earlier ones, or past the motion's end.
    #[error(
        "expected goals in turn that begin one after another within {frames} frames, found some that begin at frame {start}"
    )]
    Turn { start: usize, frames: usize },
    /// The text is no part of the body with words or factors.
    #[error(
        "expected a part of the body with words or factors of Weight, Time and Flow, such as \"arms:strong,sudden\" or \"legs:weight=0.7\", found {found:?}"
    )]
    Part { found: String },
    /// The word is not the name of a part of the body.
    #[error("expected one of {expected}, found {found:?}")]
    BodyPart { expected: String, found: String },
}
