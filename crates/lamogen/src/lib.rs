//! Generates human motion from a sentence and a few words of Laban movement analysis.
//!
//! ```no_run
//! use lamogen::{Component, Device, LaMoGen, Request, TimeSummary, Tag};
//!
//! fn main() -> Result<(), Box<dyn std::error::Error>> {
//!     let model = LaMoGen::embedded(&Device::flex())?;
//!     let request = Request::new("a person jumps").tags([Tag::Strong, Tag::Sudden]).seed(7);
//!     let result = model.generate(&request)?;
//!
//!     let before = result.baseline_laban.summary(TimeSummary::Maximum);
//!     let after = result.guided_laban.summary(TimeSummary::Maximum);
//!     println!("Weight {} -> {}", before[Component::Weight.index()], after[Component::Weight.index()]);
//!     result.guided.save_joints("jump.npy")?;
//!     Ok(())
//! }
//! ```
//!
//! lamogen implements LaMoGen (arXiv 2509.24469): a pretrained text-to-motion diffusion model is
//! steered while it samples. A first pass gives the motion that the text alone describes. The Laban
//! features of this motion, scaled by the tags, are the target. A second pass starts from the same noise. At every
//! step it changes the sentence embedding, or the scales and shifts that the network computes from the embedding, so
//! that the features come closer to the target. Nothing is retrained and no reference clip is needed.
//!
//! # The embedded model
//!
//! [`LaMoGen::embedded`] runs with [`Preset::Precise`]: it changes the scales and shifts of every layer over 12 DDIM
//! steps, fits the result to a rigid body and refines the motion of that body. Its predictions are smoothed along time
//! by one frame ([`TemporalSmoothing`]). It follows sentences by classifier-free guidance ([`ClassifierFree`]), which
//! evaluates the network twice a step. It makes motions of 40 to 196 frames at 20 frames a second of one body with
//! 22 joints. Its weights are CC BY 4.0 and may be used in products that name the sources ([`LaMoGen::licence`]); the
//! code is MIT or Apache 2.0. [`LaMoGen::load`] takes other models, among them the public MotionDiffuse.
//!
//! # Crates
//!
//! The parts are crates of their own, re-exported here: [`motion`] (the body, its features, `.npy`), [`laban`] (Weight,
//! Time, Flow, Shape, tags and goals), [`model`] (the network, its text encoder, checkpoints), [`guide`] (sampling and
//! guidance), [`body`] (rigid bones), [`files`] (BVH, GLB, CSV, other skeletons) and [`character`] (motions on your own
//! characters).
//!
//! # Features
//!
//! - `compact`: the embedded model.
//! - `flex`, `ndarray`, `wgpu`, `vulkan`, `metal`, `cuda`, `rocm`: the backends that compute ([`DeviceName`]). A program
//!   may have any number of them. `flex` computes on the CPU in pure Rust.
//! - `json`: requests as JSON ([`JsonRequest`]), in the form of the lines of `lamogen batch`.

mod baseline_cache;
mod device;
mod error;
mod generation;
mod groups;
#[cfg(feature = "json")]
mod json_request;
mod kept;
mod licence;
mod load;
mod long_run;
mod named_motions;
mod neighbours;
mod request;
#[cfg(feature = "json")]
mod requested_goals;
mod run;
mod standing;
mod stream;
mod stretches;

pub use device::{DeviceError, DeviceName};
pub use error::{
    Error, FailedRun, FinishedStretches, LoadError, PartialResults, PassError, RequestError,
    RequestIndex, StoppedRun, UnfinishedRequest,
};
pub use generation::{
    GeneratedSentence, Generation, LaMoGen, NetworkMotions, PartLaban, Progress, TermValues,
};
#[cfg(feature = "json")]
pub use json_request::{JsonRequest, JsonRequestError};
pub use licence::Licence;
pub use named_motions::{NamedMotionError, NamedMotions, PoseFile, PoseFileError};
pub use request::{Length, Request};
#[cfg(feature = "json")]
pub use requested_goals::RequestedGoals;
pub use stream::{MotionStream, Stretch};

pub use burn::tensor::{Device, Tensor};
pub use lamogen_guide::{
    Body, ClassifierFree, Facing, Finish, FitOptions, GroundPath, Guidance, GuidanceVariable,
    KeyPose, LossTarget, LossTerm, LossTerms, Pass, PlaceError, PlaceOutcome, Places, Preset,
    Reach, ReachPart, Step, TemporalSmoothing, TextScale, UpdateTiming, Waypoint,
};
pub use lamogen_laban::{
    BodyPart, COMPONENTS, Component, EndEffectors, Factor, FactorError, FactorKeyframe,
    GaussianKernel, Goal, Goals, Interpolation, LabanOptions, LabanSeries, LossDivisor, PartScale,
    Scale, ScaleCurve, Smoothing, Tag, TimeSummary,
};
pub use lamogen_motion::{BodyError, FRAMES_PER_SECOND, JOINTS, Joint, Motion, RootMotion};

pub use lamogen_body as body;
pub use lamogen_character as character;
pub use lamogen_files as files;
pub use lamogen_guide as guide;
pub use lamogen_laban as laban;
pub use lamogen_model as model;
pub use lamogen_motion as motion;

/// The program in the README, compiled with the doc tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

/// The program of `docs/characters.md`, compiled with the doc tests.
#[cfg(all(doctest, feature = "compact"))]
#[doc = include_str!("../../../docs/characters.md")]
struct CharactersPage;

/// The program of `docs/places.md`, compiled with the doc tests.
#[cfg(all(doctest, feature = "compact"))]
#[doc = include_str!("../../../docs/places.md")]
struct PlacesPage;

/// The programs of `docs/own-goal.md`, compiled with the doc tests.
#[cfg(all(doctest, feature = "compact"))]
#[doc = include_str!("../../../docs/own-goal.md")]
struct OwnGoalPage;
