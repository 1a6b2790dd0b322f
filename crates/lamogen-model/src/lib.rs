//! Text-to-motion denoisers as burn modules.
//!
//! ```text
//! text ──Tokenizer──▶ tokens ──TextEncoder──▶ embedding e, context    (once per prompt)
//! timesteps ─────────────────TimeEmbedding──▶ time                    (once per timestep)
//! x_t, time, e, context ─────MotionDiffuse──▶ noise or clean motion   (every step)
//! ```
//!
//! [`Denoiser`] is the interface through which guidance uses a network. [`MotionDiffuse`] is the network of Zhang et al.
//! 2022 (arXiv 2208.15001), with the keys and layouts of its public checkpoint. The sizes of a network come from a
//! [`ModelConfig`], and its weights from a [`Checkpoint`].

mod checkpoint;
mod config;
mod denoiser;
mod network;

pub use checkpoint::{
    Checkpoint, CheckpointError, ConversionProgress, NamedParameters, ParameterList, Precision,
};
pub use config::{
    ClipTextConfig, ConfigError, LABAN_FEATURES, LabanCondition, ModelConfig, Prediction,
    SamplingDefaults,
};
pub use denoiser::{Denoiser, DenoiserInput, FrameMask, LinearizedEvaluation, Prompt};
pub use lamogen_tokenizer::{Tokenizer, TokenizerError, Tokens, WordList, train_tokenizer, words};
pub use network::{
    CrossAttentionContext, MotionDiffuse, SentenceSimilarity, TrainingBatch, TrainingGradients,
    WeightSampler, initialize,
};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
