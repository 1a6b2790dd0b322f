//! MDM, the whole network.

use std::collections::HashMap;
use std::path::Path;

use burn::module::Module;
use burn::nn::{Linear, LinearConfig};
#[cfg(feature = "flex")]
use burn::optim::GradientsParams;
use burn::tensor::activation::silu;
use burn::tensor::{Device, Tensor, TensorData};

use super::attention::rowwise;
use super::conditioning::OffsetLayout;
use super::config::{MdmArchitecture, MdmConfig};
#[cfg(feature = "flex")]
use super::cpu::CpuEvaluation;
use super::layer::{Layer, Memory};
use super::positions::position_rows;
use super::text::{MdmText, TextFeatures};
use crate::checkpoint::{Checkpoint, CheckpointError, NamedParameters, ParameterList, Precision};
use crate::config::Prediction;
use crate::denoiser::{Denoiser, DenoiserInput, FrameMask, LinearizedEvaluation, Prompt};
use crate::diffusion::{MotionWindow, NoiseSchedule, SamplingMethod};
#[cfg(feature = "flex")]
use crate::network::cpu::{self, SharedFloats};
use crate::tokens::TokenBatch;

/// MDM (Tevet et al. 2023) with its text encoder. It predicts the clean motion.
#[derive(Module, Debug)]
pub struct Mdm {
    text: MdmText,
    embed_text: Linear,
    time_expand: Linear,
    time_mix: Linear,
    pose_embedding: Linear,
    layers: Vec<Layer>,
    output: Linear,
    #[module(skip)]
    config: MdmConfig,
    /// The sinusoids of all positions, row by row.
    #[module(skip)]
    positions: Vec<f32>,
}

/// What MDM needs of prompts beside their embeddings.
#[derive(Clone, Debug)]
pub struct MdmContext {
    /// The number of tokens of the text of each prompt, with padding.
    pub(super) tokens: usize,
    /// A large number for tokens that are padding, else 0, `[batch, 1, 1, tokens]`.
    pub(super) penalty: Option<Tensor<4>>,
    /// The normalised frames before the window, `[batch, frames, features]`.
    prefix: Option<Tensor<3>>,
}

/// The length of the shortest motion, in frames: that of HumanML3D's shortest clips.
const MIN_FRAMES: usize = 40;

/// The length of the longest motion of a network that continues motions, in frames: twenty minutes.
const MAX_CONTINUED_FRAMES: usize = 24_000;

impl Mdm {
    /// Creates a network with random weights and a given text encoder.
    ///
    /// # Panics
    ///
    /// If the features of the text encoder do not have the config's `text_width`.
    pub fn new(config: &MdmConfig, text: MdmText, device: &Device) -> Self {
        assert_eq!(
            config.text_width,
            text.width(),
            "the text encoder must have features of the config's width"
        );
        let latent = config.latent_dim;
        let linear = |input, output| LinearConfig::new(input, output).init(device);
        Mdm {
            text,
            embed_text: linear(config.text_width, latent),
            time_expand: linear(latent, latent),
            time_mix: linear(latent, latent),
            pose_embedding: linear(config.features, latent),
            layers: (0..config.layers)
                .map(|_| Layer::new(config, device))
                .collect(),
            output: linear(latent, config.features),
            positions: position_rows(0..config.position_rows(), latent),
            config: config.clone(),
        }
    }

    /// Creates the network with the weights of a checkpoint (see [`MdmConfig::open_weights`]).
    ///
    /// # Errors
    ///
    /// If a tensor is missing, has another shape, or cannot be read, or if the checkpoint has a tensor that a network of
    /// these sizes does not have.
    ///
    /// # Panics
    ///
    /// If the features of the text encoder do not have the config's `text_width`.
    pub fn load(
        weights: &Checkpoint,
        config: &MdmConfig,
        text: MdmText,
        device: &Device,
    ) -> Result<Self, CheckpointError> {
        let mut network = Mdm::new(config, text, device);
        weights.fill(&mut network, device)?;
        Ok(network)
    }

