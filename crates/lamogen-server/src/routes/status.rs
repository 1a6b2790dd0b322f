//! What the server says of itself.

use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse, Response};

use crate::routes::body::json;
use crate::server::Shared;
use crate::service::MotionService;

/// Answers with the description of the model.
pub(crate) async fn model<S: MotionService>(State(shared): State<Shared<S>>) -> Response {
    json(&shared.service.model())
}

/// Answers with the interface as an OpenAPI document.
pub(crate) async fn openapi() -> impl IntoResponse {
    let content = include_str!("../openapi.json").replace("{{version}}", env!("CARGO_PKG_VERSION"));
    ([(header::CONTENT_TYPE, "application/json")], content)
}

/// Answers whether the server takes works.
pub(crate) async fn health<S: MotionService>(State(shared): State<Shared<S>>) -> Response {
    let [waiting, running] = shared.queue.lengths();
    json(&serde_json::json!({ "status": "ok", "waiting": waiting, "running": running }))
}

/// Answers with the counters.
pub(crate) async fn metrics<S: MotionService>(
    State(shared): State<Shared<S>>,
) -> impl IntoResponse {
    let content = shared.metrics.text(shared.queue.lengths());
    let media_type = "text/plain; version=0.0.4; charset=utf-8";
    ([(header::CONTENT_TYPE, media_type)], content)
}
