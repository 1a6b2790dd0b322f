//! Rigid bodies: forward kinematics, and fits of motions to a body with rigid bones.
//!
//! ```text
//! root, local rotations ──Kinematics──▶ joints ──▶ loss ──gradient──▶ root, local rotations
//!
//! Motion (bones stretch, feet slide) ──FitOptions──▶ Rotations (rigid bones, feet that stand, elbows that bend forward)
//!                                      ▲
//!                                    FitObjective: the loss of guidance
//! ```
//!
//! [`Kinematics`] is forward kinematics as a differentiable function of tensors, with a gradient derived by hand for CPUs.
//! [`FitOptions::run`] finds the rotations of a body that are nearest to a motion over its whole length at once, and may
//! draw them towards a [`FitObjective`]. Units are metres, degrees where the documentation says so, and frames at 20 a
//! second; Y points up.

mod banded;
mod contacts;
mod descent;
mod fit;
mod held;
mod kinematics;
mod options;
mod pose;
mod seam;
mod snaps;
mod steps;
mod track;

pub use contacts::{FootContact, foot_contacts};
pub use fit::{FitInput, FitObjective, FitProgress, FitResult, ground};
pub use kinematics::{Kinematics, LinearizedKinematics};
pub use options::{FitError, FitOptions};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
