//! Training on motion capture with captions: text-to-motion denoisers, and the networks that judge them.
//!
//! ```text
//! Dataset, CaptionTokens, TrainingConfig ───────────▶ Denoising ─┐
//! Dataset, CaptionTokens, EvaluatorTrainingConfig ──▶ Matching ──┤
//!                                                  Task::learn ◀─┴─▶ Trainer: gradients, AdamW, average ──run──▶ folder of the run
//! ```
//!
//! [`run`] trains in a folder and goes on where it was stopped; [`Trainer`] makes single steps.

mod adam;
mod average;
mod batches;
mod checkpoint;
mod config;
mod denoising;
mod error;
mod example;
mod gradients;
mod identity;
mod laban;
mod log;
mod losses;
mod matching;
mod model_folder;
mod optimization;
mod paraphrases;
mod run;
mod sampling;
mod sentences;
mod task;
mod tokens;
mod trainer;
mod validation;
mod variations;

pub use config::{DenoisingConfig, TrainingConfig, TrainingConfigError};
pub use denoising::Denoising;
pub use error::TrainError;
pub use identity::{fingerprint, identity};
pub use log::LogLine;
pub use losses::Losses;
pub use matching::{
    EvaluatorTrainingConfig, Matching, MatchingConfig, MatchingError, Others, captioned,
};
pub use optimization::Optimization;
pub use paraphrases::Paraphrases;
pub use run::{Ended, Length, Plan, RunObserver, RunProgress, run};
pub use sentences::{Sentences, SentencesError};
pub use task::{Lesson, Task};
pub use tokens::{CaptionTokens, other_phrasings};
pub use trainer::{StepReport, Trainer};
pub use validation::Validation;
pub use variations::{VariationError, VariationOptions, vary};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
