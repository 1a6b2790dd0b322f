//! Who may ask: the checks of `Host`, `Origin` and token that come before all else.
//!
//! A page of another site can make a browser send requests to a server on the same machine. Such a request has the page's
//! `Origin`, or, after DNS rebinding, the `Host` of that site.

use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use subtle::ConstantTimeEq;

use crate::problem::{Problem, ProblemKind};
use crate::server::Shared;
use crate::service::MotionService;

/// Answers requests that are not allowed, and passes on the others.
pub(crate) async fn guard<S: MotionService>(
    State(shared): State<Shared<S>>,
    request: Request,
    next: Next,
) -> Response {
    let config = &shared.config;
    let is_local = config.address.ip().is_loopback();
    let checked = check_host(request.headers(), is_local)
        .and_then(|()| check_origin(request.headers(), &config.allowed_origins));
    match checked {
        Ok(()) => next.run(request).await,
        Err(problem) => problem.into_response(),
    }
}

/// Answers requests without the token, and passes on the others. Before a request with a token, browsers ask for leave without it.
pub(crate) async fn require_token<S: MotionService>(
    State(shared): State<Shared<S>>,
    request: Request,
    next: Next,
) -> Response {
    let is_allowed = match &shared.config.token {
        Some(token) if request.method() != Method::OPTIONS => has_token(request.headers(), token),
        _ => true,
    };
    match is_allowed {
        true => next.run(request).await,
        false => {
            let expected = "the header Authorization: Bearer and the token of this server";
            let found = match request.headers().contains_key(header::AUTHORIZATION) {
                true => "another token",
                false => "no such header",
            };
            Problem::mismatch(ProblemKind::Unauthorized, expected, found)
                .at("Authorization")
                .into_response()
        }
    }
}

/// Adds the headers that keep browsers from doing more than they should.
pub(crate) async fn add_security_headers(request: Request, next: Next) -> Response {
    let mut response = next.run(request).await;
    let headers = response.headers_mut();
    let mut set = |name: HeaderName, value: &'static str| {
        headers
            .entry(name)
            .or_insert(HeaderValue::from_static(value));
    };
    set(header::CONTENT_SECURITY_POLICY, PAGE_POLICY);
    set(header::X_CONTENT_TYPE_OPTIONS, "nosniff");
    set(header::REFERRER_POLICY, "no-referrer");
    set(header::X_FRAME_OPTIONS, "DENY");
    set(
        HeaderName::from_static("cross-origin-opener-policy"),
        "same-origin",
    );
    set(header::CACHE_CONTROL, "no-store");
    response
}

/// Pages run scripts and styles of this server alone, nothing inline, and are in no frame.
const PAGE_POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self' data: blob:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// Checks that a request to a loopback address names one. Other addresses have a token, which pages of other sites do not know.
fn check_host(headers: &HeaderMap, is_local: bool) -> Result<(), Problem> {
    let host = headers
        .get(header::HOST)
        .and_then(|host| host.to_str().ok());
    let host = host.ok_or_else(|| {
        let (expected, found) = ("the header Host", "none");
        Problem::mismatch(ProblemKind::InvalidRequest, expected, found).at("Host")
    })?;
    match !is_local || is_loopback_name(host) {
        true => Ok(()),
        false => {
            let expected = "localhost, 127.0.0.1 or [::1]";
            Err(Problem::mismatch(ProblemKind::Forbidden, expected, host).at("Host"))
        }
    }
}

/// Returns whether a host, with or without its port, is this machine.
fn is_loopback_name(host: &str) -> bool {
    let name = match host.rsplit_once(':') {
        Some((name, port)) if port.bytes().all(|byte| byte.is_ascii_digit()) => name,
        _ => host,
    };
    let address = name
        .strip_prefix('[')
        .and_then(|name| name.strip_suffix(']'));
    let address = address.unwrap_or(name).parse::<std::net::IpAddr>();
    name.eq_ignore_ascii_case("localhost") || address.is_ok_and(|address| address.is_loopback())
}

