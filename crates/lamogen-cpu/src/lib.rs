//! Kernels for the decoder of MotionDiffuse and for transformers such as MDM on CPUs, with their gradients.
//!
//! The mathematics is the same as that of the tensor code of `lamogen-model`. The gradient is derived by hand, and the
//! code is written for vector units and caches.
//!
//! ```text
//! Decoder (weights) ──┐
//! DecoderInput ───────┴─▶ evaluate ────────────▶ output
//!                     ├─▶ record ──────────────▶ output, Tape ──backward(gradient of output)──▶ gradient of the condition
//!                     └─▶ record_for_training ─▶ output, Tape ──gradients(gradient of output)─▶ DecoderGradients
//! ```
//!
//! The costs are kept low in these ways:
//!
//! - The frames of a motion are split into chunks of whole rows. A chunk passes through a block on one thread, so that its
//!   numbers stay in the cache. Chunks meet once per block, where the attention sums over frames.
//! - Exponentials and error functions are polynomials that the compiler vectorises. On x86-64 the widest vector unit of
//!   the machine is found at run time.
//! - Frames past a motion's length are never computed.
//! - Guidance needs only the gradient with respect to the condition. Then no gradient is computed for the weights, nor for
//!   the self-attention of the first block, on which the condition has no influence. Training needs all gradients.
//!
//! A [`Transformer`] is evaluated in the same way: chunks of rows meet once a layer, where rows attend to each other.
//!
//! Sums are formed in an order that does not depend on the number of threads. So the results are equal bit for bit on any
//! number of threads.

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
mod transformer;

pub use decoder::{CrossAttention, DecoderBlock, FeedForward, SelfAttention};
pub use decoder::{Decoder, DecoderInput};
pub use gradients::DecoderGradients;
pub use linear::{Linear, Matrix, WeightLayout};
pub use norm::LayerNorm;
pub use stylization::Stylization;
pub use tape::Tape;
pub use transformer::{
    SoftmaxAttention, Transformer, TransformerGradients, TransformerInput, TransformerLayer,
    TransformerTape, TransformerWeightGradients,
};

/// Borrowed or shared memory of 32-bit floats that several threads may read.
pub trait FloatStorage: AsRef<[f32]> + Sync {}

impl<T: AsRef<[f32]> + Sync> FloatStorage for T {}

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
