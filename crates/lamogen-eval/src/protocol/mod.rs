//! The evaluation that papers on HumanML3D report, with the public evaluator and its rules.
//!
//! ```text
//! folder ──PublicFiles──▶ PublicEvaluator ──┐
//! HumanML3D's folder ──▶ BenchmarkSplit ────┼──▶ Protocol ──scores of a row, a replication──▶ ProtocolScores
//! seed ──▶ Replication: order, captions, cuts┘        ▲
//!                             generated motions ──────┘
//! ```
//!
//! The rules are those of `final_evaluations.py` and `Text2MotionDatasetV2` of the public code (`EricGuo5513/text-to-motion`);
//! `docs/evaluation.md` lists them.

mod evaluator;
mod files;
mod replication;
mod scores;

pub use evaluator::{PublicEvaluator, StatisticsProblem};
pub use files::{PublicFile, PublicFiles};
pub use replication::{ClipSample, Replication};
pub use scores::{MeasuredForm, Protocol, ProtocolScores};
