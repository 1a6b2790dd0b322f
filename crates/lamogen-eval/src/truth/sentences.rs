//! The sentences, and the table that they stand in.

use std::fmt;

use serde::{Serialize, Serializer};

use super::checks::{Check, CheckError};

/// A sentence as a user may try it, with what its motion has to do.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Sentence {
    /// What it is about in a word, such as `walk` or `turns`.
    pub group: String,
    /// How it is phrased.
    pub phrasing: Phrasing,
    /// Length of the motion, s.
    pub seconds: f32,
    /// The sentence.
    pub text: String,
    /// What the motion has to do, all of it; at least one.
    pub checks: Vec<Check>,
}

/// How a sentence is phrased, beside the captions of open motion capture that models here are trained on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Phrasing {
    /// As captions are: every two words that follow each other do so in a caption, too.
    Training,
    /// In words or an order that no caption has.
    Novel,
}

impl Phrasing {
    /// Both.
    pub const ALL: [Phrasing; 2] = [Phrasing::Training, Phrasing::Novel];

    /// The word, `training` or `novel`.
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

/// What is wrong with a line of a table of sentences; lines count from 1.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[allow(missing_docs)]
pub enum SentencesError {
    /// Not five cells.
    #[error(
        "line {line}: expected `group | phrasing | seconds | sentence | checks`, found {found} cells"
    )]
    Cells { line: usize, found: usize },
    /// No phrasing.
    #[error("line {line}: expected the phrasing `training` or `novel`, found `{found}`")]
    Phrasing { line: usize, found: String },
    /// No length.
    #[error("line {line}: expected a length in seconds above 0, found `{found}`")]
    Seconds { line: usize, found: String },
    /// No check.
    #[error("line {line}: {reason}")]
    Check { line: usize, reason: CheckError },
}

/// The sentences of this crate, in the order of its table `sentences.txt`.
pub fn sentences() -> Vec<Sentence> {
    read_sentences(include_str!("sentences.txt")).expect("a test reads the table")
}

/// Reads a table of sentences: a line each, `group | phrasing | seconds | sentence | check, check`, the checks in the words of
/// [`Check::ALL`]. Empty lines, and lines that begin with `#`, are left out.
///
/// # Errors
///
/// If a line is not of that form.
pub fn read_sentences(table: &str) -> Result<Vec<Sentence>, SentencesError> {
    let lines = table.lines().enumerate();
    let lines = lines.map(|(index, line)| (index + 1, line.trim()));
    let lines = lines.filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
    lines.map(|(line, text)| sentence(line, text)).collect()
}

fn sentence(line: usize, text: &str) -> Result<Sentence, SentencesError> {
    let cells: Vec<&str> = text.split('|').map(str::trim).collect();
    let &[group, phrasing, seconds, text, checks] = &cells[..] else {
        let found = cells.len();
        return Err(SentencesError::Cells { line, found });
    };
    let known = Phrasing::ALL
        .into_iter()
        .find(|known| known.name() == phrasing);
    let phrasing = known.ok_or_else(|| SentencesError::Phrasing {
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
    fn every_sentence_with_a_side_has_a_twin_with_the_other() {
        let sentences = sentences();
        let checks = |side: &str| {
            let checks = sentences.iter().flat_map(|sentence| &sentence.checks);
            let words = checks.map(|check| check.to_string());
            words.filter(|words| words.contains(side)).count()
        };
        assert_eq!(checks("left"), checks("right"));
    }

    #[test]
    fn what_is_wrong_with_a_line_is_said() {
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
