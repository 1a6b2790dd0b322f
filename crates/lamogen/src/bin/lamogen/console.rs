//! What is said, and where: results on stdout, everything else on stderr.

use std::borrow::Cow;
use std::io::{ErrorKind, IsTerminal, Write};

use indicatif::{ProgressBar, ProgressStyle};
use lamogen::Licence;

use crate::arguments::ConsoleArguments;
use crate::failure::{Code, Failure};

/// Prints a line on stderr. Where nobody can read it, such as on a full disk or a closed pipe, the work goes on without.
pub fn tell(text: impl AsRef<str>) {
    let _ = writeln!(std::io::stderr(), "{}", visible(text.as_ref()));
}

/// A number of things in words: `1 clip`, `2 clips`.
pub fn counted(count: usize, one: &str, many: &str) -> String {
    match count {
        1 => format!("1 {one}"),
        _ => format!("{count} {many}"),
    }
}

/// A text without control characters that could drive a terminal: a prompt or a file's name may have any.
fn visible(text: &str) -> Cow<'_, str> {
    let drives = |c: char| c.is_control() && !matches!(c, '\n' | '\t');
    if !text.contains(drives) {
        return Cow::Borrowed(text);
    }
    let mut shown = String::with_capacity(text.len());
    for c in text.chars() {
        match drives(c) {
            true => shown.extend(c.escape_default()),
            false => shown.push(c),
        }
    }
    Cow::Owned(shown)
}

/// Where results, notices and progress go.
pub struct Console {
    /// Results are JSON.
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

    /// The same without notices and bars, for parts of a work that has a bar itself.
    pub fn hushed(&self) -> Console {
        Console {
            json: self.json,
            quiet: true,
        }
    }

    /// Whether notices go nowhere.
    pub fn is_quiet(&self) -> bool {
        self.quiet
    }

    /// Prints a result.
    pub fn say(&self, text: impl AsRef<str>) -> Result<(), Failure> {
        let mut out = std::io::stdout().lock();
        let text = text.as_ref().trim_end_matches('\n');
        match writeln!(out, "{}", visible(text)) {
            // Whoever reads along may stop reading.
            Err(error) if error.kind() != ErrorKind::BrokenPipe => {
                Err(Failure::new(Code::Output, format!("stdout: {error}")))
            }
            _ => Ok(()),
        }
    }

    /// Prints something that is good to know.
    pub fn notice(&self, text: impl AsRef<str>) {
        if !self.quiet {
            tell(text);
        }
    }

    /// Says under which terms the weights may be used, if they exclude commercial use.
    pub fn licence(&self, licence: Option<&Licence>) {
        if let Some(licence) = licence.filter(|licence| licence.is_non_commercial()) {
            self.notice(format!("Model: {licence}"));
        }
    }

    /// A bar for long work; hidden where nobody sees it.
    pub fn bar(&self, unit: &str) -> ProgressBar {
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
    use super::visible;

    #[test]
    fn control_characters_are_shown_instead_of_obeyed() {
        assert_eq!(visible("a\tb\nc é"), "a\tb\nc é");
        assert_eq!(
            visible("\u{1b}[31mred\u{7}\r\u{9b}2J"),
            "\\u{1b}[31mred\\u{7}\\r\\u{9b}2J"
        );
    }
}
