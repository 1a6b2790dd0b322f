//! A network of any of the families that this crate has.

use burn::module::Module;
use burn::tensor::{Device, Tensor};
use serde::Serialize;

use crate::config::{LABAN_FEATURES, ModelConfig, Prediction};
use crate::denoiser::{Denoiser, DenoiserInput, LinearizedEvaluation, Prompt};
use crate::diffusion::{MotionWindow, NoiseSchedule, SamplingMethod};
use crate::mdm::{Mdm, MdmConfig, MdmContext};
use crate::network::{CrossAttentionContext, MotionDiffuse};
use crate::tokens::TokenBatch;

/// A network whose family is known only when it is loaded.
#[derive(Module, Debug)]
#[allow(clippy::large_enum_variant)]
pub enum AnyNetwork {
    /// MotionDiffuse, and the networks that lamogen trains.
    MotionDiffuse(MotionDiffuse),
    /// MDM or DiP.
    Mdm(Mdm),
}

/// The data that an [`AnyNetwork`] needs of prompts beside their embeddings.
#[derive(Clone, Debug)]
pub enum AnyContext {
    /// Those of [`AnyNetwork::MotionDiffuse`].
    MotionDiffuse(CrossAttentionContext),
    /// Those of [`AnyNetwork::Mdm`].
    Mdm(Box<MdmContext>),
}

/// The config of an [`AnyNetwork`], which is written as JSON without the name of the family.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum AnyConfig<'a> {
    /// That of [`AnyNetwork::MotionDiffuse`].
    MotionDiffuse(&'a ModelConfig),
    /// That of [`AnyNetwork::Mdm`].
    Mdm(&'a MdmConfig),
}

impl From<MotionDiffuse> for AnyNetwork {
    fn from(network: MotionDiffuse) -> Self {
        AnyNetwork::MotionDiffuse(network)
    }
}

impl From<Mdm> for AnyNetwork {
    fn from(network: Mdm) -> Self {
        AnyNetwork::Mdm(network)
    }
}

impl AnyNetwork {
    /// Returns the config of the network.
    pub fn config(&self) -> AnyConfig<'_> {
        match self {
            AnyNetwork::MotionDiffuse(network) => AnyConfig::MotionDiffuse(network.config()),
            AnyNetwork::Mdm(network) => AnyConfig::Mdm(network.config()),
        }
    }

    /// Returns the network if it is a MotionDiffuse.
    pub fn motion_diffuse(&self) -> Option<&MotionDiffuse> {
        match self {
            AnyNetwork::MotionDiffuse(network) => Some(network),
            AnyNetwork::Mdm(_) => None,
        }
    }
}

/// Calls a method of the network inside.
macro_rules! delegate {
    ($network:expr, $inner:ident => $call:expr) => {
        match $network {
            AnyNetwork::MotionDiffuse($inner) => $call,
            AnyNetwork::Mdm($inner) => $call,
        }
    };
}

/// Returns a prompt with its context as that of any network.
fn any_prompt<C>(prompt: Prompt<C>, context: fn(C) -> AnyContext) -> Prompt<AnyContext> {
    Prompt {
        embedding: prompt.embedding,
        context: context(prompt.context),
    }
}

/// The family of a context is that of the network that made it. Other contexts are broken invariants.
const FOREIGN: &str = "the context must be one that the same network encoded";

impl AnyContext {
    fn motion_diffuse(&self) -> &CrossAttentionContext {
        match self {
            AnyContext::MotionDiffuse(context) => context,
            AnyContext::Mdm(_) => panic!("{FOREIGN}"),
        }
    }

    fn mdm(&self) -> &MdmContext {
        match self {
            AnyContext::Mdm(context) => context,
            AnyContext::MotionDiffuse(_) => panic!("{FOREIGN}"),
        }
    }
}

/// Contexts must be those that the same network encoded; otherwise all evaluations panic.
impl Denoiser for AnyNetwork {
    type Context = AnyContext;

    fn prediction(&self) -> Prediction {
        delegate!(self, network => network.prediction())
    }

    fn pose_features(&self) -> usize {
        delegate!(self, network => network.pose_features())
    }

    fn max_frames(&self) -> usize {
        delegate!(self, network => network.max_frames())
    }

    fn min_frames(&self) -> usize {
        delegate!(self, network => network.min_frames())
    }

