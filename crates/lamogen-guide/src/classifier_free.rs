//! Classifier-free guidance: how strongly a network follows the sentence.

use burn::tensor::{Device, Tensor, TensorData};
use lamogen_model::{
    Denoiser, DenoiserInput, LABAN_FEATURES, LinearizedEvaluation, MotionWindow, NoiseSchedule,
    Prediction, Prompt, SamplingMethod, TokenBatch, Tokens, limited_text_scales,
};

use crate::error::GuideError;
use crate::text_scale::TextScale;

/// A network with classifier-free guidance: its output is `unconditional + scale · (conditional - unconditional)`.
///
/// `conditional` is the output of the network for the sentence, `unconditional` its output for a text without words
/// (Ho and Salimans 2022, arXiv 2207.12598; for motion MDM, Tevet et al. 2022, section 3). At a scale of 1 the output
/// is that of the network itself. Above 1 motions follow the sentence more closely and differ less from each other. The
/// network must have been trained with text dropout.
///
/// The network may limit the scale of some features, such as the turning of the root ([`Denoiser::text_scales`]), and
/// decides what takes the place of the sentence ([`Denoiser::unconditional`]).
///
/// The network is evaluated twice a step, at the timesteps of the [scale](TextScale); at the others once. Where only the condition changes ([`Denoiser::denoise_again`]), the unconditional output
/// is not computed anew. Gradients with respect to the embedding or modulation go through the
/// conditional evaluation, those with respect to the noisy motion through both.
pub struct ClassifierFree<'a, D> {
    network: &'a D,
    /// `None` at a scale of 1, where the unconditional output is not needed.
    text_guidance: Option<TextGuidance>,
}

/// The scale of each feature, and the text of the unconditional evaluation.
struct TextGuidance {
    /// The scale of each feature, `[1, 1, features]`.
    scales: Tensor<3>,
    /// The smallest timestep whose prediction is scaled.
    until: usize,
    /// A text without words.
    wordless: Tokens,
}

/// The context of a sentence, and the encoded text without words.
#[derive(Clone)]
pub struct ClassifierFreeContext<C> {
    conditional: C,
    unconditional: Option<Prompt<C>>,
}

impl<'a, D: Denoiser> ClassifierFree<'a, D> {
    /// Wraps a network at a scale, or at a scale for some of the timesteps. `wordless` is a text without words
    /// (`lamogen_model::Tokenizer::unconditional`).
    ///
    /// # Errors
    ///
    /// If the scale is invalid (see [`TextScale::check`]).
    pub fn new(
        network: &'a D,
        text_scale: impl Into<TextScale>,
        wordless: &Tokens,
    ) -> Result<Self, GuideError> {
        let text_scale = text_scale.into();
        text_scale.check(network.noise_schedule())?;
        let TextScale { scale, until } = text_scale;
        let text_guidance = (scale != 1.0).then(|| TextGuidance {
            scales: scales_tensor(network.text_scales(scale), &network.device()),
            until,
            wordless: wordless.clone(),
        });
        Ok(ClassifierFree {
            network,
            text_guidance,
        })
    }

    /// Returns the encoded text without words, and the scales as a tensor that fits the output. Returns `None` if no prediction
    /// at these timesteps is scaled.
    fn text_guidance<'c>(
        &self,
        timesteps: &[usize],
        context: &'c ClassifierFreeContext<D::Context>,
    ) -> Option<(&'c Prompt<D::Context>, Tensor<3>)> {
        let TextGuidance { scales, until, .. } = self.text_guidance.as_ref()?;
        let unconditional = context.unconditional.as_ref()?;
        if timesteps.iter().all(|timestep| timestep < until) {
            return None;
        }
        let rows = timesteps.iter().map(|timestep| match timestep < until {
            true => scales.ones_like(),
            false => scales.clone(),
        });
        let scales = Tensor::cat(rows.collect(), 0);
        Some((unconditional, scales))
    }
}

/// Returns the scale of each pose feature, `[1, 1, features]`: the given scale, but at most 1 for the turning of the
/// root, as by default in [`Denoiser::text_scales`].
pub fn feature_scales(scale: f64, features: usize, device: &Device) -> Tensor<3> {
    scales_tensor(limited_text_scales(scale, features), device)
}

fn scales_tensor(scales: Vec<f32>, device: &Device) -> Tensor<3> {
    let shape = [1, 1, scales.len()];
    Tensor::from_data(TensorData::new(scales, shape), device)
}

