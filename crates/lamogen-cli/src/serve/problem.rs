//! Errors of motions as the server answers them.

use lamogen::{Error, RequestError};
use lamogen_server::{Problem, ProblemKind};

use crate::failure::Failure;

/// Makes the problem of a request that the model cannot run.
pub fn request_problem(error: &RequestError) -> Problem {
    let problem = Problem::new(ProblemKind::InvalidRequest, error);
    match error {
        RequestError::EmptyPrompt
        | RequestError::LongPrompt { .. }
        | RequestError::Tokenizer(_) => problem.at("prompt"),
        RequestError::Length { .. } => split(problem).at("seconds"),
        RequestError::LoopOfWindows => split(problem).at("loop"),
        RequestError::Guidance(_) => split(problem).at("steps"),
        _ => split(problem),
    }
}

/// Makes the problem of a motion that could not be generated.
pub fn run_problem(error: &Error) -> Problem {
    match error {
        Error::Request { reason, .. } => request_problem(reason),
        _ => Problem::new(ProblemKind::GenerationFailed, error),
    }
}

/// Makes the problem of a failure of the command, such as that of a file that cannot be read.
pub fn failure_problem(kind: ProblemKind, failure: &Failure) -> Problem {
    Problem::new(kind, &failure.message)
}

/// Makes the problem of a request that is not valid. If the reason names the field, that is where it is; otherwise it is in the
/// body.
pub fn invalid_request(reason: impl ToString) -> Problem {
    let reason = reason.to_string();
    let named = ["unknown field `", "missing field `", "duplicate field `"];
    let named = named
        .iter()
        .find_map(|start| reason.strip_prefix(start)?.split('`').next());
    let is_name = |name: &&str| {
        name.bytes()
            .all(|byte| byte.is_ascii_lowercase() || byte == b'_')
    };
    let first = { reason.split_once(": ") }
        .map(|(first, _)| first)
        .filter(is_name);
    let place = named.or(first).unwrap_or("body").to_owned();
    split(Problem::new(ProblemKind::InvalidRequest, reason)).at(place)
}

/// Takes what was expected and what was found from the words of a problem, where they are in the form of all errors of lamogen:
/// "expected …, found …".
pub fn split(problem: Problem) -> Problem {
    let parts = { problem.detail.split_once("expected ") }
        .and_then(|(_, rest)| rest.split_once(", found "))
        .map(|(expected, found)| (expected.to_owned(), found.to_owned()));
    match parts {
        Some((expected, found)) => Problem {
            expected: Some(expected),
            found: Some(found),
            ..problem
        },
        None => problem,
    }
}
