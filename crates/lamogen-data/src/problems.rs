//! What was left out, and why.

use std::collections::{BTreeMap, HashMap};
use std::fmt;

use crate::options::LoadOptions;

/// A motion that is not in the data set.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Problem {
    /// Its name, or its place in a file.
    pub name: String,
    /// What is the matter.
    pub kind: ProblemKind,
    /// The same in words: what was expected, what was found.
    pub reason: String,
}

/// Why a motion is not in the data set.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum ProblemKind {
    /// It has fewer frames than the options ask for.
    TooShort,
    /// It has more frames than the options allow.
    TooLong,
    /// It is listed, but its file is missing; or there are captions of it and nothing else.
    Missing,
    /// Its file cannot be read as a motion.
    Unreadable,
    /// Its array has another shape.
    Shape,
    /// A number is not finite, or too large for 16 bits.
    NotFinite,
    /// Nothing is said of it.
    NoCaption,
    /// A line about it makes no sense.
    Line,
    /// It is there twice.
    Twice,
}

impl ProblemKind {
    /// Whether the motion is well and only out of the options' limits.
    pub fn is_limit(self) -> bool {
        matches!(self, ProblemKind::TooShort | ProblemKind::TooLong)
    }

    /// In words, such as `too short`.
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

/// Everything that was left out of a data set.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Problems {
    list: Vec<Problem>,
}

impl Problems {
    /// Everything, in the order in which it was met.
    pub fn iter(&self) -> impl Iterator<Item = &Problem> {
        self.list.iter()
    }

    /// How many motions were left out.
    pub fn len(&self) -> usize {
        self.list.len()
    }

    /// Whether nothing was left out.
    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// How many of a kind.
    pub fn count(&self, kind: ProblemKind) -> usize {
        self.iter().filter(|problem| problem.kind == kind).count()
    }

    /// How many of every kind that there is.
    pub fn counts(&self) -> BTreeMap<ProblemKind, usize> {
        let mut counts = BTreeMap::new();
        for problem in &self.list {
            *counts.entry(problem.kind).or_default() += 1;
        }
        counts
    }

    /// What is broken: everything but motions that are merely out of the options' limits.
    pub fn broken(&self) -> impl Iterator<Item = &Problem> {
        self.iter().filter(|problem| !problem.kind.is_limit())
    }

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

    /// The counts as a sentence, with the first reason of every kind.
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

/// Whether a length is within the limits, and if not, what to say of it.
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
