//! Printing: results go to stdout, everything else to stderr.

use std::borrow::Cow;
use std::io::{ErrorKind, IsTerminal, Write};

use indicatif::{ProgressBar, ProgressStyle};
use lamogen::Licence;

use crate::arguments::ConsoleArguments;
use crate::failure::{Failure, FailureCode};

/// Prints a line on stderr. Errors, such as a full disk or a closed pipe, are ignored, so that the work goes on.
pub fn print_to_stderr(text: impl AsRef<str>) {
    let _ = writeln!(
        std::io::stderr(),
        "{}",
        escape_control_characters(text.as_ref())
    );
}

/// Formats a number with its noun: `1 clip`, `2 clips`.
pub fn count_noun(count: usize, singular: &str, plural: &str) -> String {
    match count {
        1 => format!("1 {singular}"),
        _ => format!("{count} {plural}"),
    }
}

/// Escapes the control characters of a text, which could control the terminal: a prompt or the name of a file may
/// contain any.
fn escape_control_characters(text: &str) -> Cow<'_, str> {
    let is_unsafe = |c: char| c.is_control() && !matches!(c, '\n' | '\t');
    if !text.contains(is_unsafe) {
        return Cow::Borrowed(text);
    }
    let mut escaped = String::with_capacity(text.len());
    for c in text.chars() {
        match is_unsafe(c) {
            true => escaped.extend(c.escape_default()),
            false => escaped.push(c),
        }
    }
    Cow::Owned(escaped)
}

/// Prints results, notices and progress.
pub struct Console {
    /// Whether results are printed as JSON.
    pub json: bool,
    quiet: bool,
}

impl Console {
    pub fn new(arguments: &ConsoleArguments) -> Self {
        Console {
            json: arguments.json,
            quiet: arguments.quiet,
        }
    }

    /// Returns a console without notices and progress bars, for parts of a task that has a progress bar itself.
    pub fn without_notices(&self) -> Console {
        Console {
            json: self.json,
            quiet: true,
        }
    }

    /// Whether notices are not printed.
    pub fn is_quiet(&self) -> bool {
        self.quiet
    }

    /// Prints a result.
    pub fn print(&self, text: impl AsRef<str>) -> Result<(), Failure> {
        let mut out = std::io::stdout().lock();
        let text = text.as_ref().trim_end_matches('\n');
        match writeln!(out, "{}", escape_control_characters(text)) {
            // The program that reads stdout may stop early; that is not an error.
            Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(Failure::new(
                FailureCode::Output,
                format!("stdout: {error}"),
            )),
            _ => Ok(()),
        }
    }

    /// Prints a notice.
    pub fn notice(&self, text: impl AsRef<str>) {
        if !self.quiet {
            print_to_stderr(text);
        }
    }

    /// Prints the licence of the weights as a notice, if it excludes commercial use.
    pub fn notice_licence(&self, licence: Option<&Licence>) {
        if let Some(licence) = licence.filter(|licence| licence.is_non_commercial()) {
            self.notice(format!("Model: {licence}"));
        }
    }

    /// Makes a progress bar; it is hidden if notices are off or stderr is not a terminal.
    pub fn progress_bar(&self, unit: &str) -> ProgressBar {
        if self.quiet || !std::io::stderr().is_terminal() {
            return ProgressBar::hidden();
        }
        let template =
            format!("{{msg:9}} {{bar:40}} {{pos}}/{{len}} {unit}, {{elapsed}}, {{eta}} left");
        let style = ProgressStyle::with_template(&template).expect("the template is well-formed");
        ProgressBar::no_length().with_style(style)
    }
}

#[cfg(test)]
mod tests {
    use super::escape_control_characters;

    #[test]
    fn control_characters_are_escaped() {
        assert_eq!(escape_control_characters("a\tb\nc é"), "a\tb\nc é");
        assert_eq!(
            escape_control_characters("\u{1b}[31mred\u{7}\r\u{9b}2J"),
            "\\u{1b}[31mred\\u{7}\\r\\u{9b}2J"
        );
    }
}
