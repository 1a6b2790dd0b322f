//! `POST /api/v1/laban` and `/api/v1/character`: the report on a motion file; a character that is kept.

use axum::extract::{Request, State};
use axum::http::HeaderMap;
use axum::response::Response;
use serde_json::Value;
use tokio::sync::OwnedSemaphorePermit;

use crate::job::start_job;
use crate::problem::{Problem, ProblemKind};
use crate::routes::body::{json, read_body, stated_size, too_large};
use crate::server::{Shared, UPLOAD_UNIT};
use crate::service::{MotionService, ProcessorShare, UploadedFile, WorkError, WorkObserver};

/// Answers with the report on the file in the body.
pub(crate) async fn laban<S: MotionService>(
    State(shared): State<Shared<S>>,
    request: Request,
) -> Result<Response, Problem> {
    answer_upload(shared, request, S::measure).await
}

/// Answers with what a page needs to draw the character in the body.
pub(crate) async fn character<S: MotionService>(
    State(shared): State<Shared<S>>,
    request: Request,
) -> Result<Response, Problem> {
    answer_upload(shared, request, S::add_character).await
}

/// Answers with what a function of the service returns for the file in the body.
async fn answer_upload<S: MotionService>(
    shared: Shared<S>,
    request: Request,
    read: fn(&S, &UploadedFile) -> Result<Value, Problem>,
) -> Result<Response, Problem> {
    let (head, body) = request.into_parts();
    let query = head.uri.query().unwrap_or_default();
    let options = form_urlencoded::parse(query.as_bytes()).into_owned();
    let _room = reserve(&shared, &head.headers)?;
    let (largest, time) = (shared.config.max_upload, shared.config.body_time);
    let bytes = read_body(&head.headers, body, largest, time).await?;
    let file = UploadedFile {
        options: options.collect(),
        bytes: bytes.into(),
    };
    let service = shared.service.clone();
    let work = move |_: ProcessorShare, _: WorkObserver<'_>| {
        read(&service, &file).map_err(WorkError::Failed)
    };
    let job = start_job(&shared.queue, &shared.metrics, &shared.limits, work)?;
    Ok(json(&job.result().await?))
}

/// Reserves memory for a body, before it is read.
fn reserve<S>(shared: &Shared<S>, headers: &HeaderMap) -> Result<OwnedSemaphorePermit, Problem> {
    let largest = shared.config.max_upload;
    let size = stated_size(headers).unwrap_or(largest);
    if size > largest {
        return Err(too_large(largest, format!("{size} bytes")));
    }
    let units = size.div_ceil(UPLOAD_UNIT) as u32;
    shared
        .uploads
        .clone()
        .try_acquire_many_owned(units)
        .map_err(|_| {
            let detail = "other files are being uploaded and read";
            shared.metrics.count_rejection();
            Problem::new(ProblemKind::Busy, detail).retry_after(1)
        })
}
