//! Laban guidance of a text-to-motion diffusion model (LaMoGen, arXiv 2509.24469, section
//! "Two-Step Guided Generation").
//!
//! ```text
//! noise ──pass 1: baseline──▶ motion ──Laban features, scaled──▶ target
//!   └─────pass 2: guided────▶ motion      ▲ at every step Adam moves the sentence embedding e,
//!                                            so that the predicted motion's features reach it
//! ```
//!
//! The same pass moves something else where [`Guidance::moved`] says so: the scales and shifts that `e` becomes in every layer (the most exact,
//! [`Preset::Precise`]), the predicted motion, the finished motion, the start noise.
//!
//! What users get is the motion of a rigid body, unless [`Guidance::body`] says otherwise:
//!
//! ```text
//! motion of pass 1 ──Rig::fit──▶ rigid motion ──Laban features, scaled──▶ target
//! motion of pass 2 ──Rig::guide─────────────────────────────────────────▶ rigid motion that reaches it
//! ```
//!
//! [`Sampler`] runs both passes for any [`Denoiser`](lamogen_model::Denoiser). Both are
//! deterministic: the same noise gives the same motion.

mod classifier_free;
mod coherence;
mod error;
mod guidance;
mod guided;
mod noise;
mod observer;
mod prompt_editing;
mod rig;
mod sampler;
mod schedule;

pub use classifier_free::{ClassifierFree, ToldAndFree, feature_scales};
pub use coherence::Coherence;
pub use error::{GuideError, Quantity, Stopped};
pub use guidance::{Body, Finish, Guidance, Moved, Preset, PresetError, Update};
pub use guided::{Guided, Reached};
pub use lamogen_body::{Fit, FitError, FitProgress};
pub use noise::noise;
pub use observer::{Observer, Pass, Step};
pub use prompt_editing::edited_prompt;
pub use rig::{Rig, RigGuided};
pub use sampler::{Batch, Sampler};
pub use schedule::{DdimStep, Schedule, TRAINING_STEPS};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
