//! The rigid body.
mod banded;
mod contacts;
mod descent;
mod fit;
mod kinematics;
mod pose;

pub use contacts::{Stand, stands};
pub use fit::{Fit, Goal, Progress};
pub use kinematics::{Kinematics, LinearizedKinematics};
