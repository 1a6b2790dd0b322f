//! The conditions under which motions are generated: a factor on a component, or the phrase of a tag.

use std::fmt;

use lamogen::{Component, Tag};

/// The change of a component that a motion is generated for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Condition {
    /// No change: the motion of the sentence alone.
    Nothing,
    /// A factor on a component.
    Factor(Component, f32),
    /// The phrase of a tag in the prompt.
    Phrase(Tag),
}

impl fmt::Display for Condition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Condition::Nothing => f.write_str("nothing"),
            Condition::Factor(component, factor) => write!(f, "{component} {factor}"),
            Condition::Phrase(tag) => write!(f, "phrase {tag}"),
        }
    }
}

impl Condition {
    /// Returns the component and the factor on it; for a phrase, those of its tag.
    pub fn factor(self) -> Option<(Component, f32)> {
        match self {
            Condition::Nothing => None,
            Condition::Factor(component, factor) => Some((component, factor)),
            Condition::Phrase(tag) => Some((tag.component(), tag.scale())),
        }
    }
}

/// Returns a condition for both tags of every component.
pub fn tag_conditions(condition: impl Fn(Tag) -> Condition) -> Vec<Condition> {
    Tag::ALL.into_iter().map(condition).collect()
}

/// Returns the condition with the factor of a tag.
pub fn factor_condition(tag: Tag) -> Condition {
    Condition::Factor(tag.component(), tag.scale())
}
