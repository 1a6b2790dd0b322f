//! The server as clients see it, with a service whose works the tests hold and release.

mod answers;
mod attacks;
mod client;
mod limits;
mod service;
