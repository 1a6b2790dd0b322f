//! Development tasks of lamogen, as a library so that tests can run them too.

pub mod bench;
pub mod bodies;
pub mod captured_places;
pub mod embed;
pub mod handles;
pub mod judges;
pub mod load;
pub mod measure;
pub mod parity;
pub mod perception;
pub mod phrasings;
pub mod places;
mod running_server;
pub mod seams;
pub mod strips;
pub mod subject;
pub mod sweep;
pub mod test;
pub mod training;
pub mod truth;

/// Compiles the programs in the README.
#[cfg(doctest)]
#[doc = include_str!("../../README.md")]
struct Readme;
