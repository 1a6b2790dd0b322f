//! How a command ends that did not succeed.

use std::path::Path;

use lamogen::files::{MappingError, ReadError, WriteError};
use lamogen::{DeviceError, Error, LoadError};
use lamogen_data::DataError;
use lamogen_train::VariationError;

/// Exit codes, as `lamogen --help` documents them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Code {
    /// A motion could not be generated.
    Run = 1,
    /// Arguments or requests make no sense; clap's code too.
    Usage = 2,
    /// A file or a model cannot be read.
    Input = 3,
    /// A file cannot be written.
    Output = 4,
    /// A batch is done but for some motions.
    Partly = 5,
    /// A training was stopped, or its time was over, before its last step.
    Stopped = 6,
}

/// What went wrong, and what might help.
#[derive(Debug)]
pub struct Failure {
    pub code: Code,
    pub message: String,
    pub hint: Option<String>,
}

impl Failure {
    pub fn new(code: Code, message: impl ToString) -> Self {
        Failure {
            code,
            message: message.to_string(),
            hint: None,
        }
    }

    /// An end of which everything is said already.
    pub fn said(code: Code) -> Self {
        Failure::new(code, "")
    }

    pub fn hint(self, hint: impl Into<String>) -> Self {
        Failure {
            hint: Some(hint.into()),
            ..self
        }
    }

    /// A file that cannot be written.
    pub fn output(path: &Path, reason: impl std::fmt::Display) -> Self {
        Failure::new(Code::Output, format!("{}: {reason}", path.display()))
    }
}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        match error {
            Error::Request { .. } => Failure::new(Code::Usage, error),
            Error::Stopped(_) => Failure::new(Code::Run, error),
            Error::Failed(_) => Failure::new(Code::Run, error)
                .hint("goals nearer to what the sentence alone gives, or another seed, may help"),
        }
    }
}

impl From<LoadError> for Failure {
    fn from(error: LoadError) -> Self {
        Failure::new(Code::Input, error).hint("`lamogen help model-folder` says what one has")
    }
}

impl From<DeviceError> for Failure {
    fn from(error: DeviceError) -> Self {
        Failure::new(Code::Usage, error).hint("lamogen devices lists what there is")
    }
}

impl From<ReadError> for Failure {
    fn from(error: ReadError) -> Self {
        Failure::new(Code::Input, error)
    }
}

impl From<DataError> for Failure {
    fn from(error: DataError) -> Self {
        let (code, hint) = match &error {
            DataError::Uncaptioned { .. } => (Code::Usage, Some("--captions names the file")),
            DataError::Superfluous { .. } => (Code::Usage, Some("leave --captions out")),
            DataError::Limits { .. } => (Code::Usage, None),
            DataError::Occupied { .. } => (
                Code::Output,
                Some("--force replaces a packed data set, and nothing else"),
            ),
            DataError::Write { .. } => (Code::Output, None),
            DataError::Statistics { .. } => (
                Code::Input,
                Some(
                    "\"split\": \"train\" in the captions, or another --seed, gives motions to train on",
                ),
            ),
            _ => (
                Code::Input,
                Some("`lamogen help data` says what a data set has"),
            ),
        };
        let failure = Failure::new(code, error);
        match hint {
            Some(hint) => failure.hint(hint),
            None => failure,
        }
    }
}

impl From<VariationError> for Failure {
    fn from(error: VariationError) -> Self {
        let code = match error {
            VariationError::Options(_) | VariationError::OtherWork { .. } => Code::Usage,
            VariationError::Guide { .. } => Code::Run,
            VariationError::Motion { .. } | VariationError::Npy(_) => Code::Input,
            VariationError::Io { .. } => Code::Output,
        };
        Failure::new(code, error)
    }
}

impl From<MappingError> for Failure {
    fn from(error: MappingError) -> Self {
        Failure::new(Code::Input, error)
    }
}

impl From<WriteError> for Failure {
    fn from(error: WriteError) -> Self {
        Failure::new(Code::Output, error)
    }
}
