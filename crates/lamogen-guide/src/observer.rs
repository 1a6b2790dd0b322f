//! Observers, which receive the steps of a run and may stop it.

use std::fmt;
use std::ops::ControlFlow;

use burn::tensor::Tensor;

/// A part of a run: one of the two passes, or the fit to a rigid body after each of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Pass {
    /// The first pass, from the text alone.
    Baseline,
    /// The second pass, towards the target.
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
    /// The pass of the step.
    pub pass: Pass,
    /// The number of the step in the pass, counted from 0.
    pub index: usize,
    /// The number of steps of the pass; a fit may end before the last one. Where guidance moves the finished motion or
    /// the start noise, each update is a step. The updates of a finish are the last steps of the guided pass.
    pub steps: usize,
    /// The timestep at which the network was evaluated; 0 for updates of the finished motion or the start noise, and
    /// for a fit.
    pub timestep: usize,
    /// The loss of each motion of the batch, before the step's last update; guided pass only.
    pub loss: Option<&'a [f32]>,
    /// The gradient of the last update of the embedding, `[batch, d_condition]`, or of the modulation,
    /// `[batch, modulations]`; only where guidance moves one of them.
    pub gradient: Option<&'a Tensor<2>>,
    /// The sentence embeddings after the step, `[batch, d_condition]`.
    pub embedding: &'a Tensor<2>,
    /// The clean motions that were predicted at this step, normalised, `[batch, frames, features]`; in a fit, the
    /// finished motions of the network.
    pub prediction: &'a Tensor<3>,
}

/// Receives every step of a run and may stop it.
///
/// Closures are observers; `()` is an observer that ignores all steps.
pub trait Observer {
    /// Receives a step after it has been made; [`ControlFlow::Break`] stops the run.
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
