//! Messages for options that expect a number and find something else.

use std::error::Error as _;
use std::num::{IntErrorKind, ParseFloatError, ParseIntError};

use clap::error::{ContextKind, ErrorKind};

/// Says what was expected, where an error has only the standard library's words for a text that is no number.
pub fn explain_number(error: clap::Error) -> clap::Error {
    let Some(expected) = expected_number(&error) else {
        return error;
    };
    let context = |kind| error.get(kind).map(ToString::to_string).unwrap_or_default();
    let (option, value) = (
        context(ContextKind::InvalidArg),
        context(ContextKind::InvalidValue),
    );
    let message = format!(
        "invalid value '{value}' for '{option}': expected {expected}, found '{value}'\n\nFor more information, try '--help'.\n"
    );
    clap::Error::raw(ErrorKind::ValueValidation, message)
}

/// Returns what an option expected, if a text was no number that it takes.
fn expected_number(error: &clap::Error) -> Option<&'static str> {
    let source = error.source()?;
    if source.is::<ParseFloatError>() {
        return Some("a number");
    }
    let source = source.downcast_ref::<ParseIntError>()?;
    Some(match source.kind() {
        IntErrorKind::PosOverflow => "a smaller whole number",
        IntErrorKind::NegOverflow => "a larger whole number",
        _ => "a whole number of at least 0",
    })
}

#[cfg(test)]
mod tests {
    use std::ffi::OsString;

    use crate::arguments::parse;

    #[test]
    fn a_text_that_is_no_number_is_told_what_was_expected() {
        for (command, expected) in [
            (
                "generate walk --steps x",
                "'x' for '--steps <STEPS>': expected a whole number",
            ),
            (
                "generate walk --text-scale-until -3",
                "'-3' for '--text-scale-until",
            ),
            (
                "generate walk --seconds long",
                "expected a number, found 'long'",
            ),
            (
                "generate walk --then jump --seconds long",
                "expected a number, found 'long'",
            ),
            (
                "generate walk --seed 99999999999999999999999",
                "expected a smaller whole number",
            ),
            (
                "batch lines.jsonl --batch-size many",
                "expected a whole number of at least 0",
            ),
        ] {
            let words = ["lamogen"].into_iter().chain(command.split(' '));
            let error = parse(words.map(OsString::from).collect())
                .err()
                .expect(command);
            let message = error.to_string();
            assert!(message.contains(expected), "{command}: {message}");
            assert!(!message.contains("digit found"), "{command}: {message}");
            assert_eq!(error.exit_code(), 2, "{command}");
        }
    }
}
