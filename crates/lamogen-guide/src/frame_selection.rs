//! Functions of frames that predictions of overlapping motions need: selecting, blending, and the way back.

use burn::tensor::{Int, Tensor};

/// Returns a curve from 0 to 1 that begins and ends level.
pub(crate) fn smooth_step(part: f32) -> f32 {
    part * part * (3.0 - 2.0 * part)
}

/// Selects frames, `[batch, selected frames]`, of motions, `[batch, frames, features]`.
pub(crate) fn select_frames(motions: Tensor<3>, frames: &Tensor<2, Int>) -> Tensor<3> {
    let [batch, _, features] = motions.dims();
    let [_, selected] = frames.dims();
    let index = { frames.clone() }
        .reshape([batch, selected, 1])
        .expand([batch, selected, features]);
    motions.gather(1, index)
}

/// Pulls a gradient of the result of a linear function back to its argument, which has the given shape.
pub(crate) fn transpose(
    function: impl FnOnce(Tensor<3>) -> Tensor<3>,
    shape: [usize; 3],
    gradient: Tensor<3>,
) -> Tensor<3> {
    let leaf = Tensor::<3>::zeros(shape, &gradient.device())
        .autodiff()
        .require_grad();
    let product = (function(leaf.clone()) * gradient.autodiff()).sum();
    leaf.grad_remove(&mut product.backward())
        .expect("the function depends on its argument")
}
