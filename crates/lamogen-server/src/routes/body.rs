//! Bodies: those of requests, read within their limits, and answers as JSON.

use std::error::Error;
use std::time::Duration;

use axum::body::{Body, Bytes, to_bytes};
use axum::http::{HeaderMap, header};
use axum::response::{IntoResponse, Response};
use serde_json::Value;

use crate::problem::{Problem, ProblemKind};

/// Answers with JSON.
pub(crate) fn json(value: &Value) -> Response {
    let headers = [(header::CONTENT_TYPE, "application/json")];
    (headers, value.to_string()).into_response()
}

/// Returns the size of a body that its head states, if it does.
pub(crate) fn stated_size(headers: &HeaderMap) -> Option<usize> {
    headers
        .get(header::CONTENT_LENGTH)?
        .to_str()
        .ok()?
        .parse()
        .ok()
}

/// Makes the problem of a body that is larger than `largest` bytes.
pub(crate) fn too_large(largest: usize, found: impl ToString) -> Problem {
    let expected = format!("at most {largest} bytes");
    Problem::mismatch(ProblemKind::TooLarge, expected, found.to_string()).at("body")
}

/// Reads a body of at most `largest` bytes that arrives within a time.
///
/// # Errors
///
/// If the body is larger or slower, or if the connection breaks.
pub(crate) async fn read_body(
    headers: &HeaderMap,
    body: Body,
    largest: usize,
    time: Duration,
) -> Result<Bytes, Problem> {
    if let Some(size) = stated_size(headers).filter(|size| *size > largest) {
        return Err(too_large(largest, format!("{size} bytes")));
    }
    match tokio::time::timeout(time, to_bytes(body, largest)).await {
        Ok(Ok(bytes)) => Ok(bytes),
        Ok(Err(error)) if is_too_large(&error) => Err(too_large(largest, "more")),
        Ok(Err(error)) => {
            let detail = format!("the body broke off: {error}");
            Err(Problem::new(ProblemKind::InvalidRequest, detail).at("body"))
        }
        Err(_) => {
            let expected = format!("the whole body within {} s", time.as_secs_f64());
            Err(Problem::mismatch(ProblemKind::SlowRequest, expected, "a part of it").at("body"))
        }
    }
}

/// Returns whether a body could not be read because of its size.
fn is_too_large(error: &axum::Error) -> bool {
    let mut source = error.source();
    while let Some(reason) = source {
        if reason.is::<http_body_util::LengthLimitError>() {
            return true;
        }
        source = reason.source();
    }
    false
}
