//! Everyday sentences and the table that contains them.

use std::fmt;

use serde::{Serialize, Serializer};

use super::checks::{Check, CheckError};

/// A sentence that a user may try, with the checks of its motion.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Sentence {
    /// The group of sentences that it belongs to, such as `walk` or `turns`.
    pub group: String,
    /// The phrasing of the sentence.
    pub phrasing: Phrasing,
    /// The length of the motion, s.
    pub seconds: f32,
    /// The sentence.
    pub text: String,
    /// The checks that must all hold for the motion; at least one.
    pub checks: Vec<Check>,
}

/// The phrasing of a sentence, compared with the captions of open motion capture that the models of this project are
/// trained on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Phrasing {
    /// Every pair of consecutive words is in a caption, too.
    Training,
    /// The sentence has words, or pairs of consecutive words, that no caption has.
    Novel,
}

impl Phrasing {
    /// Both phrasings.
    pub const ALL: [Phrasing; 2] = [Phrasing::Training, Phrasing::Novel];

    /// Returns the name, `training` or `novel`.
    pub const fn name(self) -> &'static str {
        match self {
            Phrasing::Training => "training",
            Phrasing::Novel => "novel",
        }
    }
}

impl fmt::Display for Phrasing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

impl Serialize for Phrasing {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name())
    }
}

/// An error in a line of a table of sentences. Lines are counted from 1.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[allow(missing_docs)]
pub enum SentencesError {
    /// The line does not have five cells.
    #[error(
        "line {line}: expected `group | phrasing | seconds | sentence | checks`, found {found} cells"
    )]
    Cells { line: usize, found: usize },
    /// The second cell is not a phrasing.
    #[error("line {line}: expected the phrasing `training` or `novel`, found `{found}`")]
    Phrasing { line: usize, found: String },
    /// The third cell is not a length.
    #[error("line {line}: expected a length in seconds above 0, found `{found}`")]
    Seconds { line: usize, found: String },
    /// The last cell has a check that does not exist.
    #[error("line {line}: {reason}")]
    Check { line: usize, reason: CheckError },
}

/// Returns the sentences of this crate, in the order of its table `sentences.txt`.
pub fn sentences() -> Vec<Sentence> {
    read_sentences(include_str!("sentences.txt")).expect("a test reads the table")
}

/// Reads a table of sentences. Every line is `group | phrasing | seconds | sentence | check, check`, with checks in the
/// words of [`Check::ALL`]. Empty lines and lines that begin with `#` are ignored.
///
/// # Errors
///
/// If a line does not have this form.
pub fn read_sentences(table: &str) -> Result<Vec<Sentence>, SentencesError> {
    let lines = table.lines().enumerate();
    let lines = lines.map(|(index, line)| (index + 1, line.trim()));
    let lines = lines.filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
    lines.map(|(line, text)| parse_line(line, text)).collect()
}

/// Parses a line of the table.
fn parse_line(line: usize, text: &str) -> Result<Sentence, SentencesError> {
    let cells: Vec<&str> = text.split('|').map(str::trim).collect();
    let &[group, phrasing, seconds, text, checks] = &cells[..] else {
        let found = cells.len();
        return Err(SentencesError::Cells { line, found });
    };
    let named = Phrasing::ALL
        .into_iter()
        .find(|named| named.name() == phrasing);
    let phrasing = named.ok_or_else(|| SentencesError::Phrasing {
        line,
        found: phrasing.into(),
    })?;
    let length = seconds.parse().ok();
    let length = length.filter(|length: &f32| length.is_finite() && *length > 0.0);
    let seconds = length.ok_or_else(|| SentencesError::Seconds {
        line,
        found: seconds.into(),
    })?;
    let checks = checks.split(',').map(str::parse);
    let checks = checks.collect::<Result<_, _>>();
    Ok(Sentence {
        group: group.into(),
        phrasing,
        seconds,
        text: text.into(),
        checks: checks.map_err(|reason| SentencesError::Check { line, reason })?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn the_table_is_read_and_long_enough_and_four_in_ten_sentences_are_novel() {
        let sentences = read_sentences(include_str!("sentences.txt")).unwrap();
        assert!(sentences.len() >= 96, "{}", sentences.len());
        let novel = sentences
            .iter()
            .filter(|sentence| sentence.phrasing == Phrasing::Novel);
        assert!(novel.count() * 10 >= sentences.len() * 4);
        let texts: BTreeSet<&str> = sentences.iter().map(|sentence| &*sentence.text).collect();
        assert_eq!(
            texts.len(),
            sentences.len(),
            "no sentence stands there twice"
        );
    }

    #[test]
    fn every_check_of_a_side_has_one_of_the_other_side() {
        let sentences = sentences();
        let checks = |side: &str| {
            let checks = sentences.iter().flat_map(|sentence| &sentence.checks);
            let words = checks.map(|check| check.to_string());
            words.filter(|words| words.contains(side)).count()
        };
        assert_eq!(checks("left"), checks("right"));
    }

    #[test]
    fn the_error_says_what_is_wrong_with_a_line() {
        for (line, expected) in [
            ("walk | training | 4 | a person walks", "found 4 cells"),
            ("walk | old | 4 | a person walks | jumps", "found `old`"),
            ("walk | novel | no | a person walks | jumps", "found `no`"),
            ("walk | novel | 0 | a person walks | jumps", "above 0"),
            (
                "walk | novel | 4 | a person walks | jumps, flies",
                "`flies`",
            ),
        ] {
            let message = read_sentences(&format!("# head\n\n{line}\n")).unwrap_err();
            let message = message.to_string();
            assert!(message.contains(expected), "{message}");
            assert!(message.contains("line 3"), "{message}");
        }
    }
}