    /// Writes the weights as safetensors, under the keys of the public checkpoints. The text encoder is not among them
    /// (see [`MdmText::save`]).
    ///
    /// `metadata` is free text that is stored with the weights, such as `license`. The file is written whole or not at all.
    ///
    /// # Errors
    ///
    /// If the file cannot be written, or if a weight is beyond the range of 16 bits and `precision` requires 16 bits.
    pub fn save(
        &self,
        path: impl AsRef<Path>,
        precision: Precision,
        metadata: HashMap<String, String>,
    ) -> Result<(), CheckpointError> {
        Checkpoint::write(self, path, precision, metadata)
    }

    /// Returns the sizes and the training of the network.
    pub fn config(&self) -> &MdmConfig {
        &self.config
    }

    /// Returns the text encoder.
    pub fn text(&self) -> &MdmText {
        &self.text
    }

    /// Embeds the features of texts, or zeros in their place. Returns `[batch, tokens · latent]`.
    pub(super) fn embed(&self, tokens: Tensor<3>) -> Tensor<2> {
        let [batch, count, _] = tokens.dims();
        let latent = self.config.latent_dim;
        rowwise(&self.embed_text, tokens).reshape([batch, count * latent])
    }

    /// Returns the first rows of the sinusoids, `[1, rows, latent]`.
    fn position_rows(&self, rows: usize) -> Tensor<3> {
        let latent = self.config.latent_dim;
        let data = TensorData::new(self.positions[..rows * latent].to_vec(), [1, rows, latent]);
        Tensor::from_data(data, &self.device())
    }

    /// Evaluates the network in tensor operations, on any device, with or without gradients.
    pub(super) fn forward(&self, input: DenoiserInput, context: &MdmContext) -> Tensor<3> {
        let layout = OffsetLayout::of(&self.config);
        let [_, frames, _] = input.x_t.dims();
        let tokens = context.conditioned_tokens(&input);
        let (motion, _) = context.with_prefix_frames(input.x_t);
        let motion = rowwise(&self.pose_embedding, motion);
        let (mut x, memory) = match self.config.arch {
            MdmArchitecture::Encoder => (Tensor::cat(vec![tokens, motion], 1), None),
            MdmArchitecture::Decoder => (motion, Some(tokens)),
        };
        let rows = x.dims()[1];
        x = x + self.position_rows(rows);
        let penalty = row_penalty(&input.mask, rows - frames);
        for (index, layer) in self.layers.iter().enumerate() {
            let offsets = { input.modulation.as_ref() }.map(|all| layout.layer(all, index));
            let (norms, token) = offsets
                .map(|offsets| (offsets.norms, offsets.token))
                .unzip();
            let memory = memory.clone().map(|tokens| Memory {
                tokens: match &token {
                    Some(token) => tokens + token.clone(),
                    None => tokens,
                },
                penalty: context.penalty.clone(),
            });
            if let (None, Some(token)) = (&memory, token) {
                let first = x.clone().narrow(1, 0, 1) + token;
                x = Tensor::cat(vec![first, x.narrow(1, 1, rows - 1)], 1);
            }
            let norms = norms.unwrap_or_default();
            x = layer.forward(x, penalty.clone(), memory.as_ref(), norms);
        }
        rowwise(&self.output, x.narrow(1, rows - frames, frames))
    }
}

impl MdmContext {
    /// Creates the context of texts of equally many tokens, without a prefix.
    pub(super) fn of_tokens(tokens: usize) -> Self {
        MdmContext {
            tokens,
            penalty: None,
            prefix: None,
        }
    }

    /// Returns the tokens of sentence and timestep, `[batch, tokens, latent]`.
    pub(super) fn conditioned_tokens(&self, input: &DenoiserInput) -> Tensor<3> {
        let [batch, all] = input.embedding.dims();
        let tokens = input.embedding.clone();
        let tokens = tokens.reshape([batch, self.tokens, all / self.tokens]);
        tokens + input.time.clone().unsqueeze_dim::<3>(1)
    }

