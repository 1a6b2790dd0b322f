//! MotionDiffuse, the whole network.

use burn::module::{Initializer, Module, Param};
use burn::nn::{Linear, LinearConfig};
#[cfg(feature = "flex")]
use burn::optim::GradientsParams;
use burn::tensor::{Device, Int, Tensor};

use super::block::{DecoderBlock, STYLIZATIONS};
#[cfg(feature = "flex")]
use super::cpu::{self, CpuEvaluation, SharedFloats};
use super::cross_attention::CrossAttentionContext;
#[cfg(feature = "flex")]
use super::kept_modulations::KeptModulations;
use super::laban_embedding::LabanEmbedding;
use super::modulation::ModulationProjection;
use super::text_encoder::TextEncoder;
use super::time_embedding::TimeEmbedding;
use crate::checkpoint::{NamedParameters, ParameterList};
use crate::config::{LABAN_FEATURES, ModelConfig, Prediction};
use crate::denoiser::{Denoiser, DenoiserInput, LinearizedEvaluation, Prompt};
use crate::tokens::TokenBatch;

/// MotionDiffuse (Zhang et al. 2022, arXiv 2208.15001): a transformer decoder over frames with
/// efficient attention, steered by stylization layers, with its text encoder.
#[derive(Module, Debug)]
pub struct MotionDiffuse {
    text: TextEncoder,
    time: TimeEmbedding,
    pose_embedding: Linear,
    frame_embedding: Param<Tensor<2>>,
    modulations: ModulationProjection,
    blocks: Vec<DecoderBlock>,
    output: Linear,
    laban: Option<LabanEmbedding>,
    #[module(skip)]
    config: ModelConfig,
    #[cfg(feature = "flex")]
    #[module(skip)]
    kept_modulations: KeptModulations,
}

impl MotionDiffuse {
    /// Creates a network with random weights.
    ///
    /// # Panics
    ///
    /// If the sizes do not form a valid network (see [`ModelConfig::problem`]).
    pub fn new(config: &ModelConfig, device: &Device) -> Self {
        if let Some(problem) = config.problem() {
            panic!("{problem}");
        }
        let (latent, condition) = (config.latent_dim, config.condition_dim());
        let layers = config.num_layers * STYLIZATIONS.len();
        let standard = Initializer::Normal {
            mean: 0.0,
            std: 1.0,
        };
        MotionDiffuse {
            text: TextEncoder::new(config, device),
            time: TimeEmbedding::new(latent, condition, device),
            pose_embedding: LinearConfig::new(config.input_feats, latent).init(device),
            frame_embedding: standard.init([config.num_frames, latent], device),
            modulations: ModulationProjection::new(layers, latent, condition, device),
            blocks: (0..config.num_layers)
                .map(|_| DecoderBlock::new(config, device))
                .collect(),
            output: LinearConfig::new(latent, config.input_feats).init(device),
            laban: LabanEmbedding::new(config, device),
            config: config.clone(),
            #[cfg(feature = "flex")]
            kept_modulations: KeptModulations::default(),
        }
    }

    /// Returns the sizes of the network.
    pub fn config(&self) -> &ModelConfig {
        &self.config
    }

    /// Adds decoder blocks at the end, up to `layers` in all, for a training that goes on with a larger network. The new blocks have the weights of
    /// [`initial`](MotionDiffuse::initial), whose output is zero, so that the network computes exactly what it computed before.
    ///
    /// # Panics
    ///
    /// If the network has more layers already.
    pub fn with_layers(self, layers: usize, seed: u64) -> Self {
        let own = self.config.num_layers;
        assert!(
            own <= layers,
            "expected at least {own} layers, found {layers}"
        );
        if own == layers {
            return self;
        }
        let config = ModelConfig {
            num_layers: layers,
            ..self.config.clone()
        };
        let fresh = MotionDiffuse::initial(&config, seed, &self.device());
        let modulations = self.modulations.extended(fresh.modulations);
        let mut blocks = self.blocks;
        blocks.extend(fresh.blocks.into_iter().skip(own));
        MotionDiffuse {
            modulations,
            blocks,
            config,
            ..self
        }
    }

