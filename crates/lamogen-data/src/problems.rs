//! The motions that were left out of a data set, with the reasons.

use std::collections::{BTreeMap, HashMap};
use std::fmt;

use crate::options::LoadOptions;

/// A motion that is not in the data set.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Problem {
    /// The name of the motion, or the place of its line in a file.
    pub name: String,
    /// The kind of problem.
    pub kind: ProblemKind,
    /// The problem in words: what was expected and what was found.
    pub reason: String,
}

/// The kinds of reasons why a motion is not in the data set.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum ProblemKind {
    /// The motion has fewer frames than the options require.
    TooShort,
    /// The motion has more frames than the options allow.
    TooLong,
    /// The motion is listed but its file is missing, or it has captions but no motion.
    Missing,
    /// The motion's file cannot be read.
    Unreadable,
    /// The motion's array has an unexpected shape.
    Shape,
    /// A number is not finite, or too large for 16 bits.
    NotFinite,
    /// The motion has no caption.
    NoCaption,
    /// A line about the motion is invalid.
    Line,
    /// The motion occurs twice.
    Twice,
}

impl ProblemKind {
    /// Returns whether the motion itself is valid and only its length is out of the options' limits.
    pub fn is_limit(self) -> bool {
        matches!(self, ProblemKind::TooShort | ProblemKind::TooLong)
    }

    /// Returns the kind in words, such as `too short`.
    pub const fn name(self) -> &'static str {
        match self {
            ProblemKind::TooShort => "too short",
            ProblemKind::TooLong => "too long",
            ProblemKind::Missing => "missing",
            ProblemKind::Unreadable => "unreadable",
            ProblemKind::Shape => "wrong shape",
            ProblemKind::NotFinite => "not finite",
            ProblemKind::NoCaption => "without captions",
            ProblemKind::Line => "unreadable line",
            ProblemKind::Twice => "there twice",
        }
    }
}

impl fmt::Display for ProblemKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// All motions that were left out of a data set, with the reasons.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Problems {
    list: Vec<Problem>,
}

impl Problems {
    /// Returns all problems, in the order in which they were found.
    pub fn iter(&self) -> impl Iterator<Item = &Problem> {
        self.list.iter()
    }

    /// Returns the number of motions that were left out.
    pub fn len(&self) -> usize {
        self.list.len()
    }

    /// Returns whether no motion was left out.
    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// Returns the number of problems of a kind.
    pub fn count(&self, kind: ProblemKind) -> usize {
        self.iter().filter(|problem| problem.kind == kind).count()
    }

    /// Returns the number of problems of every kind that occurs.
    pub fn counts(&self) -> BTreeMap<ProblemKind, usize> {
        let mut counts = BTreeMap::new();
        for problem in &self.list {
            *counts.entry(problem.kind).or_default() += 1;
        }
        counts
    }

    /// Returns all problems but those of motions that are only too short or too long for the options.
    pub fn broken(&self) -> impl Iterator<Item = &Problem> {
        self.iter().filter(|problem| !problem.kind.is_limit())
    }

    /// Adds a problem.
    pub(crate) fn add(
        &mut self,
        name: impl Into<String>,
        kind: ProblemKind,
        reason: impl ToString,
    ) {
        self.list.push(Problem {
            name: name.into(),
            kind,
            reason: reason.to_string(),
        });
    }

    pub(crate) fn extend(&mut self, problems: impl IntoIterator<Item = Problem>) {
        self.list.extend(problems);
    }

    /// Returns the counts as a sentence, with the first problem of every kind.
    pub(crate) fn summary(&self) -> String {
        let mut first = HashMap::new();
        for problem in &self.list {
            first.entry(problem.kind).or_insert(problem);
        }
        let counts = self.counts().into_iter().map(|(kind, count)| {
            let Problem { name, reason, .. } = first[&kind];
            format!("{count} {kind} (the first: {name}: {reason})")
        });
        match self.is_empty() {
            true => "nothing is listed".into(),
            false => counts.collect::<Vec<_>>().join("; "),
        }
    }
}

/// Checks that a length is within the limits. The error is the kind of problem and its reason.
pub(crate) fn check_length(
    frames: usize,
    options: &LoadOptions,
) -> Result<(), (ProblemKind, String)> {
    let LoadOptions {
        min_frames,
        max_frames,
    } = *options;
    let reason = |limit: &str, n: usize| format!("expected {limit} {n} frames, found {frames}");
    if frames < min_frames {
        return Err((ProblemKind::TooShort, reason("at least", min_frames)));
    }
    if frames > max_frames {
        return Err((ProblemKind::TooLong, reason("at most", max_frames)));
    }
    Ok(())
}
