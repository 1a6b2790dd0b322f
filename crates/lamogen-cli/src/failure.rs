//! The failure of a command: exit code, message and hint.

use std::path::Path;

use lamogen::character::CharacterError;
use lamogen::files::{MappingError, ReadError, WriteError};
use lamogen::{DeviceError, Error, LoadError, NamedMotionError};
use lamogen_data::DataError;
use lamogen_train::VariationError;

/// Exit codes, as `lamogen --help` documents them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum FailureCode {
    /// A motion could not be generated.
    Run = 1,
    /// Arguments or requests are invalid; clap uses this code too.
    Usage = 2,
    /// A file or a model cannot be read.
    Input = 3,
    /// A file cannot be written.
    Output = 4,
    /// A batch is finished except for some motions.
    Partial = 5,
    /// The command was stopped before its end, by the user or a time limit, and what is finished is kept.
    Stopped = 6,
}

/// Why a command failed, and a hint that may help.
#[derive(Debug)]
pub struct Failure {
    pub code: FailureCode,
    pub message: String,
    pub hint: Option<String>,
}

impl Failure {
    pub fn new(code: FailureCode, message: impl ToString) -> Self {
        Failure {
            code,
            message: message.to_string(),
            hint: None,
        }
    }

    /// Makes a failure without a message, for commands that have printed the reason already.
    pub fn silent(code: FailureCode) -> Self {
        Failure::new(code, "")
    }

    /// Sets the hint.
    pub fn hint(self, hint: impl Into<String>) -> Self {
        Failure {
            hint: Some(hint.into()),
            ..self
        }
    }

    /// Makes the failure of a file that cannot be written.
    pub fn output(path: &Path, reason: impl std::fmt::Display) -> Self {
        Failure::new(FailureCode::Output, format!("{}: {reason}", path.display()))
    }
}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        match error {
            Error::Request { .. } => Failure::new(FailureCode::Usage, error),
            Error::Stopped(_) => Failure::new(FailureCode::Run, error),
            Error::Failed(_) => Failure::new(FailureCode::Run, error)
                .hint("goals nearer to what the sentence alone gives, or another seed, may help"),
        }
    }
}

impl From<LoadError> for Failure {
    fn from(error: LoadError) -> Self {
        Failure::new(FailureCode::Input, error)
            .hint("`lamogen help model-folder` says what one has")
    }
}

impl From<DeviceError> for Failure {
    fn from(error: DeviceError) -> Self {
        Failure::new(FailureCode::Usage, error).hint("lamogen devices lists what there is")
    }
}

impl From<ReadError> for Failure {
    fn from(error: ReadError) -> Self {
        Failure::new(FailureCode::Input, error)
    }
}

impl From<NamedMotionError> for Failure {
    fn from(error: NamedMotionError) -> Self {
        Failure::new(FailureCode::Input, error)
    }
}

impl From<DataError> for Failure {
    fn from(error: DataError) -> Self {
        let (code, hint) = match &error {
            DataError::Uncaptioned { .. } => {
                (FailureCode::Usage, Some("--captions names the file"))
            }
            DataError::Superfluous { .. } => (FailureCode::Usage, Some("leave --captions out")),
            DataError::Limits { .. } => (FailureCode::Usage, None),
            DataError::Occupied { .. } => (
                FailureCode::Output,
                Some("--force replaces a packed data set, and nothing else"),
            ),
            DataError::Write { .. } => (FailureCode::Output, None),
            DataError::Statistics { .. } => (
                FailureCode::Input,
                Some(
                    "\"split\": \"train\" in the captions, or another --seed, gives motions to train on",
                ),
            ),
            _ => (
                FailureCode::Input,
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
            VariationError::Options(_) | VariationError::OtherWork { .. } => FailureCode::Usage,
            VariationError::Guide { .. } => FailureCode::Run,
            VariationError::Motion { .. } | VariationError::Npy(_) => FailureCode::Input,
            VariationError::Io { .. } => FailureCode::Output,
        };
        Failure::new(code, error)
    }
}

impl From<CharacterError> for Failure {
    fn from(error: CharacterError) -> Self {
        let failure = |code| Failure::new(code, &error);
        match &error {
            CharacterError::Container { .. } | CharacterError::Node { .. } => {
                failure(FailureCode::Usage)
            }
            CharacterError::SideFiles { .. } => failure(FailureCode::Usage)
                .hint("write into that folder, or export the character as .glb"),
            CharacterError::Skeleton { .. } => {
                failure(FailureCode::Input).hint("--onto-names names a mapping file")
            }
            CharacterError::Write { .. } => failure(FailureCode::Output),
            _ => failure(FailureCode::Input),
        }
    }
}

impl From<MappingError> for Failure {
    fn from(error: MappingError) -> Self {
        Failure::new(FailureCode::Input, error)
    }
}

impl From<WriteError> for Failure {
    fn from(error: WriteError) -> Self {
        Failure::new(FailureCode::Output, error)
    }
}