    /// Runs the text encoder alone. Returns the sentence embedding and the token features.
    ///
    /// # Shapes
    ///
    /// - `tokens`: `[batch, tokens]`, the end token being the largest id
    /// - sentence embedding: `[batch, d_condition]`
    /// - token features: `[batch, tokens, text_latent_dim]`
    ///
    /// # Panics
    ///
    /// If an id is beyond the vocabulary or there are more tokens than the context holds.
    pub fn encode_text(&self, tokens: Tensor<2, Int>) -> (Tensor<2>, Tensor<3>) {
        let features = self.text.forward(tokens.clone());
        (self.text.project(&features, tokens), features)
    }

    /// Encodes prompts. The end token is the largest id of each row.
    pub(super) fn encode_ids(&self, tokens: Tensor<2, Int>) -> Prompt<CrossAttentionContext> {
        let (embedding, text) = self.encode_text(tokens);
        let context = self
            .blocks
            .iter()
            .map(|block| block.cross_attention.context(text.clone()))
            .collect();
        Prompt {
            embedding,
            context: CrossAttentionContext(context),
        }
    }

    /// Computes the text features of each sentence's end token, from which the sentence embedding is computed:
    /// `[batch, text_latent_dim]`.
    pub(super) fn sentence_features(&self, tokens: Tensor<2, Int>) -> Tensor<2> {
        let features = self.text.forward(tokens.clone());
        TextEncoder::sentence_features(&features, tokens)
    }
}

impl Denoiser for MotionDiffuse {
    type Context = CrossAttentionContext;

    fn prediction(&self) -> Prediction {
        self.config.prediction
    }

    fn pose_features(&self) -> usize {
        self.config.input_feats
    }

    fn max_frames(&self) -> usize {
        self.config.num_frames
    }

    fn min_frames(&self) -> usize {
        self.config.shortest()
    }

    fn device(&self) -> Device {
        self.output.weight.device()
    }

    fn encode(&self, tokens: &TokenBatch) -> Prompt<CrossAttentionContext> {
        self.encode_ids(tokens.ids.clone())
    }

    fn embed_timesteps(&self, timesteps: &[usize]) -> Tensor<2> {
        self.time.forward(timesteps)
    }

    fn embed_laban(&self, means: &[[Option<f32>; LABAN_FEATURES]]) -> Option<Tensor<2>> {
        let embedding = self.laban.as_ref()?;
        Some(embedding.forward(means))
    }

    fn denoise(&self, input: DenoiserInput, context: &CrossAttentionContext) -> Tensor<3> {
        #[cfg(feature = "flex")]
        if let Some(evaluation) = self.cpu_evaluation(&input, context) {
            return evaluation.run();
        }
        self.forward(input, context)
    }

    fn linearize<'a>(
        &'a self,
        input: DenoiserInput,
        context: &'a CrossAttentionContext,
    ) -> LinearizedEvaluation<'a> {
        #[cfg(feature = "flex")]
        if let Some(evaluation) = self.cpu_evaluation(&input, context) {
            let (output, tape) = evaluation.record();
            return LinearizedEvaluation::new(output, move |gradient| {
                evaluation.backward(tape, gradient)
            });
        }
        LinearizedEvaluation::by_autodiff(input, |input| self.forward(input, context))
    }

    fn modulation_width(&self) -> usize {
        self.modulations.width()
    }

    fn linearize_motion<'a>(
        &'a self,
        input: DenoiserInput,
        context: &'a CrossAttentionContext,
    ) -> LinearizedEvaluation<'a, 3> {
        #[cfg(feature = "flex")]
        if let Some(evaluation) = self.cpu_evaluation(&input, context) {
            let (output, tape) = evaluation.record_for_training();
            return LinearizedEvaluation::new(output, move |gradient| {
                evaluation.backward_to_motion(tape, gradient)
            });
        }
        LinearizedEvaluation::of_motion_by_autodiff(input, |input| self.forward(input, context))
    }
}

