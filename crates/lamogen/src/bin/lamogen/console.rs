//! What is said, and where: results on stdout, everything else on stderr.

use std::io::{ErrorKind, IsTerminal, Write};

use indicatif::{ProgressBar, ProgressStyle};
use lamogen::Licence;

use crate::arguments::ConsoleArguments;
use crate::failure::{Code, Failure};

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
        match writeln!(out, "{}", text.as_ref().trim_end_matches('\n')) {
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
            eprintln!("{}", text.as_ref());
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
