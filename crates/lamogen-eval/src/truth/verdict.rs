//! The result of a check: every measured value with its limits.

use std::fmt;

use serde::Serialize;

use super::checks::Check;

/// A condition of a check: a measured value with its limits.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Term {
    /// The name of the field of [`Measurements`](super::Measurements) that was measured; its documentation has the unit.
    /// With `other` before the name, the value is that of the side that the check does not name.
    pub quantity: &'static str,
    /// The measured value.
    pub value: f32,
    /// The least value for which the condition holds, if there is a lower limit.
    pub at_least: Option<f32>,
    /// The greatest value for which the condition holds, if there is an upper limit.
    pub at_most: Option<f32>,
}

impl Term {
    /// Returns whether the value is within its limits. A NaN is not.
    pub fn holds(&self) -> bool {
        let is_enough = self.at_least.is_none_or(|limit| self.value >= limit);
        let is_little_enough = self.at_most.is_none_or(|limit| self.value <= limit);
        is_enough && is_little_enough && !self.value.is_nan()
    }
}

impl fmt::Display for Term {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {:.2} (", self.quantity, self.value)?;
        match (self.at_least, self.at_most) {
            (Some(least), Some(most)) if least == most => write!(f, "{least}")?,
            (Some(least), Some(most)) => write!(f, "{least} to {most}")?,
            (Some(least), None) => write!(f, "at least {least}")?,
            (None, Some(most)) => write!(f, "at most {most}")?,
            (None, None) => write!(f, "any")?,
        }
        f.write_str(")")
    }
}

/// The result of a check of a motion.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Verdict {
    /// The check.
    pub check: Check,
    /// The conditions of the check, which must all hold.
    pub terms: Vec<Term>,
}

impl Verdict {
    /// Returns whether the check holds for the motion.
    pub fn holds(&self) -> bool {
        self.terms.iter().all(Term::holds)
    }

    /// Returns the conditions that do not hold.
    pub fn faults(&self) -> impl Iterator<Item = &Term> {
        self.terms.iter().filter(|term| !term.holds())
    }
}