/// Computes `unconditional + scales · (conditional - unconditional)`.
fn combine(conditional: Tensor<3>, unconditional: Tensor<3>, scales: Tensor<3>) -> Tensor<3> {
    unconditional.clone() + (conditional - unconditional) * scales
}

impl<D: Denoiser> Denoiser for ClassifierFree<'_, D> {
    type Context = ClassifierFreeContext<D::Context>;

    fn prediction(&self) -> Prediction {
        self.network.prediction()
    }

    fn pose_features(&self) -> usize {
        self.network.pose_features()
    }

    fn max_frames(&self) -> usize {
        self.network.max_frames()
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
        let conditional = self.network.encode(tokens);
        let unconditional = self.text_guidance.as_ref().map(|text_guidance| {
            let wordless = vec![&text_guidance.wordless; tokens.lengths.len()];
            let wordless = TokenBatch::new(wordless, &tokens.ids.device());
            self.network.unconditional(&conditional, &wordless)
        });
        Prompt {
            embedding: conditional.embedding,
            context: ClassifierFreeContext {
                conditional: conditional.context,
                unconditional,
            },
        }
    }

    fn with_prefix(&self, context: Self::Context, prefix: Tensor<3>) -> Self::Context {
        let ClassifierFreeContext {
            conditional,
            unconditional,
        } = context;
        let unconditional = unconditional.map(|prompt| Prompt {
            embedding: prompt.embedding,
            context: self.network.with_prefix(prompt.context, prefix.clone()),
        });
        ClassifierFreeContext {
            conditional: self.network.with_prefix(conditional, prefix),
            unconditional,
        }
    }

    fn embed_timesteps(&self, timesteps: &[usize]) -> Tensor<2> {
        self.network.embed_timesteps(timesteps)
    }

    fn embed_laban(&self, means: &[[Option<f32>; LABAN_FEATURES]]) -> Option<Tensor<2>> {
        self.network.embed_laban(means)
    }

    fn denoise(&self, input: DenoiserInput, context: &Self::Context) -> Tensor<3> {
        let Some((unconditional, scales)) = self.text_guidance(&input.timesteps, context) else {
            return self.network.denoise(input, &context.conditional);
        };
        let [conditional, unconditional] =
            self.network
                .denoise_with_unconditional(input, &context.conditional, unconditional);
        combine(conditional, unconditional, scales)
    }

    fn linearize<'a>(
        &'a self,
        input: DenoiserInput,
        context: &'a Self::Context,
    ) -> LinearizedEvaluation<'a> {
        let Some((unconditional, scales)) = self.text_guidance(&input.timesteps, context) else {
            return self.network.linearize(input, &context.conditional);
        };
        let without_text = input.without_text(unconditional);
        let unconditional = self.network.denoise(without_text, &unconditional.context);
        let conditional = self.network.linearize(input, &context.conditional);
        let output = combine(
            conditional.output.clone(),
            unconditional.clone(),
            scales.clone(),
        );
        LinearizedEvaluation::new(output, move |gradient| conditional.pull(gradient * scales))
            .with_unconditional(Some(unconditional))
    }

    fn denoise_again(
        &self,
        input: DenoiserInput,
        context: &Self::Context,
        unconditional: Option<Tensor<3>>,
    ) -> Tensor<3> {
        let scaled = self.text_guidance(&input.timesteps, context);
        let (Some((_, scales)), Some(unconditional)) = (scaled, unconditional) else {
            return self.denoise(input, context);
        };
        let conditional = self.network.denoise(input, &context.conditional);
        combine(conditional, unconditional, scales)
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
        let Some((unconditional, scales)) = self.text_guidance(&input.timesteps, context) else {
            return self.network.linearize_motion(input, &context.conditional);
        };
        let without_text = input.without_text(unconditional);
        let unconditional = { self.network }.linearize_motion(without_text, &unconditional.context);
        let conditional = self.network.linearize_motion(input, &context.conditional);
        let output = combine(
            conditional.output.clone(),
            unconditional.output.clone(),
            scales.clone(),
        );
        LinearizedEvaluation::new(output, move |gradient: Tensor<3>| {
            let rest: Tensor<3> = 1.0 - scales.clone();
            conditional.pull(gradient.clone() * scales) + unconditional.pull(gradient * rest)
        })
    }
}
