//! Errors as JSON, in the form of RFC 9457 (`application/problem+json`).

use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde_json::{Map, Value};

/// The kind of a [`Problem`]. It determines the status of the answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProblemKind {
    /// The request is not valid.
    InvalidRequest,
    /// The token is missing or another one.
    Unauthorized,
    /// The request comes from a page or for a host name that is not allowed.
    Forbidden,
    /// There is nothing at this path.
    NotFound,
    /// The path has another method.
    MethodNotAllowed,
    /// No accepted media type is one that the server writes.
    NotAcceptable,
    /// The body did not arrive in time.
    SlowRequest,
    /// The body is larger than allowed.
    TooLarge,
    /// The body has another media type than the expected one.
    UnsupportedMediaType,
    /// A motion file cannot be read.
    UnreadableFile,
    /// The request is valid, but its motion could not be generated.
    GenerationFailed,
    /// The queue is full.
    Busy,
    /// The work took longer than allowed.
    TimeLimit,
    /// The server is ending.
    ShuttingDown,
    /// The server has an error of its own.
    Internal,
}

impl ProblemKind {
    /// Returns the status of the answer, the last part of the problem's type, and its title.
    fn parts(self) -> (StatusCode, &'static str, &'static str) {
        use ProblemKind::*;
        match self {
            InvalidRequest => (
                StatusCode::BAD_REQUEST,
                "invalid-request",
                "The request is not valid",
            ),
            Unauthorized => (
                StatusCode::UNAUTHORIZED,
                "unauthorized",
                "The token is missing or wrong",
            ),
            Forbidden => (
                StatusCode::FORBIDDEN,
                "forbidden",
                "The request is not allowed",
            ),
            NotFound => (StatusCode::NOT_FOUND, "not-found", "Nothing is here"),
            MethodNotAllowed => (
                StatusCode::METHOD_NOT_ALLOWED,
                "method-not-allowed",
                "The path has another method",
            ),
            NotAcceptable => (
                StatusCode::NOT_ACCEPTABLE,
                "not-acceptable",
                "No accepted media type can be written",
            ),
            SlowRequest => (
                StatusCode::REQUEST_TIMEOUT,
                "slow-request",
                "The body did not arrive in time",
            ),
            TooLarge => (
                StatusCode::PAYLOAD_TOO_LARGE,
                "too-large",
                "The body is too large",
            ),
            UnsupportedMediaType => (
                StatusCode::UNSUPPORTED_MEDIA_TYPE,
                "unsupported-media-type",
                "The body has another media type",
            ),
            UnreadableFile => (
                StatusCode::UNPROCESSABLE_ENTITY,
                "unreadable-file",
                "The motion file cannot be read",
            ),
            GenerationFailed => (
                StatusCode::UNPROCESSABLE_ENTITY,
                "generation-failed",
                "The motion could not be generated",
            ),
            Busy => (StatusCode::TOO_MANY_REQUESTS, "busy", "The server is busy"),
            TimeLimit => (
                StatusCode::SERVICE_UNAVAILABLE,
                "time-limit",
                "The work took too long",
            ),
            ShuttingDown => (
                StatusCode::SERVICE_UNAVAILABLE,
                "shutting-down",
                "The server is ending",
            ),
            Internal => (
                StatusCode::INTERNAL_SERVER_ERROR,
                "internal",
                "The server has an error",
            ),
        }
    }

    /// Returns the status of the answer.
    pub fn status(self) -> u16 {
        self.parts().0.as_u16()
    }
}

/// Why a request has no result. It is answered as JSON with `type`, `title`, `status` and `detail` and, where they are
/// known, `expected`, `found` and `where`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Problem {
    /// The kind of the problem.
    pub kind: ProblemKind,
    /// The reason in words.
    pub detail: String,
    /// What was expected. The default is `None`.
    pub expected: Option<String>,
    /// What was found. The default is `None`.
    pub found: Option<String>,
    /// The part of the request that has the problem: the name of a field, of a header or of a file. The default is `None`.
    pub place: Option<String>,
    /// The number of seconds after which the request may be sent again. The default is `None`.
    pub retry_after: Option<u32>,
}

impl Problem {
    /// Makes a problem of a kind with its reason in words.
    pub fn new(kind: ProblemKind, detail: impl ToString) -> Problem {
        Problem {
            kind,
            detail: detail.to_string(),
            expected: None,
            found: None,
            place: None,
            retry_after: None,
        }
    }

    /// Makes a problem whose reason is the difference between what was expected and what was found.
    pub fn mismatch(
        kind: ProblemKind,
        expected: impl Into<String>,
        found: impl Into<String>,
    ) -> Problem {
        let (expected, found) = (expected.into(), found.into());
        let detail = format!("expected {expected}, found {found}");
        Problem {
            expected: Some(expected),
            found: Some(found),
            ..Problem::new(kind, detail)
        }
    }

    /// Sets the part of the request that has the problem.
    pub fn at(self, place: impl Into<String>) -> Problem {
        let place = Some(place.into());
        Problem { place, ..self }
    }

    /// Sets the number of seconds after which the request may be sent again.
    pub fn retry_after(self, seconds: u32) -> Problem {
        let retry_after = Some(seconds);
        Problem {
            retry_after,
            ..self
        }
    }

    /// Returns the problem as JSON.
    pub fn json(&self) -> Value {
        let (status, name, title) = self.kind.parts();
        let mut json = Map::new();
        json.insert("type".into(), format!("urn:lamogen:problem:{name}").into());
        json.insert("title".into(), title.into());
        json.insert("status".into(), status.as_u16().into());
        json.insert("detail".into(), self.detail.as_str().into());
        let optional = [
            ("expected", &self.expected),
            ("found", &self.found),
            ("where", &self.place),
        ];
        for (key, value) in optional {
            if let Some(value) = value {
                json.insert(key.into(), value.as_str().into());
            }
        }
        json.into()
    }
}

impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        let (status, ..) = self.kind.parts();
        let body = self.json().to_string();
        let content_type = [(header::CONTENT_TYPE, "application/problem+json")];
        let mut response = (status, content_type, body).into_response();
        let headers = response.headers_mut();
        if let Some(seconds) = self.retry_after {
            headers.insert(header::RETRY_AFTER, HeaderValue::from(seconds));
        }
        if self.kind == ProblemKind::Unauthorized {
            let scheme = HeaderValue::from_static("Bearer");
            headers.insert(header::WWW_AUTHENTICATE, scheme);
        }
        response
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_problem_says_what_was_expected_what_was_found_and_where() {
        let problem = Problem::mismatch(ProblemKind::TooLarge, "at most 4 bytes", "5 bytes");
        let json = problem.at("body").json();
        assert_eq!(json["status"], 413);
        assert_eq!(json["type"], "urn:lamogen:problem:too-large");
        assert_eq!(json["detail"], "expected at most 4 bytes, found 5 bytes");
        assert_eq!(
            (&json["expected"], &json["found"], &json["where"]),
            (&"at most 4 bytes".into(), &"5 bytes".into(), &"body".into())
        );
    }

    #[test]
    fn busy_servers_say_when_to_ask_again() {
        let problem = Problem::new(ProblemKind::Busy, "full").retry_after(3);
        let response = problem.into_response();
        assert_eq!(response.status(), 429);
        assert_eq!(response.headers()["retry-after"], "3");
        assert_eq!(
            response.headers()["content-type"],
            "application/problem+json"
        );
    }
}
