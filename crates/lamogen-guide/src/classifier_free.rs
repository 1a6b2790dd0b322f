//! Classifier-free guidance: how strongly a network follows the sentence.

use burn::tensor::{Device, Int, Tensor, TensorData};
use lamogen_model::{
    Denoiser, DenoiserInput, LABAN_FEATURES, LinearizedEvaluation, Prediction, Prompt,
};
use lamogen_motion::FeatureGroup;

use crate::error::GuideError;

/// A network with classifier-free guidance: its output is `unconditional + scale · (conditional - unconditional)`.
///
/// `conditional` is the output of the network for the sentence, `unconditional` its output for a text without words
/// (Ho and Salimans 2022, arXiv 2207.12598; for motion MDM, Tevet et al. 2022, section 3). At a scale of 1 the output
/// is that of the network itself. Above 1 motions follow the sentence more closely and differ less from each other. The
/// network must have been trained with text dropout.
///
/// The turning of the root has a scale of at most 1 ([`feature_scales`]). It is one feature of 263 and is summed over
/// all frames, so a scale of 2.5 would turn the body by half a circle where a quarter was requested.
///
/// The network is evaluated twice a step. Gradients with respect to the embedding or modulation go through the
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
    /// The token ids of a text without words.
    unconditional_tokens: Vec<i32>,
}

/// The context of a sentence, and the encoded text without words.
#[derive(Clone)]
pub struct ClassifierFreeContext<C> {
    conditional: C,
    unconditional: Option<Prompt<C>>,
}

impl<'a, D: Denoiser> ClassifierFree<'a, D> {
    /// Wraps a network at a scale. `unconditional` are the token ids of a text without words
    /// (`lamogen_model::Tokenizer::unconditional`).
    ///
    /// # Errors
    ///
    /// If the scale is not finite or below 0.
    pub fn new(network: &'a D, scale: f64, unconditional: &[u32]) -> Result<Self, GuideError> {
        if !(scale.is_finite() && scale >= 0.0) {
            return Err(GuideError::Guidance(format!(
                "expected a finite text scale of at least 0, found {scale}"
            )));
        }
        let text_guidance = (scale != 1.0).then(|| TextGuidance {
            scales: feature_scales(scale, network.pose_features(), &network.device()),
            unconditional_tokens: unconditional.iter().map(|&id| id as i32).collect(),
        });
        Ok(ClassifierFree {
            network,
            text_guidance,
        })
    }

    /// Returns the input and the context of the unconditional evaluation, and the scales; `None` at a scale of 1.
    fn unconditional_input<'c>(
        &self,
        input: &DenoiserInput,
        context: &'c ClassifierFreeContext<D::Context>,
    ) -> Option<(DenoiserInput, &'c D::Context, Tensor<3>)> {
        let text_guidance = self.text_guidance.as_ref()?;
        let prompt = context.unconditional.as_ref()?;
        let input = DenoiserInput {
            embedding: prompt.embedding.clone(),
            modulation: None,
            ..input.clone()
        };
        Some((input, &prompt.context, text_guidance.scales.clone()))
    }

    /// Returns the output of the unconditional evaluation, and the scales; `None` at a scale of 1.
    fn denoise_unconditionally(
        &self,
        input: &DenoiserInput,
        context: &ClassifierFreeContext<D::Context>,
    ) -> Option<(Tensor<3>, Tensor<3>)> {
        let (input, context, scales) = self.unconditional_input(input, context)?;
        Some((self.network.denoise(input, context), scales))
    }
}

/// Returns the scale of each pose feature, `[1, 1, features]`: the given scale, but at most 1 for the turning of the
/// root ([`FeatureGroup::RootYaw`]).
pub fn feature_scales(scale: f64, features: usize, device: &Device) -> Tensor<3> {
    let mut scales = vec![scale as f32; features];
    for yaw_scale in &mut scales[FeatureGroup::RootYaw.range()] {
        *yaw_scale = yaw_scale.min(1.0);
    }
    Tensor::from_data(TensorData::new(scales, [1, 1, features]), device)
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

    fn encode(&self, tokens: Tensor<2, Int>) -> Prompt<Self::Context> {
        let [batch, _] = tokens.dims();
        let unconditional = self.text_guidance.as_ref().map(|text_guidance| {
            let ids = &text_guidance.unconditional_tokens;
            let ids = TensorData::new(ids.repeat(batch), [batch, ids.len()]);
            self.network
                .encode(Tensor::from_data(ids, &tokens.device()))
        });
        let conditional = self.network.encode(tokens);
        Prompt {
            embedding: conditional.embedding,
            context: ClassifierFreeContext {
                conditional: conditional.context,
                unconditional,
            },
        }
    }

    fn embed_timesteps(&self, timesteps: &[usize]) -> Tensor<2> {
        self.network.embed_timesteps(timesteps)
    }

    fn embed_laban(&self, means: &[[Option<f32>; LABAN_FEATURES]]) -> Option<Tensor<2>> {
        self.network.embed_laban(means)
    }

    fn denoise(&self, input: DenoiserInput, context: &Self::Context) -> Tensor<3> {
        let unconditional = self.denoise_unconditionally(&input, context);
        let conditional = self.network.denoise(input, &context.conditional);
        match unconditional {
            Some((unconditional, scales)) => combine(conditional, unconditional, scales),
            None => conditional,
        }
    }

    fn linearize<'a>(
        &'a self,
        input: DenoiserInput,
        context: &'a Self::Context,
    ) -> LinearizedEvaluation<'a> {
        let unconditional = self.denoise_unconditionally(&input, context);
        let conditional = self.network.linearize(input, &context.conditional);
        match unconditional {
            Some((unconditional, scales)) => {
                let output = combine(conditional.output.clone(), unconditional, scales.clone());
                LinearizedEvaluation::new(output, move |gradient| {
                    conditional.pull(gradient * scales)
                })
            }
            None => conditional,
        }
    }

    fn modulation_width(&self) -> usize {
        self.network.modulation_width()
    }

    fn linearize_motion<'a>(
        &'a self,
        input: DenoiserInput,
        context: &'a Self::Context,
    ) -> LinearizedEvaluation<'a, 3> {
        let Some((unconditional_input, unconditional_context, scales)) =
            self.unconditional_input(&input, context)
        else {
            return self.network.linearize_motion(input, &context.conditional);
        };
        let unconditional =
            { self.network }.linearize_motion(unconditional_input, unconditional_context);
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
