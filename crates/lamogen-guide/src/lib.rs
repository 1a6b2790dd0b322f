//! Laban guidance of a text-to-motion diffusion model (LaMoGen, arXiv 2509.24469, section
//! "Two-Step Guided Generation").
//!
//! ```text
//! noise ──pass 1: baseline──▶ motion ──Laban features, scaled──▶ target
//!   └─────pass 2: guided────▶ motion      ▲ at every step Adam moves the sentence embedding e,
//!                                            so that the predicted motion's features reach it
//! ```
//!
//! [`Guidance::variable`] selects what the second pass moves: the embedding `e`, the scales and shifts that every layer
//! computes from `e` (the most exact choice, [`Preset::Precise`]), the predicted motion, the finished motion, or the
//! start noise.
//!
//! The result for users is the motion of a rigid body, unless [`Guidance::body`] is [`Body::Network`]:
//!
//! ```text
//! motion of pass 1 ──Rig::fit──▶ rigid motion ──Laban features, scaled──▶ target
//! motion of pass 2 ──Rig::guide─────────────────────────────────────────▶ rigid motion that reaches it
//! ```
//!
//! [`Sampler`] runs both passes for any [`Denoiser`](lamogen_model::Denoiser). Both are
//! deterministic: the same noise, at the start and at each step, gives the same motion.

mod arranged;
mod classifier_free;
mod error;
mod guidance;
mod guided;
mod host;
mod known;
mod laban_term;
mod looped;
mod loss_term;
mod noise;
mod observer;
mod places;
mod prompt_editing;
mod rig;
mod sampler;
mod schedule;
mod temporal_smoothing;
mod text_scale;
mod tiled;
mod windows;

pub use arranged::Arranged;
pub use classifier_free::{ClassifierFree, ClassifierFreeContext, feature_scales};
pub use error::{GuideError, Quantity, StoppedPass};
pub use guidance::{Body, Finish, Guidance, GuidanceVariable, Preset, PresetError, UpdateTiming};
pub use guided::{GuidedMotions, LabanComparison};
pub use known::KnownFrames;
pub use laban_term::LabanTerm;
pub use lamogen_body::{FitError, FitOptions, FitProgress};
pub use looped::{Looped, longest_loop};
pub use loss_term::{LossTarget, LossTerm, LossTerms, PreparedTerm, TermComparison};
pub use noise::{StepNoise, noise};
pub use observer::{Observer, Pass, Step};
pub use places::{
    Facing, GroundPath, Itinerary, KeyPose, PlaceError, PlaceOrigin, PlaceOutcome, Places, Reach,
    ReachPart, Waypoint,
};
pub use prompt_editing::prompt_with_tags;
pub use rig::{Rig, RigMotions};
pub use sampler::{Batch, Sampler};
pub use schedule::{DdimStep, Schedule, TRAINING_STEPS};
pub use temporal_smoothing::TemporalSmoothing;
pub use text_scale::TextScale;
pub use tiled::{Tile, Tiled, Tiling};
pub use windows::Continuation;

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
