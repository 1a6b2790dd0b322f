//! Networks that see the frames of motions in another arrangement: loops with their beginning once more, long motions in tiles.

use burn::tensor::{Device, Int, Tensor};
use lamogen_model::{
    Denoiser, DenoiserInput, FrameMask, LABAN_FEATURES, LinearizedEvaluation, MotionWindow,
    NoiseSchedule, Prediction, Prompt, SamplingMethod, TokenBatch,
};

/// How the frames of motions are arranged for a network, and how its predictions become predictions of the motions. Both
/// functions are linear.
pub trait FrameArrangement {
    /// Arranges motions, `[batch, frames, features]`, for the network, which may see more or other frames and motions.
    fn arrange(&self, motions: Tensor<3>) -> Tensor<3>;

    /// Blends what the network predicts of each frame, in the arrangement, to predictions of the motions.
    fn blend(&self, predictions: Tensor<3>) -> Tensor<3>;

    /// Returns the mask of the motions that the network sees.
    fn mask(&self) -> &FrameMask;

    /// Returns the length of the longest motion, for a network whose longest has `max_frames` frames.
    fn longest(&self, max_frames: usize) -> usize;
}

/// A network that sees motions in another arrangement: [`Looped`](crate::Looped) and [`Tiled`](crate::Tiled).
pub struct Arranged<'a, D, A> {
    network: &'a D,
    /// `None` if the network sees motions as they are.
    arrangement: Option<A>,
}

impl<'a, D, A> Arranged<'a, D, A> {
    /// Wraps a network.
    pub(crate) fn with(network: &'a D, arrangement: Option<A>) -> Self {
        Arranged {
            network,
            arrangement,
        }
    }
}

/// Returns the input of a network in an arrangement.
fn arranged_input(arrangement: &impl FrameArrangement, input: DenoiserInput) -> DenoiserInput {
    DenoiserInput {
        x_t: arrangement.arrange(input.x_t),
        mask: arrangement.mask().clone(),
        ..input
    }
}

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
fn transpose(
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

impl<D: Denoiser, A: FrameArrangement> Denoiser for Arranged<'_, D, A> {
    type Context = D::Context;

    fn prediction(&self) -> Prediction {
        self.network.prediction()
    }

    fn pose_features(&self) -> usize {
        self.network.pose_features()
    }

    fn max_frames(&self) -> usize {
        let own = self.network.max_frames();
        match &self.arrangement {
            Some(arrangement) => arrangement.longest(own),
            None => own,
        }
    }

    fn min_frames(&self) -> usize {
        self.network.min_frames()
    }

    fn device(&self) -> Device {
        self.network.device()
    }

    fn noise_schedule(&self) -> NoiseSchedule {
        self.network.noise_schedule()
    }

    fn sampling_method(&self) -> SamplingMethod {
        self.network.sampling_method()
    }

    fn window(&self) -> Option<MotionWindow> {
        self.network.window()
    }

    fn encode(&self, tokens: &TokenBatch) -> Prompt<Self::Context> {
        self.network.encode(tokens)
    }

    fn unconditional(
        &self,
        prompts: &Prompt<Self::Context>,
        wordless: &TokenBatch,
    ) -> Prompt<Self::Context> {
        self.network.unconditional(prompts, wordless)
    }

    fn text_scales(&self, scale: f64) -> Vec<f32> {
        self.network.text_scales(scale)
    }

    fn with_prefix(&self, context: Self::Context, prefix: Tensor<3>) -> Self::Context {
        self.network.with_prefix(context, prefix)
    }

    fn embed_timesteps(&self, timesteps: &[usize]) -> Tensor<2> {
        self.network.embed_timesteps(timesteps)
    }

    fn embed_laban(&self, means: &[[Option<f32>; LABAN_FEATURES]]) -> Option<Tensor<2>> {
        self.network.embed_laban(means)
    }

    fn denoise(&self, input: DenoiserInput, context: &Self::Context) -> Tensor<3> {
        let Some(arrangement) = &self.arrangement else {
            return self.network.denoise(input, context);
        };
        let input = arranged_input(arrangement, input);
        arrangement.blend(self.network.denoise(input, context))
    }

    fn linearize<'a>(
        &'a self,
        input: DenoiserInput,
        context: &'a Self::Context,
    ) -> LinearizedEvaluation<'a> {
        let Some(arrangement) = &self.arrangement else {
            return self.network.linearize(input, context);
        };
        let input = arranged_input(arrangement, input);
        let evaluation = self.network.linearize(input, context);
        let shape = evaluation.output.dims();
        let output = arrangement.blend(evaluation.output.clone());
        let unconditional = evaluation.unconditional.clone();
        LinearizedEvaluation::new(output, move |gradient| {
            evaluation.pull(transpose(|x| arrangement.blend(x), shape, gradient))
        })
        .with_unconditional(unconditional)
    }

    fn denoise_again(
        &self,
        input: DenoiserInput,
        context: &Self::Context,
        unconditional: Option<Tensor<3>>,
    ) -> Tensor<3> {
        let Some(arrangement) = &self.arrangement else {
            return self.network.denoise_again(input, context, unconditional);
        };
        // The unconditional output that was kept is that of the arranged frames.
        let input = arranged_input(arrangement, input);
        arrangement.blend(self.network.denoise_again(input, context, unconditional))
    }

    fn modulation_width(&self) -> usize {
        self.network.modulation_width()
    }

    fn token_offset_width(&self) -> usize {
        self.network.token_offset_width()
    }

    fn linearize_motion<'a>(
        &'a self,
        input: DenoiserInput,
        context: &'a Self::Context,
    ) -> LinearizedEvaluation<'a, 3> {
        let Some(arrangement) = &self.arrangement else {
            return self.network.linearize_motion(input, context);
        };
        let motion_shape = input.x_t.dims();
        let input = arranged_input(arrangement, input);
        let evaluation = self.network.linearize_motion(input, context);
        let shape = evaluation.output.dims();
        let output = arrangement.blend(evaluation.output.clone());
        LinearizedEvaluation::new(output, move |gradient| {
            let gradient = transpose(|x| arrangement.blend(x), shape, gradient);
            let gradient = evaluation.pull(gradient);
            transpose(|x| arrangement.arrange(x), motion_shape, gradient)
        })
    }
}
