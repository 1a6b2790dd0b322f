//! Laban movement analysis in numbers: the Weight, Time, Flow and Shape of a motion at every frame,
//! the words that ask for more or less of them, and the loss between measured and requested values.
//!
//! ```text
//! joints ──LabanFeatures──▶ features ──LabanTarget──▶ loss per component
//! [batch, frames, 22, 3]    [batch, frames, 4]     [batch, 4]
//! tags ─▶ Scale ─▶ ScaleCurve ─▶ Goals ─┘
//!                  [frames, 4]   of the body and its parts
//! ```
//!
//! All functions on tensors are differentiable and work on batches of motions of different
//! lengths. The definitions follow LaMoGen (arXiv 2509.24469), section "Laban Effort and Shape
//! Quantification" and appendix, after Samadani et al. 2020.

mod curve;
mod effectors;
mod factor;
mod features;
mod goal;
mod goal_error;
mod goals;
mod loss;
mod motion_loss;
mod parts;
mod peaks;
mod series;
mod smoothing;
mod tags;
mod window;

pub use curve::ScaleCurve;
pub use effectors::{BodyPart, EffectorError, EndEffectors};
pub use factor::{Factor, FactorError, FactorKeyframe, Interpolation};
pub use features::{LabanFeatures, LabanOptions};
pub use goal::{Goal, GoalTurn};
pub use goal_error::GoalError;
pub use goals::{EndEffectorGoals, Goals};
pub use loss::{LabanTarget, LossDivisor};
pub use motion_loss::MotionLoss;
pub use parts::PartScale;
pub use series::{LabanSeries, TimeSummary};
pub use smoothing::{GaussianKernel, GaussianKernelError, Smoothing};
pub use tags::{COMPONENTS, Component, Scale, ScaleError, Tag, TagError};
pub use window::SmoothingWindow;

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
