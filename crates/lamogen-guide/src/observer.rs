//! Watching and stopping a run.

use std::fmt;
use std::ops::ControlFlow;

use burn::tensor::Tensor;

/// One of the two passes, or what follows each of them on a rigid body.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Pass {
    /// The first, from text alone.
    Baseline,
    /// The second, towards the target.
    Guided,
    /// The fit of a pass's motions to a rigid body.
    Body,
}

impl fmt::Display for Pass {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Pass::Baseline => "baseline",
            Pass::Guided => "guided",
            Pass::Body => "body",
        })
    }
}

/// A step that has just been made.
#[derive(Clone, Copy, Debug)]
pub struct Step<'a> {
    /// The pass it belongs to.
    pub pass: Pass,
    /// Its number in the pass, from 0.
    pub index: usize,
    /// How many steps the pass has; a fit may end before the last one. Where guidance moves the finished motion or the start noise, how many updates. Those of a finish
    /// come after them and count too.
    pub steps: usize,
    /// The timestep that the network saw; 0 for those updates and for a fit.
    pub timestep: usize,
    /// The Laban loss of each motion of the batch, before the step's last update; guided pass only.
    pub loss: Option<&'a [f32]>,
    /// The gradient of the last update of the embedding, `[batch, d_condition]`, or of the modulation, `[batch, modulations]`; only
    /// where guidance moves one of them.
    pub gradient: Option<&'a Tensor<2>>,
    /// The sentence embedding after the step, `[batch, d_condition]`.
    pub embedding: &'a Tensor<2>,
    /// The clean motion as predicted at this step, normalised, `[batch, frames, features]`; in a fit what the network finished.
    pub prediction: &'a Tensor<3>,
}

/// Receives every step of a run and may stop it.
///
/// Closures are observers; `()` watches nothing.
pub trait Observer {
    /// Called after a step; [`ControlFlow::Break`] stops the run.
    fn step(&mut self, step: &Step<'_>) -> ControlFlow<()>;
}

impl<F: FnMut(&Step<'_>) -> ControlFlow<()>> Observer for F {
    fn step(&mut self, step: &Step<'_>) -> ControlFlow<()> {
        self(step)
    }
}

impl Observer for () {
    fn step(&mut self, _step: &Step<'_>) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }
}
