//! The words of a BVH, and where they stand.

use std::io;
use std::path::{Path, PathBuf};

/// Why a BVH cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum BvhError {
    /// The file cannot be opened or read.
    #[error("{path}: {reason}")]
    #[allow(missing_docs)]
    Io { path: PathBuf, reason: io::Error },
    /// Something else than BVH stands in a line.
    #[error("{path}, line {line}: expected {expected}, found {found}")]
    #[allow(missing_docs)]
    Syntax {
        path: PathBuf,
        line: usize,
        expected: String,
        found: String,
    },
}

/// A place in the text.
#[derive(Clone)]
pub(super) struct Cursor<'a> {
    text: &'a str,
    line: usize,
    path: &'a Path,
}

impl<'a> Cursor<'a> {
    pub(super) fn new(text: &'a str, path: &'a Path) -> Self {
        Cursor {
            text,
            line: 1,
            path,
        }
    }

    /// The next word without taking it; empty at the end of the file. Braces are words of their own.
    pub(super) fn peek(&mut self) -> &'a str {
        let rest = self.text.trim_start();
        let skipped = &self.text[..self.text.len() - rest.len()];
        self.line += skipped.matches('\n').count();
        self.text = rest;
        self.peek_in_line()
    }

    /// The next word of this line; empty at its end.
    pub(super) fn peek_in_line(&mut self) -> &'a str {
        self.text = self
            .text
            .trim_start_matches(|c: char| c.is_whitespace() && c != '\n');
        if self.text.starts_with(['{', '}']) {
            return &self.text[..1];
        }
        let end = self
            .text
            .find(|c: char| c.is_whitespace() || c == '{' || c == '}');
        &self.text[..end.unwrap_or(self.text.len())]
    }

    /// The next word.
    pub(super) fn token(&mut self) -> &'a str {
        let token = self.peek();
        self.text = &self.text[token.len()..];
        token
    }

    /// Takes a word that must be one of some, in any case; what follows a colon in it stays.
    pub(super) fn keyword(&mut self, words: &[&str], expected: &str) -> Result<(), BvhError> {
        let token = self.peek();
        let word = token.split(':').next().unwrap_or(token);
        if !words
            .iter()
            .any(|expected| word.eq_ignore_ascii_case(expected))
        {
            return Err(self.error(expected, &self.shown()));
        }
        self.text = &self.text[word.len()..];
        Ok(())
    }

    /// Takes a colon if there is one.
    pub(super) fn colon(&mut self) {
        self.peek();
        self.text = self.text.strip_prefix(':').unwrap_or(self.text);
    }

    /// Everything up to the opening brace, which is taken, too.
    pub(super) fn name(&mut self) -> Result<String, BvhError> {
        self.peek();
        let at = self.clone();
        let end = self.text.find(['{', '}', '\n']).unwrap_or(self.text.len());
        let name = self.text[..end].trim().to_owned();
        self.text = &self.text[end..];
        match self.token() {
            "{" => Ok(name),
            _ => Err(at.error("a joint's name and {", &at.shown())),
        }
    }

    /// The next word as a finite number.
    pub(super) fn number(&mut self, expected: &str) -> Result<f64, BvhError> {
        self.parse(expected, |token| {
            token.parse::<f64>().ok().filter(|value| value.is_finite())
        })
    }

    /// The next word as whatever `parse` makes of it.
    pub(super) fn parse<T>(
        &mut self,
        expected: &str,
        parse: impl Fn(&str) -> Option<T>,
    ) -> Result<T, BvhError> {
        self.peek();
        let found = self.clone();
        parse(self.token()).ok_or_else(|| found.error(expected, &found.shown()))
    }

    /// The next word as error messages show it.
    pub(super) fn shown(&self) -> String {
        let token = self.clone().peek();
        match token.is_empty() {
            true => "the end of the file".into(),
            false => format!("{:?}", token.chars().take(40).collect::<String>()),
        }
    }

    pub(super) fn error(&self, expected: &str, found: &str) -> BvhError {
        let mut at = self.clone();
        at.peek();
        BvhError::Syntax {
            path: self.path.to_owned(),
            line: at.line,
            expected: expected.into(),
            found: found.into(),
        }
    }
}
