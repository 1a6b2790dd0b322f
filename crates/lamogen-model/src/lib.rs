//! Text-to-motion denoisers as burn modules.
//!
//! ```text
//! text ──Tokenizer──▶ tokens ──TextEncoder──▶ embedding e, context    (once per prompt)
//! timesteps ─────────────────TimeEmbedding──▶ time                    (once per timestep)
//! x_t, time, e, context ─────MotionDiffuse──▶ noise or clean motion   (every step)
//! ```
//!
//! [`Denoiser`] is the interface through which guidance uses a network. [`MotionDiffuse`] is the network of Zhang et al.
//! 2022 (arXiv 2208.15001), and [`Mdm`] those of Tevet et al. 2023 (arXiv 2209.14916), both with the keys and layouts of
//! their public checkpoints. The sizes of a network come from a [`ModelConfig`] or an [`MdmConfig`], and its weights from a
//! [`Checkpoint`].

mod any_network;
mod checkpoint;
mod config;
mod denoiser;
mod diffusion;
mod mdm;
mod network;
mod tokens;
mod training;

pub use any_network::{AnyConfig, AnyContext, AnyNetwork};
pub use checkpoint::{
    Checkpoint, CheckpointError, ConversionProgress, NamedParameters, ParameterList, Precision,
};
pub use config::{
    ClipTextConfig, ConfigError, LABAN_FEATURES, LabanCondition, ModelConfig, Prediction,
    SamplingDefaults,
};
pub use denoiser::{
    Denoiser, DenoiserInput, FrameMask, LinearizedEvaluation, Prompt, limited_text_scales,
};
pub use diffusion::{MotionWindow, NoiseSchedule, SamplingMethod};
pub use lamogen_tokenizer::{Tokenizer, TokenizerError, Tokens, WordList, train_tokenizer, words};
pub use mdm::{
    DistilBertConfig, Mdm, MdmArchitecture, MdmConfig, MdmContext, MdmText, MdmTextConfig,
    TextEncoderKind,
};
pub use network::{CrossAttentionContext, MotionDiffuse, WeightSampler, initialize};
pub use tokens::TokenBatch;
pub use training::{SentenceSimilarity, TrainableDenoiser, TrainingBatch, TrainingGradients};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
