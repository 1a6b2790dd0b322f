//! The decoder of MotionDiffuse on CPUs: the same mathematics as the tensor code of `lamogen-model`,
//! with a hand-derived gradient, written for vector units and caches.
//!
//! ```text
//! Decoder (weights) ──┐
//! DecoderInput ──────────────┴─▶ evaluate ─▶ output
//!                     ├─▶ record ───▶ output, Tape ──backward(gradient of output)──▶ gradient of the condition
//!                     └─▶ record_for_training ▶ output, Tape ──gradients(gradient of output)──▶ DecoderGradients of everything
//! ```
//!
//! What a frame costs is spent once and in one place:
//!
//! - A motion's frames are cut into chunks of whole rows. A chunk passes through a block on one
//!   thread, from cache to cache; chunks meet once a block, where attention sums over frames.
//! - Exponentials and error functions are polynomials that the compiler vectorises; on x86-64 the widest
//!   vector unit of the machine is found at run time.
//! - Frames past a motion's length are never computed.
//! - Guidance asks for the gradient with respect to the condition alone; none is computed then for weights, nor
//!   for the first block's attention, on which the condition has no influence. Training asks for all.
//!
//! Sums run in an order that does not depend on the number of threads, so results are equal bit for
//! bit on any number of them.

mod attention;
mod backward;
mod chunk;
mod decoder;
mod forward;
mod gradients;
mod linear;
mod math;
mod modulation;
mod norm;
mod stylization;
mod tape;

pub use decoder::{CrossAttention, DecoderBlock, FeedForward, SelfAttention};
pub use decoder::{Decoder, DecoderInput};
pub use gradients::DecoderGradients;
pub use linear::{Linear, Matrix, WeightLayout};
pub use norm::LayerNorm;
pub use stylization::Stylization;
pub use tape::Tape;

/// Where numbers lie: borrowed or shared memory that threads may read.
pub trait FloatStorage: AsRef<[f32]> + Sync {}

impl<T: AsRef<[f32]> + Sync> FloatStorage for T {}

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
