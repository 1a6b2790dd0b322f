//! The splits of a data set: training, validation and test.

use std::fmt;
use std::str::FromStr;

use crate::checksum::Checksum;

/// A split of a data set: the purpose of its entries.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Split {
    /// Entries for training; `train` in files.
    Train,
    /// Entries for choosing settings; `val` in files.
    Validation,
    /// Entries for final measurements; `test` in files.
    Test,
}

impl Split {
    /// All splits: training, validation, test.
    pub const ALL: [Split; 3] = [Split::Train, Split::Validation, Split::Test];

    /// Returns the split of a recording, which depends on its name and the seed only: 80 % of names are for training,
    /// 5 % for validation and 15 % for tests, as in HumanML3D.
    pub(crate) fn by_hash(trial: &str, seed: u64) -> Split {
        let mut sum = Checksum::new(seed);
        sum.add(trial.as_bytes());
        let mut hash = sum.value();
        // The final mixing of SplitMix64; without it, names that differ in one letter would have similar hashes.
        hash = (hash ^ (hash >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        hash = (hash ^ (hash >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        match (hash ^ (hash >> 31)) % 100 {
            0..80 => Split::Train,
            80..85 => Split::Validation,
            _ => Split::Test,
        }
    }

    /// Returns the name in files: `train`, `val` or `test`.
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

/// The error for a word that is not the name of a split. It holds the word.
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
    fn names_are_assigned_in_the_proportions_of_humanml3d() {
        let share = |split: Split, seed: u64| {
            let names = (0..10_000).map(|i| format!("walk_{i}.bvh"));
            names
                .filter(|name| Split::by_hash(name, seed) == split)
                .count()
        };
        for seed in [0, 1] {
            for (split, expected) in Split::ALL.into_iter().zip([8000, 500, 1500]) {
                assert!(share(split, seed).abs_diff(expected) < 150, "{split}");
            }
        }
        let differs = |name: &&str| Split::by_hash(name, 0) != Split::by_hash(name, 1);
        let names = ["a", "b", "c", "d", "e", "f", "g", "h", "i", "j", "k", "l"];
        assert!(names.iter().any(differs));
    }

    #[test]
    fn splits_are_read_as_they_are_written() {
        for split in Split::ALL {
            assert_eq!(split.to_string().parse(), Ok(split));
        }
        let message = "validation".parse::<Split>().unwrap_err().to_string();
        assert!(message.contains("val") && message.contains("validation"));
    }
}
