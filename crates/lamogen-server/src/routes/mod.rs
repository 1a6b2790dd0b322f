//! The routes of the server, and what stands before all of them.

mod body;
mod generate;
mod status;
mod upload;

use axum::Router;
use axum::extract::{Request, State};
use axum::http::{HeaderName, HeaderValue, Method, header};
use axum::middleware::{Next, from_fn, from_fn_with_state};
use axum::response::Response;
use axum::routing::{MethodRouter, get, post};
use tower_http::cors::{AllowOrigin, CorsLayer};

use crate::config::PageFile;
use crate::guard::{add_security_headers, guard, require_token};
use crate::problem::{Problem, ProblemKind};
use crate::server::Shared;
use crate::service::MotionService;

/// Makes the router of a server.
pub(crate) fn router<S: MotionService>(shared: Shared<S>) -> Router {
    let other_method = || async {
        let detail =
            "the path is there, but not with this method; the header Allow names its methods";
        Problem::new(ProblemKind::MethodNotAllowed, detail).at("method")
    };
    let interface: Router<Shared<S>> = Router::new()
        .route("/api/v1/generate", post(generate::generate::<S>))
        .route("/api/v1/laban", post(upload::laban::<S>))
        .route("/api/v1/character", post(upload::character::<S>))
        .route("/api/v1/model", get(status::model::<S>))
        .route("/api/v1/openapi.json", get(status::openapi))
        .route("/metrics", get(status::metrics::<S>))
        .route_layer(from_fn_with_state(shared.clone(), require_token::<S>));
    let mut open = Router::new().route("/health", get(status::health::<S>));
    for file in &shared.config.pages {
        open = open.route(file.path, page(file));
    }
    interface
        .merge(open)
        .method_not_allowed_fallback(other_method)
        .fallback(|request: Request| async move {
            let found = request.uri().path().to_owned();
            let expected = "a path of /api/v1/openapi.json";
            Problem::mismatch(ProblemKind::NotFound, expected, found).at("path")
        })
        .layer(cors(&shared.config.allowed_origins))
        .layer(from_fn_with_state(shared.clone(), guard::<S>))
        .layer(from_fn(add_security_headers))
        .layer(from_fn_with_state(shared.clone(), count::<S>))
        .with_state(shared)
}

/// Makes the route of a page or of a part of one.
fn page<S: Clone + Send + Sync + 'static>(file: &PageFile) -> MethodRouter<S> {
    let (media_type, content) = (
        file.media_type,
        axum::body::Bytes::from(file.content.clone()),
    );
    get(move || async move { ([(header::CONTENT_TYPE, media_type)], content) })
}

/// Lets pages of the listed origins use the interface. Without any, browsers keep answers from all other pages.
fn cors(allowed: &[String]) -> CorsLayer {
    let origins = allowed
        .iter()
        .filter_map(|origin| HeaderValue::from_str(origin).ok());
    CorsLayer::new()
        .allow_origin(AllowOrigin::list(origins))
        .allow_methods([Method::GET, Method::POST])
        .allow_headers([header::ACCEPT, header::AUTHORIZATION, header::CONTENT_TYPE])
        .expose_headers([HeaderName::from_static("retry-after")])
}

/// Counts the answers of each route.
async fn count<S: MotionService>(
    State(shared): State<Shared<S>>,
    request: Request,
    next: Next,
) -> Response {
    let path = request.uri().path();
    let known = KNOWN_PATHS.iter().find(|known| **known == path);
    let path = known.copied().unwrap_or("other");
    let response = next.run(request).await;
    shared
        .metrics
        .count_answer(path, response.status().as_u16());
    response
}

/// The paths that are counted each on its own.
const KNOWN_PATHS: [&str; 7] = [
    "/api/v1/character",
    "/api/v1/generate",
    "/api/v1/laban",
    "/api/v1/model",
    "/api/v1/openapi.json",
    "/health",
    "/metrics",
];
