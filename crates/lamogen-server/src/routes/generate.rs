//! `POST /api/v1/generate`: a motion, as JSON, as a file, or with its progress as server-sent events.

use std::convert::Infallible;
use std::sync::Arc;

use axum::body::{Body, Bytes};
use axum::extract::{Request, State};
use axum::http::{HeaderMap, header};
use axum::response::sse::{Event, Sse};
use axum::response::{IntoResponse, Response};
use futures_util::future::{Either, select};
use futures_util::stream;
use serde_json::json;
use std::pin::pin;

use crate::accept::choose_media_type;
use crate::job::{Job, ending, start_job};
use crate::problem::{Problem, ProblemKind};
use crate::routes::body::read_body;
use crate::server::Shared;
use crate::service::{MotionService, ProcessorShare, WorkObserver, WorkProgress};

/// The media type of progress.
const EVENTS: &str = "text/event-stream";
/// The media type of requests.
const JSON: &str = "application/json";

/// Answers with a motion.
pub(crate) async fn generate<S: MotionService>(
    State(shared): State<Shared<S>>,
    request: Request,
) -> Result<Response, Problem> {
    let (head, body) = request.into_parts();
    let media_type = answered_media_type(&head.headers, shared.service.media_types())?;
    check_content_type(&head.headers)?;
    let (largest, time) = (shared.config.max_request, shared.config.body_time);
    let bytes = read_body(&head.headers, body, largest, time).await?;
    let motion_request = parse(shared.service.clone(), bytes).await?;
    let service = shared.service.clone();
    let written = match media_type {
        EVENTS => service.media_types()[0],
        other => other,
    };
    let work = move |share: ProcessorShare, observer: WorkObserver<'_>| {
        service.generate(&motion_request, written, share, observer)
    };
    let job = start_job(&shared.queue, &shared.metrics, &shared.limits, work)?;
    match media_type {
        EVENTS => Ok(events(job)),
        _ => {
            let content = job.result().await?;
            let headers = [(header::CONTENT_TYPE, media_type), (header::VARY, "accept")];
            Ok((headers, Body::from(content)).into_response())
        }
    }
}

/// Parses a body, on another thread: one of a megabyte can take a moment, in which other connections are served.
async fn parse<S: MotionService>(service: Arc<S>, bytes: Bytes) -> Result<S::Request, Problem> {
    let parsing = tokio::task::spawn_blocking(move || {
        let text = std::str::from_utf8(&bytes).map_err(|error| {
            let (expected, found) = ("text in UTF-8", format!("{error}"));
            Problem::mismatch(ProblemKind::InvalidRequest, expected, found).at("body")
        })?;
        service.parse(text)
    });
    parsing.await.unwrap_or_else(|_| {
        let detail = "reading the request ended by an error in the program";
        Err(Problem::new(ProblemKind::Internal, detail))
    })
}

/// Returns the media type that the client prefers.
fn answered_media_type(
    headers: &HeaderMap,
    motions: &[&'static str],
) -> Result<&'static str, Problem> {
    let offered = [motions, &[EVENTS]].concat();
    choose_media_type(headers, &offered).ok_or_else(|| {
        let accept = headers
            .get(header::ACCEPT)
            .and_then(|accept| accept.to_str().ok());
        let expected = format!("one of {}", offered.join(", "));
        let found = accept.unwrap_or("a header that is no text");
        Problem::mismatch(ProblemKind::NotAcceptable, expected, found).at("Accept")
    })
}

/// Checks that the body is JSON. Pages of other sites can send bodies of some other types unasked.
fn check_content_type(headers: &HeaderMap) -> Result<(), Problem> {
    let stated = headers
        .get(header::CONTENT_TYPE)
        .and_then(|value| value.to_str().ok());
    let media_type = stated
        .and_then(|stated| stated.split(';').next())
        .map(str::trim);
    match media_type {
        Some(media_type) if media_type.eq_ignore_ascii_case(JSON) => Ok(()),
        _ => {
            let found = stated.unwrap_or("none");
            let problem = Problem::mismatch(ProblemKind::UnsupportedMediaType, JSON, found);
            Err(problem.at("Content-Type"))
        }
    }
}

/// Where the events of a work are.
enum EventState {
    Working(Job<Vec<u8>>),
    Finished,
}

/// Answers with the progress of a work and then its result.
fn events(job: Job<Vec<u8>>) -> Response {
    let events = stream::unfold(EventState::Working(job), |state| async move {
        let EventState::Working(mut job) = state else {
            return None;
        };
        let next = {
            let changed = pin!(job.progress.changed());
            match select(&mut job.outcome, changed).await {
                Either::Left((outcome, _)) => Either::Left(outcome),
                Either::Right((Ok(()), _)) => Either::Right(()),
                // The result follows when the work drops its side of the progress.
                Either::Right((Err(_), outcome)) => Either::Left(outcome.await),
            }
        };
        Some(match next {
            Either::Right(()) => {
                let WorkProgress { done, total, stage } = *job.progress.borrow_and_update();
                let data = json!({ "done": done, "total": total, "stage": stage });
                let event = Event::default().event("progress").data(data.to_string());
                (Ok::<Event, Infallible>(event), EventState::Working(job))
            }
            Either::Left(outcome) => {
                let outcome = outcome.unwrap_or_else(|_| Err(ending()));
                let event = match outcome {
                    Ok(content) => Event::default()
                        .event("result")
                        .data(String::from_utf8_lossy(&content)),
                    Err(problem) => {
                        let data = problem.json().to_string();
                        Event::default().event("problem").data(data)
                    }
                };
                (Ok(event), EventState::Finished)
            }
        })
    });
    Sse::new(events).into_response()
}