    /// Returns a motion after the frames of the prefix, and the number of these.
    pub(super) fn with_prefix_frames(&self, motion: Tensor<3>) -> (Tensor<3>, usize) {
        match &self.prefix {
            None => (motion, 0),
            Some(prefix) => {
                let [_, frames, _] = prefix.dims();
                (Tensor::cat(vec![prefix.clone(), motion], 1), frames)
            }
        }
    }
}

#[cfg(feature = "flex")]
impl Mdm {
    /// Prepares an evaluation by vectorised kernels. Returns `None` if not all tensors lie in the CPU's memory.
    fn cpu_evaluation(
        &self,
        input: &DenoiserInput,
        context: &MdmContext,
    ) -> Option<CpuEvaluation<'_>> {
        CpuEvaluation::new(|| self.to_kernel(), &self.positions, input, context)
    }

    /// Returns the sinusoids of all positions, row by row.
    pub(super) fn positions(&self) -> &[f32] {
        &self.positions
    }

    /// Returns the network as kernels, or `None` if not all weights lie in the CPU's memory.
    pub(super) fn to_kernel(&self) -> Option<lamogen_cpu::Transformer<SharedFloats>> {
        let layers = self.layers.iter().map(Layer::to_kernel);
        Some(lamogen_cpu::Transformer {
            heads: self.config.heads,
            pose_embedding: cpu::linear_kernel(&self.pose_embedding)?,
            layers: layers.collect::<Option<_>>()?,
            output: cpu::linear_kernel(&self.output)?,
        })
    }

    /// Adds the gradients of the layers that the kernels compute to `gradients`, under the ids of their parameters.
    pub(super) fn register_gradients(
        &self,
        gradient: lamogen_cpu::Transformer<Vec<f32>>,
        gradients: &mut GradientsParams,
    ) {
        cpu::register_linear_gradients(&self.pose_embedding, gradient.pose_embedding, gradients);
        for (layer, gradient) in self.layers.iter().zip(gradient.layers) {
            layer.register_gradients(gradient, gradients);
        }
        cpu::register_linear_gradients(&self.output, gradient.output, gradients);
    }
}

/// Returns what is subtracted from the scores of frames past the end of a motion, `[batch, 1, 1, rows]`. `before` rows that
/// are no frames of the motion come first.
fn row_penalty(mask: &FrameMask, before: usize) -> Option<Tensor<4>> {
    let penalty = mask.padding()?.penalty.clone();
    let [batch, frames, _] = penalty.dims();
    let penalty = penalty.reshape([batch, 1, 1, frames]);
    let none = Tensor::zeros([batch, 1, 1, before], &penalty.device());
    Some(Tensor::cat(vec![none, penalty], 3))
}

impl Denoiser for Mdm {
    type Context = MdmContext;

    fn prediction(&self) -> Prediction {
        Prediction::Sample
    }

    fn pose_features(&self) -> usize {
        self.config.features
    }

    fn max_frames(&self) -> usize {
        match self.config.window {
            Some(_) => MAX_CONTINUED_FRAMES,
            None => self.config.frames(),
        }
    }

    fn min_frames(&self) -> usize {
        MIN_FRAMES
    }

    fn noise_schedule(&self) -> NoiseSchedule {
        self.config.noise_schedule
    }

    fn sampling_method(&self) -> SamplingMethod {
        SamplingMethod::Ddpm
    }

    fn window(&self) -> Option<MotionWindow> {
        self.config.window
    }

    fn device(&self) -> Device {
        self.output.weight.device()
    }

    fn encode(&self, tokens: &TokenBatch) -> Prompt<MdmContext> {
        let TextFeatures { tokens, penalty } = self.text.forward(tokens);
        let context = MdmContext {
            tokens: tokens.dims()[1],
            penalty,
            prefix: None,
        };
        Prompt {
            embedding: self.embed(tokens),
            context,
        }
    }

    /// Training dropped a text by zeros in the place of its features.
    fn unconditional(&self, prompts: &Prompt<MdmContext>, _: &TokenBatch) -> Prompt<MdmContext> {
        let batch = prompts.embedding.dims()[0];
        let shape = [batch, prompts.context.tokens, self.config.text_width];
        Prompt {
            embedding: self.embed(Tensor::zeros(shape, &prompts.embedding.device())),
            context: prompts.context.clone(),
        }
    }

