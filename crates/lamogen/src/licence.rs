//! The licence of a model's weights.

use std::fmt;

use lamogen_model::Checkpoint;

/// The licence that a weight file states. The code of lamogen has a licence of its own.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Licence {
    /// The name of the licence, as an SPDX identifier where there is one: `CC-BY-NC-4.0`.
    pub name: String,
    /// Whom to name when the weights, or motions made with them, are passed on.
    pub attribution: Option<String>,
}

impl Licence {
    /// Returns the licence that a checkpoint states. PyTorch checkpoints state none.
    pub(crate) fn of(checkpoint: &Checkpoint) -> Option<Licence> {
        Some(Licence {
            name: checkpoint.metadata("license")?.to_owned(),
            attribution: checkpoint.metadata("attribution").map(str::to_owned),
        })
    }

    /// Returns the notice that generated motions have, and files and pictures of them.
    pub fn notice(&self) -> String {
        format!("Made with a model under {self}")
    }

    /// Whether the name of the licence says that commercial use is excluded.
    pub fn is_non_commercial(&self) -> bool {
        let name = self.name.to_lowercase();
        name.split(|c: char| !c.is_alphanumeric())
            .any(|part| part == "nc")
            || name.contains("non-commercial")
            || name.contains("noncommercial")
    }
}

impl fmt::Display for Licence {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.name)?;
        if self.is_non_commercial() {
            f.write_str(", not for commercial use")?;
        }
        if let Some(attribution) = &self.attribution {
            write!(f, ". To be named: {}", attribution.trim_end())?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn non_commercial_licences_are_recognized_by_their_names() {
        let licence = |name: &str| Licence {
            name: name.into(),
            attribution: None,
        };
        assert!(licence("CC-BY-NC-4.0").is_non_commercial());
        assert!(licence("S-Lab Non-Commercial License").is_non_commercial());
        assert!(!licence("MIT").is_non_commercial());
        assert!(!licence("CC-BY-SYNC-1.0").is_non_commercial());
        let named = Licence {
            name: "MIT".into(),
            attribution: Some("A, B.\nC.\n".into()),
        };
        assert_eq!(named.to_string(), "MIT. To be named: A, B.\nC.");
    }
}
