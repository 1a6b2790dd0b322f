//! The three parts of a data set.

use std::fmt;
use std::str::FromStr;

/// What an entry is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Split {
    /// To train on; `train` in files.
    Train,
    /// To choose settings by; `val` in files.
    Validation,
    /// To measure on; `test` in files.
    Test,
}

impl Split {
    /// Every split, in the order that training, choosing and measuring have.
    pub const ALL: [Split; 3] = [Split::Train, Split::Validation, Split::Test];

    /// The name in files.
    pub const fn name(self) -> &'static str {
        match self {
            Split::Train => "train",
            Split::Validation => "val",
            Split::Test => "test",
        }
    }
}

impl fmt::Display for Split {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// A word that is no split.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected a split (train, val or test), found {0:?}")]
pub struct SplitError(pub String);

impl FromStr for Split {
    type Err = SplitError;

    fn from_str(text: &str) -> Result<Self, SplitError> {
        let split = Split::ALL.into_iter().find(|split| split.name() == text);
        split.ok_or_else(|| SplitError(text.into()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn splits_are_read_as_they_are_written() {
        for split in Split::ALL {
            assert_eq!(split.to_string().parse(), Ok(split));
        }
        let message = "validation".parse::<Split>().unwrap_err().to_string();
        assert!(message.contains("val") && message.contains("validation"));
    }
}