    /// The public code has one scale for all features.
    fn text_scales(&self, scale: f64) -> Vec<f32> {
        vec![scale as f32; self.config.features]
    }

    fn with_prefix(&self, context: MdmContext, prefix: Tensor<3>) -> MdmContext {
        MdmContext {
            prefix: Some(prefix),
            ..context
        }
    }

    fn embed_timesteps(&self, timesteps: &[usize]) -> Tensor<2> {
        let latent = self.config.latent_dim;
        let rows = position_rows(timesteps.iter().copied(), latent);
        let rows = TensorData::new(rows, [timesteps.len(), latent]);
        let hidden = Tensor::from_data(rows, &self.device());
        self.time_mix
            .forward(silu(self.time_expand.forward(hidden)))
    }

    fn denoise(&self, input: DenoiserInput, context: &MdmContext) -> Tensor<3> {
        #[cfg(feature = "flex")]
        if let Some(evaluation) = self.cpu_evaluation(&input, context) {
            return evaluation.run();
        }
        self.forward(input, context)
    }

    fn linearize<'a>(
        &'a self,
        input: DenoiserInput,
        context: &'a MdmContext,
    ) -> LinearizedEvaluation<'a> {
        #[cfg(feature = "flex")]
        if let Some(evaluation) = self.cpu_evaluation(&input, context) {
            let (output, tape) = evaluation.record();
            return LinearizedEvaluation::new(output, move |gradient| {
                evaluation.backward(&tape, gradient)
            });
        }
        LinearizedEvaluation::by_autodiff(input, |input| self.forward(input, context))
    }

    /// Both evaluations are one batch.
    fn denoise_with_unconditional(
        &self,
        input: DenoiserInput,
        context: &MdmContext,
        unconditional: &Prompt<MdmContext>,
    ) -> [Tensor<3>; 2] {
        let [batch, frames, _] = input.x_t.dims();
        let device = input.x_t.device();
        let twice = |x: Tensor<3>| Tensor::cat(vec![x.clone(), x], 0);
        let (timesteps, time) = match input.time.dims()[0] {
            1 => (input.timesteps, input.time),
            _ => (
                input.timesteps.repeat(2),
                Tensor::cat(vec![input.time.clone(), input.time], 0),
            ),
        };
        let penalty = { context.penalty.clone() }
            .map(|penalty| Tensor::cat(vec![penalty.clone(), penalty], 0));
        let both = DenoiserInput {
            x_t: twice(input.x_t),
            timesteps,
            time,
            embedding: Tensor::cat(vec![input.embedding, unconditional.embedding.clone()], 0),
            modulation: input.modulation.map(|modulation| {
                let zeros = modulation.zeros_like();
                Tensor::cat(vec![modulation, zeros], 0)
            }),
            mask: FrameMask::new(&input.mask.lengths().repeat(2), frames, &device),
        };
        let context = MdmContext {
            tokens: context.tokens,
            penalty,
            prefix: context.prefix.clone().map(twice),
        };
        let output = self.denoise(both, &context);
        [0, batch].map(|start| output.clone().narrow(0, start, batch))
    }

    fn modulation_width(&self) -> usize {
        OffsetLayout::of(&self.config).norm_width()
    }

    fn token_offset_width(&self) -> usize {
        OffsetLayout::of(&self.config).token_width()
    }
}

impl NamedParameters for Mdm {
    fn keys(&mut self, keys: &mut ParameterList) {
        keys.linear("embed_text", &mut self.embed_text);
        keys.linear("embed_timestep.time_embed.0", &mut self.time_expand);
        keys.linear("embed_timestep.time_embed.2", &mut self.time_mix);
        keys.linear("input_process.poseEmbedding", &mut self.pose_embedding);
        keys.each(self.config.layers_key(), &mut self.layers);
        keys.linear("output_process.poseFinal", &mut self.output);
    }
}
