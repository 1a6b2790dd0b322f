//! Training of text-to-motion denoisers, and of the networks that evaluate them, on motion capture with captions.
//!
//! ```text
//! Dataset, CaptionTokens, TrainingConfig ───────────▶ DenoisingTask ─┐
//! Dataset, CaptionTokens, EvaluatorTrainingConfig ──▶ MatchingTask ──┴─▶ TrainingTask
//!
//! TrainingTask ──compute_gradients──▶ Trainer: gradients, AdamW, average ──run──▶ folder of the run
//! ```
//!
//! [`run`] trains in a folder and resumes a run that was stopped; [`Trainer`] makes single steps.

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
mod mdm;
mod model_folder;
mod network_config;
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

pub use config::{AnyTrainingConfig, DenoisingConfig, TrainingConfig, TrainingConfigError};
pub use denoising::DenoisingTask;
pub use error::TrainError;
pub use identity::{fingerprint, identity};
pub use log::LogLine;
pub use losses::LossWeights;
pub use matching::{
    EvaluatorTrainingConfig, MatchingConfig, MatchingError, MatchingTask, Negatives, captioned,
};
pub use mdm::MdmModelConfig;
pub use network_config::NetworkConfig;
pub use optimization::OptimizerConfig;
pub use paraphrases::Paraphrases;
pub use run::{RunLength, RunObserver, RunOutcome, RunPlan, RunProgress, run};
pub use sentences::{SentenceEmbeddings, SentencesError};
pub use task::{StepGradients, TrainingTask};
pub use tokens::{CaptionTokens, other_phrasings};
pub use trainer::{StepReport, Trainer};
pub use validation::ValidationSet;
pub use variations::{MotionVariationOptions, VariationError, vary};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