/// Checks that a request of a page is of a page of this server, or of an allowed origin.
fn check_origin(headers: &HeaderMap, allowed: &[String]) -> Result<(), Problem> {
    let Some(origin) = headers.get(header::ORIGIN) else {
        return Ok(());
    };
    let origin = origin.to_str().unwrap_or("an origin that is no text");
    let host = headers
        .get(header::HOST)
        .and_then(|host| host.to_str().ok());
    // A proxy in front of this server may speak HTTPS.
    let authority = origin
        .strip_prefix("https://")
        .or(origin.strip_prefix("http://"));
    let is_own = authority.is_some() && authority == host;
    match is_own || allowed.iter().any(|allowed| allowed == origin) {
        true => Ok(()),
        false => {
            let expected = "a page of this server or of an allowed origin";
            Err(Problem::mismatch(ProblemKind::Forbidden, expected, origin).at("Origin"))
        }
    }
}

/// Returns whether a request has the token. The time that this takes does not depend on where the tokens differ.
fn has_token(headers: &HeaderMap, token: &str) -> bool {
    let value = headers.get(header::AUTHORIZATION);
    let given = value.and_then(|value| value.as_bytes().split_at_checked("Bearer ".len()));
    given.is_some_and(|(scheme, given)| {
        scheme.eq_ignore_ascii_case(b"Bearer ") && bool::from(given.ct_eq(token.as_bytes()))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn headers(pairs: &[(HeaderName, &str)]) -> HeaderMap {
        pairs
            .iter()
            .map(|(name, value)| (name.clone(), value.parse().unwrap()))
            .collect()
    }

    #[test]
    fn hosts_of_other_sites_are_refused_on_the_loopback_address() {
        for host in [
            "localhost",
            "LOCALHOST:8765",
            "127.0.0.1:1",
            "[::1]:8765",
            "[::1]",
            "127.0.0.2",
        ] {
            assert!(
                check_host(&headers(&[(header::HOST, host)]), true).is_ok(),
                "{host}"
            );
        }
        for host in [
            "evil.example",
            "localhost.evil.example:8765",
            "127.0.0.1.evil.example",
            "10.0.0.1",
            "",
            ":8765",
        ] {
            let problem = check_host(&headers(&[(header::HOST, host)]), true).unwrap_err();
            assert_eq!(problem.kind, ProblemKind::Forbidden, "{host}");
            assert!(
                check_host(&headers(&[(header::HOST, host)]), false).is_ok(),
                "{host}"
            );
        }
        assert!(check_host(&HeaderMap::new(), false).is_err());
    }

    #[test]
    fn pages_of_other_sites_are_refused_unless_they_are_listed() {
        let check = |origin: &str| {
            let headers = headers(&[(header::HOST, "localhost:8765"), (header::ORIGIN, origin)]);
            check_origin(&headers, &["https://example.org".into()])
        };
        for origin in [
            "http://localhost:8765",
            "https://localhost:8765",
            "https://example.org",
        ] {
            assert!(check(origin).is_ok(), "{origin}");
        }
        for origin in [
            "http://localhost:3000",
            "null",
            "https://example.org.evil",
            "file://",
            "localhost:8765",
        ] {
            let problem = check(origin).unwrap_err();
            assert_eq!(problem.found.as_deref(), Some(origin));
        }
        assert!(check_origin(&headers(&[(header::HOST, "localhost")]), &[]).is_ok());
    }

    #[test]
    fn only_the_whole_token_is_the_token() {
        let has = |value: &str| {
            has_token(
                &headers(&[(header::AUTHORIZATION, value)]),
                "0123456789abcdef",
            )
        };
        assert!(has("Bearer 0123456789abcdef") && has("bearer 0123456789abcdef"));
        for wrong in [
            "",
            "Bearer",
            "Bearer ",
            "Bearer 0123456789abcde",
            "Bearer 0123456789abcdefg",
            "Basic 0123456789abcdef",
            "0123456789abcdef",
        ] {
            assert!(!has(wrong), "{wrong}");
        }
    }
}
