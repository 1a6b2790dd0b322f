//! A cursor that reads a BVH text word by word and knows the line numbers for error messages.

use std::path::{Path, PathBuf};

/// The reason why a BVH cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum BvhError {
    /// A line does not follow the BVH format.
    #[error("{path}, line {line}: expected {expected}, found {found}")]
    #[allow(missing_docs)]
    Syntax {
        path: PathBuf,
        line: usize,
        expected: String,
        found: String,
    },
}

/// A position in the text of a BVH.
#[derive(Clone)]
pub(super) struct Cursor<'a> {
    /// The whole text.
    whole: &'a str,
    /// The part of the text that has not been consumed.
    text: &'a str,
    line: usize,
    path: &'a Path,
}

impl<'a> Cursor<'a> {
    pub(super) fn new(text: &'a str, path: &'a Path) -> Self {
        Cursor {
            whole: text,
            text,
            line: 1,
            path,
        }
    }

    /// Returns the text that has been consumed.
    pub(super) fn text_before(&self) -> &'a str {
        &self.whole[..self.whole.len() - self.text.len()]
    }

    /// Returns the next word without consuming it; it is empty at the end of the file. Each brace is a separate word.
    pub(super) fn peek(&mut self) -> &'a str {
        let rest = self.text.trim_start();
        let skipped = &self.text[..self.text.len() - rest.len()];
        self.line += skipped.matches('\n').count();
        self.text = rest;
        self.peek_in_line()
    }

    /// Returns the next word of the current line without consuming it; it is empty at the end of the line.
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

    /// Consumes and returns the next word.
    pub(super) fn next_token(&mut self) -> &'a str {
        let token = self.peek();
        self.text = &self.text[token.len()..];
        token
    }

    /// Consumes the next word, which must be one of `words`, in upper or lower case. A colon in the word and the
    /// characters after it are not consumed.
    pub(super) fn expect_keyword(
        &mut self,
        words: &[&str],
        expected: &str,
    ) -> Result<(), BvhError> {
        let token = self.peek();
        let word = token.split(':').next().unwrap_or(token);
        if !words
            .iter()
            .any(|expected| word.eq_ignore_ascii_case(expected))
        {
            return Err(self.error(expected, &self.describe_next()));
        }
        self.text = &self.text[word.len()..];
        Ok(())
    }

    /// Consumes the next colon if there is one.
    pub(super) fn skip_colon(&mut self) {
        self.peek();
        self.text = self.text.strip_prefix(':').unwrap_or(self.text);
    }

    /// Consumes and returns the text up to the opening brace, and consumes the brace too.
    pub(super) fn joint_name(&mut self) -> Result<String, BvhError> {
        self.peek();
        let start = self.clone();
        let end = self.text.find(['{', '}', '\n']).unwrap_or(self.text.len());
        let name = self.text[..end].trim().to_owned();
        self.text = &self.text[end..];
        match self.next_token() {
            "{" => Ok(name),
            _ => Err(start.error("a joint's name and {", &start.describe_next())),
        }
    }

    /// Consumes the next word and returns it as a finite number.
    pub(super) fn number(&mut self, expected: &str) -> Result<f64, BvhError> {
        self.parse(expected, |token| {
            token.parse::<f64>().ok().filter(|value| value.is_finite())
        })
    }

    /// Consumes the next word and returns the value that `parse` reads from it.
    pub(super) fn parse<T>(
        &mut self,
        expected: &str,
        parse: impl Fn(&str) -> Option<T>,
    ) -> Result<T, BvhError> {
        self.peek();
        let found = self.clone();
        parse(self.next_token()).ok_or_else(|| found.error(expected, &found.describe_next()))
    }

    /// Returns the next word in the form used in error messages.
    pub(super) fn describe_next(&self) -> String {
        let token = self.clone().peek();
        match token.is_empty() {
            true => "the end of the file".into(),
            false => format!("{:?}", token.chars().take(40).collect::<String>()),
        }
    }

    /// Creates an error at the line of the next word.
    pub(super) fn error(&self, expected: &str, found: &str) -> BvhError {
        let mut next = self.clone();
        next.peek();
        BvhError::Syntax {
            path: self.path.to_owned(),
            line: next.line,
            expected: expected.into(),
            found: found.into(),
        }
    }
}
