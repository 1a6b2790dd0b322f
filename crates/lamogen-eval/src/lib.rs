//! Metrics of text-to-motion: how well motions fit their texts, and how real they look.
//!
//! ```text
//! text ──WordVectors or Tokenizer──▶ TextBatch ──embed_text──┐
//!                                                            ├─▶ Embeddings ──▶ MatchingScore, fid, diversity, multimodality
//! pose features, lengths ────────────────────embed_motion────┘
//! ```
//!
//! [`EvaluatorNetwork`] is the text-motion matching network of Guo et al. 2022 ("Generating Diverse and Natural
//! 3D Human Motions from Text", CVPR 2022). It maps texts and motions into one space, where a text lies near the
//! motions that it describes. It loads the public weights without conversion, and smaller networks of the same kind
//! can be trained with [`contrastive_loss`]. An [`Evaluator`] is such a network that reads tokens, with its tokenizer
//! and the statistics of its features; a [`PublicEvaluator`](protocol::PublicEvaluator) is the published one with its
//! words, and [`protocol`] the evaluation that papers on HumanML3D report. The metrics are distances in that space; `docs/evaluation.md` explains each.

mod captioned;
mod config;
mod embedding_batches;
mod error;
mod evaluator;
mod evaluator_network;
mod initial;
mod loss;
mod metrics;
mod network;
pub mod protocol;
mod real;
mod text;
pub mod truth;
mod vocabulary;

pub use captioned::CaptionedMotions;
pub use config::{EvaluatorConfig, TextForm};
pub use error::{EvaluatorError, EvaluatorNetworkError};
pub use evaluator::Evaluator;
pub use evaluator_network::EvaluatorNetwork;
pub use loss::{contrastive_loss, contrastive_loss_all_shifts, random_shift};
pub use metrics::{
    ChangeMatrix, ControlRange, Embeddings, Gaussian, MatchingScore, MetricError, RetrievalBatches,
    diversity, draw_pairs, fid, mean_distance, mean_pair_distance, multimodality,
};
pub use network::Dropout;
pub use real::{Estimate, RealMotions, evaluate_real_motions};
pub use text::TextBatch;
pub use vocabulary::{PartOfSpeech, Sentence, Vocabulary, VocabularyError};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