impl MotionDiffuse {
    /// Evaluates the network in tensor operations, on any device, with or without gradients.
    pub(super) fn forward(
        &self,
        input: DenoiserInput,
        context: &CrossAttentionContext,
    ) -> Tensor<3> {
        let [_, frames, _] = input.x_t.dims();
        let condition = input.time + input.embedding;
        let mut modulations = self.modulations.forward(condition, input.modulation);
        let positions = self.frame_embedding.val().narrow(0, 0, frames);
        let mut x = self.pose_embedding.forward(input.x_t) + positions.unsqueeze();
        for (block, context) in self.blocks.iter().zip(&context.0) {
            let modulations = std::array::from_fn(|_| {
                modulations
                    .next()
                    .expect("one modulation a stylization layer")
            });
            x = block.forward(x, context.clone(), &input.mask, modulations);
        }
        self.output.forward(x)
    }

    /// Prepares an evaluation by vectorised kernels. Returns `None` if not all tensors lie in the CPU's memory.
    #[cfg(feature = "flex")]
    fn cpu_evaluation(
        &self,
        input: &DenoiserInput,
        context: &CrossAttentionContext,
    ) -> Option<CpuEvaluation> {
        let evaluation = CpuEvaluation::new(|| self.to_kernel(), input, context)?;
        Some(evaluation.with_kept_modulations(&self.kept_modulations))
    }

    /// Adds the gradients of the decoder to `gradients`, under the ids of its parameters.
    #[cfg(feature = "flex")]
    pub(super) fn register_gradients(
        &self,
        gradient: lamogen_cpu::Decoder<Vec<f32>>,
        gradients: &mut GradientsParams,
    ) {
        cpu::register_linear_gradients(&self.pose_embedding, gradient.pose_embedding, gradients);
        let shape: [usize; 2] = self.frame_embedding.lazy_shape().dims();
        let frames = cpu::tensor(gradient.frame_embedding, shape);
        gradients.register(self.frame_embedding.id, frames);
        cpu::register_linear_gradients(&self.modulations.project, gradient.modulations, gradients);
        for (block, gradient) in self.blocks.iter().zip(gradient.blocks) {
            block.register_gradients(gradient, gradients);
        }
        cpu::register_linear_gradients(&self.output, gradient.output, gradients);
    }

    /// Returns the decoder as kernels, or `None` if not all weights lie in the CPU's memory.
    #[cfg(feature = "flex")]
    pub(super) fn to_kernel(&self) -> Option<lamogen_cpu::Decoder<SharedFloats>> {
        let blocks = self.blocks.iter().map(DecoderBlock::to_kernel);
        Some(lamogen_cpu::Decoder {
            heads: self.config.num_heads,
            pose_embedding: cpu::linear_kernel(&self.pose_embedding)?,
            frame_embedding: SharedFloats::from_tensor(self.frame_embedding.val())?,
            modulations: cpu::linear_kernel(&self.modulations.project)?,
            blocks: blocks.collect::<Option<_>>()?,
            output: cpu::linear_kernel(&self.output)?,
        })
    }
}

impl NamedParameters for MotionDiffuse {
    fn keys(&mut self, keys: &mut ParameterList) {
        keys.flat(&mut self.text);
        keys.nested("time_embed", &mut self.time);
        keys.linear("joint_embed", &mut self.pose_embedding);
        keys.matrix("sequence_embedding", &mut self.frame_embedding);
        let modulations: Vec<String> = (0..self.blocks.len())
            .flat_map(|block| {
                STYLIZATIONS.map(|layer| {
                    format!("temporal_decoder_blocks.{block}.{layer}.proj_out.emb_layers.1")
                })
            })
            .collect();
        keys.linear_from_parts(&modulations, &mut self.modulations.project);
        keys.each("temporal_decoder_blocks", &mut self.blocks);
        keys.linear("out", &mut self.output);
        if let Some(laban) = &mut self.laban {
            keys.nested("laban_embed", laban);
        }
    }
}