    fn noise_schedule(&self) -> NoiseSchedule {
        delegate!(self, network => network.noise_schedule())
    }

    fn sampling_method(&self) -> SamplingMethod {
        delegate!(self, network => network.sampling_method())
    }

    fn window(&self) -> Option<MotionWindow> {
        delegate!(self, network => network.window())
    }

    fn device(&self) -> Device {
        delegate!(self, network => network.device())
    }

    fn encode(&self, tokens: &TokenBatch) -> Prompt<AnyContext> {
        match self {
            AnyNetwork::MotionDiffuse(network) => {
                any_prompt(network.encode(tokens), AnyContext::MotionDiffuse)
            }
            AnyNetwork::Mdm(network) => any_prompt(network.encode(tokens), |context| {
                AnyContext::Mdm(Box::new(context))
            }),
        }
    }

    fn unconditional(
        &self,
        prompts: &Prompt<AnyContext>,
        wordless: &TokenBatch,
    ) -> Prompt<AnyContext> {
        match self {
            AnyNetwork::MotionDiffuse(_) => self.encode(wordless),
            AnyNetwork::Mdm(network) => {
                let prompts = Prompt {
                    embedding: prompts.embedding.clone(),
                    context: prompts.context.mdm().clone(),
                };
                any_prompt(network.unconditional(&prompts, wordless), |context| {
                    AnyContext::Mdm(Box::new(context))
                })
            }
        }
    }

    fn text_scales(&self, scale: f64) -> Vec<f32> {
        delegate!(self, network => network.text_scales(scale))
    }

    fn with_prefix(&self, context: AnyContext, prefix: Tensor<3>) -> AnyContext {
        match (self, context) {
            (AnyNetwork::Mdm(network), AnyContext::Mdm(context)) => {
                AnyContext::Mdm(Box::new(network.with_prefix(*context, prefix)))
            }
            (_, context) => context,
        }
    }

    fn embed_timesteps(&self, timesteps: &[usize]) -> Tensor<2> {
        delegate!(self, network => network.embed_timesteps(timesteps))
    }

    fn embed_laban(&self, means: &[[Option<f32>; LABAN_FEATURES]]) -> Option<Tensor<2>> {
        delegate!(self, network => network.embed_laban(means))
    }

    fn denoise(&self, input: DenoiserInput, context: &AnyContext) -> Tensor<3> {
        match self {
            AnyNetwork::MotionDiffuse(network) => network.denoise(input, context.motion_diffuse()),
            AnyNetwork::Mdm(network) => network.denoise(input, context.mdm()),
        }
    }

    fn denoise_with_unconditional(
        &self,
        input: DenoiserInput,
        context: &AnyContext,
        unconditional: &Prompt<AnyContext>,
    ) -> [Tensor<3>; 2] {
        match self {
            AnyNetwork::MotionDiffuse(_) => {
                let without_text = input.without_text(unconditional);
                [
                    self.denoise(input, context),
                    self.denoise(without_text, &unconditional.context),
                ]
            }
            AnyNetwork::Mdm(network) => {
                let unconditional = Prompt {
                    embedding: unconditional.embedding.clone(),
                    context: unconditional.context.mdm().clone(),
                };
                network.denoise_with_unconditional(input, context.mdm(), &unconditional)
            }
        }
    }

    fn linearize<'a>(
        &'a self,
        input: DenoiserInput,
        context: &'a AnyContext,
    ) -> LinearizedEvaluation<'a> {
        match self {
            AnyNetwork::MotionDiffuse(network) => {
                network.linearize(input, context.motion_diffuse())
            }
            AnyNetwork::Mdm(network) => network.linearize(input, context.mdm()),
        }
    }

    fn modulation_width(&self) -> usize {
        delegate!(self, network => network.modulation_width())
    }

    fn token_offset_width(&self) -> usize {
        delegate!(self, network => network.token_offset_width())
    }

    fn linearize_motion<'a>(
        &'a self,
        input: DenoiserInput,
        context: &'a AnyContext,
    ) -> LinearizedEvaluation<'a, 3> {
        match self {
            AnyNetwork::MotionDiffuse(network) => {
                network.linearize_motion(input, context.motion_diffuse())
            }
            AnyNetwork::Mdm(network) => network.linearize_motion(input, context.mdm()),
        }
    }
}
