//! The HTTP side of lamogen's server: who may ask, how much, and in which order.
//!
//! ```text
//! connection ──▶ guard.rs: Host, Origin, token ──▶ routes/: body, media type ──▶ queue.rs ──▶ MotionService
//!                                                        │                           (threads of their own)
//!                                                        ◀── job.rs: progress, result, end of a client ──┘
//! ```
//!
//! What motions are is the concern of the [`MotionService`]; this crate knows requests, media types and bytes. Works run
//! on threads apart from the one that serves connections, one with all processors or, while others wait, several side by side.
//! A work whose client goes away is stopped.
//!
//! | method and path | answer |
//! |---|---|
//! | `POST /api/v1/generate` | a motion in the media type that `Accept` names, or its progress as server-sent events and then the motion |
//! | `POST /api/v1/laban` | the report on a motion file |
//! | `GET /api/v1/model` | the model |
//! | `GET /api/v1/openapi.json` | this interface as an OpenAPI document |
//! | `GET /health` | whether works are taken |
//! | `GET /metrics` | counters in Prometheus' text format |
//!
//! Errors are JSON in the form of RFC 9457 ([`Problem`]).

mod accept;
mod config;
mod connections;
mod guard;
mod job;
mod metrics;
mod problem;
mod queue;
mod routes;
mod server;
mod service;

pub use config::{PageFile, ServerConfig, ServerError};
pub use problem::{Problem, ProblemKind};
pub use server::{Server, ServerHandle};
pub use service::{
    MotionService, ProcessorShare, UploadedFile, WorkError, WorkObserver, WorkProgress,
};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
