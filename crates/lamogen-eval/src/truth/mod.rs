//! Whether motions do what everyday sentences say, without a network that judges.
//!
//! ```text
//! Motion ──Measurements::of──▶ Measurements ──Check::judge──▶ Verdict ──▶ Report
//!                                                ▲
//! sentences.txt ──sentences──▶ Sentence: text, length, checks
//! ```
//!
//! A [`Sentence`] is written as people try a text-to-motion program, and has one or several [`Check`]s: that the body gets forward,
//! turns to the left, raises that hand. A check compares [`Measurements`] of joint positions with [`limits`]. Whether a check
//! means what its name says is told by real motions: [`evidence`] names those that it has to hold for and those that it must not
//! hold for, and [`Evidence::validate`] counts.

mod checks;
mod evidence;
pub mod limits;
mod measurements;
mod phrasing;
mod report;
mod sentences;
#[cfg(test)]
mod tests;
mod trajectory;

pub use checks::{Check, CheckError, Direction, Side, Term, Verdict};
pub use evidence::{Clip, Clips, Evidence, Validation, captioned, evidence};
pub use measurements::Measurements;
pub use phrasing::{Captions, Novelty};
pub use report::{Quality, Report, SuccessRate, TruthTrial};
pub use sentences::{Phrasing, Sentence, SentencesError, read_sentences, sentences};
