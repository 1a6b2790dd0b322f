//! The error of an evaluation.

use std::fmt::{self, Display};
use std::path::Path;

use lamogen::Error;

/// What kind of error ended an evaluation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EvaluationErrorKind {
    /// A motion could not be generated or evaluated.
    Generation,
    /// The options make no sense, or are not those of the run in the folder.
    Options,
    /// A file cannot be read, or the data set has too few motions.
    Input,
    /// A file cannot be written.
    Output,
}

/// Why an evaluation ended early. Records that were written stay, and the same call goes on from there.
#[derive(Debug)]
pub struct EvaluationError {
    /// The kind of error.
    pub kind: EvaluationErrorKind,
    /// What was expected, what was found, and where.
    pub message: String,
    /// What may help.
    pub hint: Option<String>,
}

impl EvaluationError {
    pub(super) fn new(kind: EvaluationErrorKind, message: impl ToString) -> Self {
        EvaluationError {
            kind,
            message: message.to_string(),
            hint: None,
        }
    }

    /// Sets the hint.
    pub(super) fn hint(self, hint: impl Into<String>) -> Self {
        EvaluationError {
            hint: Some(hint.into()),
            ..self
        }
    }

    /// Makes the error of a file that cannot be written.
    pub(super) fn output(path: &Path, reason: impl Display) -> Self {
        let message = format!("{}: {reason}", path.display());
        EvaluationError::new(EvaluationErrorKind::Output, message)
    }
}

impl Display for EvaluationError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)?;
        match &self.hint {
            Some(hint) => write!(f, " ({hint})"),
            None => Ok(()),
        }
    }
}

impl std::error::Error for EvaluationError {}

impl From<Error> for EvaluationError {
    fn from(error: Error) -> Self {
        let kind = match error {
            Error::Request { .. } => EvaluationErrorKind::Options,
            Error::Stopped(_) | Error::Failed(_) => EvaluationErrorKind::Generation,
        };
        EvaluationError::new(kind, error)
    }
}
