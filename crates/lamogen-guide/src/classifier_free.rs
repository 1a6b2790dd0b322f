//! Classifier-free guidance: how strongly a network follows the sentence.

use burn::tensor::{Device, Int, Tensor, TensorData};
use lamogen_model::{
    Denoiser, DenoiserInput, LABAN_FEATURES, LinearizedEvaluation, Prediction, Prompt,
};
use lamogen_motion::FeatureGroup;

use crate::error::GuideError;

/// A network whose output is `free + scale · (told - free)`: `told` is what it says to the sentence, `free` what it says where nothing is said
/// (Ho and Salimans 2022, arXiv 2207.12598; for motion MDM, Tevet et al. 2022, section 3). At 1 it is the network as it is; above, it follows the
/// sentence more closely, and motions differ less. The network must have been trained with text dropout.
///
/// How far the body turns is followed as the network says it, at a scale of 1 where the scale is above: one feature of 263 that is summed up over all
/// frames, of which a scale of 2.5 makes half a circle where a quarter was asked ([`feature_scales`]).
///
/// It is evaluated twice a step. Gradients go through the told evaluation.
pub struct ClassifierFree<'a, D> {
    network: &'a D,
    /// None at a scale of 1.
    free: Option<Free>,
}

struct Free {
    /// Of each feature, `[1, 1, features]`.
    scales: Tensor<3>,
    /// Token ids of one motion of which nothing is said.
    unsaid: Vec<i32>,
}

/// What a network keeps of a sentence, and of none.
#[derive(Clone)]
pub struct ClassifierFreeContext<C> {
    told: C,
    free: Option<Prompt<C>>,
}

impl<'a, D: Denoiser> ClassifierFree<'a, D> {
    /// A network at a scale. `unconditional` are the token ids of a text without words (`lamogen_model::Tokenizer::unconditional`).
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
        let free = (scale != 1.0).then(|| Free {
            scales: feature_scales(scale, network.pose_features(), &network.device()),
            unsaid: unconditional.iter().map(|&id| id as i32).collect(),
        });
        Ok(ClassifierFree { network, free })
    }

    /// What the network is given where nothing is said, and the scales.
    fn unsaid<'c>(
        &self,
        input: &DenoiserInput,
        context: &'c ClassifierFreeContext<D::Context>,
    ) -> Option<(DenoiserInput, &'c D::Context, Tensor<3>)> {
        let (free, prompt) = (self.free.as_ref()?, context.free.as_ref()?);
        let input = DenoiserInput {
            embedding: prompt.embedding.clone(),
            modulation: None,
            ..input.clone()
        };
        Some((input, &prompt.context, free.scales.clone()))
    }

    /// What the network says where nothing is said, and the scales.
    fn free(
        &self,
        input: &DenoiserInput,
        context: &ClassifierFreeContext<D::Context>,
    ) -> Option<(Tensor<3>, Tensor<3>)> {
        let (input, context, scales) = self.unsaid(input, context)?;
        Some((self.network.denoise(input, context), scales))
    }
}

/// How strongly each of a pose's features follows the sentence at a scale, `[1, 1, features]`: all by the scale, but the turning of the root
/// ([`FeatureGroup::RootYaw`]) by 1 at most.
pub fn feature_scales(scale: f64, features: usize, device: &Device) -> Tensor<3> {
    let mut scales = vec![scale as f32; features];
    for turning in &mut scales[FeatureGroup::RootYaw.range()] {
        *turning = turning.min(1.0);
    }
    Tensor::from_data(TensorData::new(scales, [1, 1, features]), device)
}

fn scaled(told: Tensor<3>, free: Tensor<3>, scales: Tensor<3>) -> Tensor<3> {
    free.clone() + (told - free) * scales
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
        let free = self.free.as_ref().map(|free| {
            let ids = TensorData::new(free.unsaid.repeat(batch), [batch, free.unsaid.len()]);
            self.network
                .encode(Tensor::from_data(ids, &tokens.device()))
        });
        let told = self.network.encode(tokens);
        Prompt {
            embedding: told.embedding,
            context: ClassifierFreeContext {
                told: told.context,
                free,
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
        let free = self.free(&input, context);
        let told = self.network.denoise(input, &context.told);
        match free {
            Some((free, scales)) => scaled(told, free, scales),
            None => told,
        }
    }

    fn linearize<'a>(
        &'a self,
        input: DenoiserInput,
        context: &'a Self::Context,
    ) -> LinearizedEvaluation<'a> {
        let free = self.free(&input, context);
        let told = self.network.linearize(input, &context.told);
        match free {
            Some((free, scales)) => {
                let output = scaled(told.output.clone(), free, scales.clone());
                LinearizedEvaluation::new(output, move |gradient| told.pull(gradient * scales))
            }
            None => told,
        }
    }

    fn modulations(&self) -> usize {
        self.network.modulations()
    }

    fn linearize_motion<'a>(
        &'a self,
        input: DenoiserInput,
        context: &'a Self::Context,
    ) -> LinearizedEvaluation<'a, 3> {
        let unsaid = self.unsaid(&input, context);
        let Some((unsaid, free, scales)) = unsaid else {
            return self.network.linearize_motion(input, &context.told);
        };
        let free = self.network.linearize_motion(unsaid, free);
        let told = self.network.linearize_motion(input, &context.told);
        let output = scaled(told.output.clone(), free.output.clone(), scales.clone());
        LinearizedEvaluation::new(output, move |gradient: Tensor<3>| {
            let rest: Tensor<3> = 1.0 - scales.clone();
            told.pull(gradient.clone() * scales) + free.pull(gradient * rest)
        })
    }
}
