//! Checks whether motions do what everyday sentences say, without a neural network.
//!
//! ```text
//! Motion ──Measurements::of──▶ Measurements ──Check::judge──▶ Verdict ──▶ Report
//!                                                ▲
//! sentences.txt ──sentences──▶ Sentence: text, length, checks
//! ```
//!
//! A [`Sentence`] is one that people may try in a text-to-motion program. It has one or several [`Check`]s, such as that
//! the body travels forward, turns to the left, or raises the left hand. A check compares [`Measurements`] of joint
//! positions with [`limits`]. Real motions show whether a check is right: [`evidence`] lists those that it has to hold
//! for and those that it must not hold for, and [`Evidence::validate`] counts.

mod checks;
mod evidence;
pub mod limits;
mod measurements;
mod phrasing;
mod report;
mod sentences;
mod side;
mod terms;
#[cfg(test)]
mod tests;
mod trajectory;
mod verdict;

pub use checks::{Check, CheckError};
pub use evidence::{Clip, Clips, Evidence, Validation, captioned, evidence};
pub use measurements::Measurements;
pub use phrasing::{Captions, Novelty};
pub use report::{Quality, Report, SuccessRate, TruthTrial};
pub use sentences::{Phrasing, Sentence, SentencesError, read_sentences, sentences};
pub use side::{Direction, Side};
pub use verdict::{Term, Verdict};
