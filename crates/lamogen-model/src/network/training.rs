//! The gradients of all weights, for training.
//!
//! On the CPU the decoder is left to the kernels of `lamogen-cpu`, and only text encoder, timestep embedding and the text's side of
//! the attention are followed by autodiff:
//!
//! ```text
//! tokens, timesteps ──autodiff──▶ condition, context ──kernels──▶ output ──autodiff──▶ loss
//!      their weights ◀──autodiff── their gradients ◀──kernels── gradient of the output
//!                            decoder's weights ◀──┘
//! ```

#[cfg(feature = "flex")]
use burn::module::Module;
use burn::optim::GradientsParams;
use burn::tensor::{Int, Tensor};

#[cfg(feature = "flex")]
use super::cpu::{self, Evaluation};
use super::cross_attention::CrossAttentionContext;
use super::motion_diffuse::MotionDiffuse;
use crate::config::LABAN_FEATURES;
use crate::denoiser::{Denoiser, DenoiserInput, FrameMask, Prompt};

/// What a step of training shows to the network. Nothing of it is tracked by autodiff.
#[derive(Clone, Debug)]
pub struct TrainingBatch {
    /// Token ids of captions, `[captions, tokens]`, the end token being the largest id of each row.
    pub tokens: Tensor<2, Int>,
    /// Which of the captions belongs to each motion; several motions may share one, which is then encoded once.
    pub captions: Vec<usize>,
    /// Noisy motions, normalised, `[batch, frames, features]`.
    pub x_t: Tensor<3>,
    /// The timestep of each motion.
    pub timesteps: Vec<usize>,
    /// Which frames are part of each motion.
    pub mask: FrameMask,
    /// The means over time of each motion's Laban features, where they are told (see [`Denoiser::embed_laban`]); `None` where nothing is told of
    /// any motion.
    pub laban: Option<Vec<[Option<f32>; LABAN_FEATURES]>>,
    /// What the text encoder learns beside the motions.
    pub sentences: Option<SentenceSimilarity>,
}

/// Sentences and how alike they are: what a text encoder learns from a larger one (relational knowledge distillation, Park et al. 2019).
#[derive(Clone, Debug)]
pub struct SentenceSimilarity {
    /// Token ids, `[sentences, tokens]`, the end token being the largest id of each row.
    pub tokens: Tensor<2, Int>,
    /// Cosine of the angle between each two of them, as the larger encoder has it, `[sentences, sentences]`.
    pub cosines: Tensor<2>,
    /// Weight of the loss: the mean squared difference of the cosines, over all pairs.
    pub weight: f64,
}

/// What a step of training finds.
#[derive(Debug)]
pub struct TrainingGradients {
    /// What the loss function returned, not tracked.
    pub loss: Tensor<1>,
    /// The mean squared difference of the sentences' cosines, without its weight, not tracked; none without sentences.
    pub sentence_loss: Option<Tensor<1>>,
    /// The gradient of the loss with respect to each weight.
    pub gradients: GradientsParams,
}

impl MotionDiffuse {
    /// The gradients of a loss of the network's output with respect to all weights. `loss` gets the output,
    /// `[batch, frames, features]`, tracked by autodiff, and returns one number; what stands in the output past a motion's length
    /// has no meaning and must not count.
    ///
    /// On the CPU (`flex`) results do not depend on the number of threads.
    ///
    /// # Panics
    ///
    /// If the network is not tracked (see `burn::module::Module::train`), a token or timestep is out of range, or sizes differ.
    pub fn gradients(
        &self,
        batch: TrainingBatch,
        loss: impl FnOnce(Tensor<3>) -> Tensor<1>,
    ) -> TrainingGradients {
        assert!(
            self.device().is_autodiff(),
            "expected a network that autodiff follows"
        );
        let sentences = batch.sentences.as_ref().map(|similarity| {
            let loss = self.sentence_loss(similarity);
            (loss.clone().inner(), loss * similarity.weight)
        });
        let (sentence_loss, sentences) = sentences.unzip();
        let (input, context) = self.prepare(TrainingBatch {
            tokens: batch.tokens.autodiff(),
            ..batch
        });
        #[cfg(feature = "flex")]
        if let Some(evaluation) = self.untracked(&input, &context) {
            let (output, tape) = evaluation.record_for_training();
            let (loss, gradient) = gradient_of(output, loss);
            let gradients = evaluation.gradients(tape, gradient);
            return TrainingGradients {
                loss,
                sentence_loss,
                gradients: self.gradients_before(input, &context, sentences, gradients),
            };
        }
        let loss = loss(self.forward(input, &context));
        let gradients = match sentences {
            Some(sentences) => (loss.clone() + sentences).backward(),
            None => loss.clone().backward(),
        };
        TrainingGradients {
            loss: loss.inner(),
            sentence_loss,
            gradients: GradientsParams::from_grads(gradients, self),
        }
    }

    /// The network's output for a batch, `[batch, frames, features]`, without gradients.
    ///
    /// # Panics
    ///
    /// If a token or timestep is out of range, or sizes differ.
    pub fn predict(&self, batch: TrainingBatch) -> Tensor<3> {
        let (input, context) = self.prepare(batch);
        self.denoise(input, &context)
    }

    /// Each caption encoded once, for all motions that share it.
    fn prepare(&self, batch: TrainingBatch) -> (DenoiserInput, CrossAttentionContext) {
        let prompt = shared(self.encode(batch.tokens), &batch.captions);
        let laban = { batch.laban }.and_then(|means| self.embed_laban(&means));
        let input = DenoiserInput {
            x_t: batch.x_t,
            time: self.embed_timesteps(&batch.timesteps),
            embedding: match laban {
                Some(laban) => prompt.embedding + laban,
                None => prompt.embedding,
            },
            modulation: None,
            mask: batch.mask,
        };
        (input, prompt.context)
    }

    /// The mean squared difference between the cosines of the encoder's sentences and given ones, over all pairs.
    fn sentence_loss(&self, similarity: &SentenceSimilarity) -> Tensor<1> {
        let sentences = self.sentences(similarity.tokens.clone().autodiff());
        let lengths = sentences.clone().square().sum_dim(1).sqrt();
        let sentences = sentences / lengths;
        let cosines = sentences.clone().matmul(sentences.transpose());
        (cosines - similarity.cosines.clone().autodiff())
            .square()
            .mean()
    }
}

#[cfg(feature = "flex")]
impl MotionDiffuse {
    /// The evaluation by the CPU's kernels, where all that it needs lies in the CPU's memory.
    fn untracked(
        &self,
        input: &DenoiserInput,
        context: &CrossAttentionContext,
    ) -> Option<Evaluation> {
        let input = DenoiserInput {
            x_t: input.x_t.clone().inner(),
            time: input.time.clone().inner(),
            embedding: input.embedding.clone().inner(),
            modulation: None,
            mask: input.mask.clone(),
        };
        let context = context.0.iter().map(|text| text.clone().inner());
        let context = CrossAttentionContext(context.collect());
        Evaluation::new(|| self.valid().cpu(), &input, &context)
    }

    /// The gradients of all weights from those of the decoder and of its inputs.
    fn gradients_before(
        &self,
        input: DenoiserInput,
        context: &CrossAttentionContext,
        sentences: Option<Tensor<1>>,
        found: lamogen_cpu::DecoderGradients,
    ) -> GradientsParams {
        let condition = input.time + input.embedding;
        let gradient = cpu::tensor(found.condition, condition.dims());
        let mut along = (condition * gradient).sum();
        for (text, gradient) in context.0.iter().zip(found.text) {
            let gradient = cpu::tensor(gradient, text.dims());
            along = along + (text.clone() * gradient).sum();
        }
        if let Some(sentences) = sentences {
            along = along + sentences;
        }
        let mut gradients = GradientsParams::from_grads(along.backward(), self);
        self.note(found.weights, &mut gradients);
        gradients
    }
}

/// The prompts of motions that share captions.
fn shared(
    prompt: Prompt<CrossAttentionContext>,
    captions: &[usize],
) -> Prompt<CrossAttentionContext> {
    if captions.iter().copied().eq(0..prompt.embedding.dims()[0]) {
        return prompt;
    }
    let places: Vec<i32> = captions.iter().map(|&caption| caption as i32).collect();
    let places = Tensor::<1, Int>::from_data(&places[..], &prompt.embedding.device());
    let texts = prompt.context.0.into_iter();
    let texts = texts.map(|text| text.select(0, places.clone()));
    Prompt {
        context: CrossAttentionContext(texts.collect()),
        embedding: prompt.embedding.select(0, places),
    }
}

/// A loss of an output, and its gradient.
#[cfg(feature = "flex")]
fn gradient_of(
    output: Tensor<3>,
    loss: impl FnOnce(Tensor<3>) -> Tensor<1>,
) -> (Tensor<1>, Tensor<3>) {
    let leaf = output.autodiff().require_grad();
    let loss = loss(leaf.clone());
    let gradient = leaf.grad_remove(&mut loss.clone().backward());
    // A loss that ignores the output has no gradient.
    let gradient = gradient.unwrap_or_else(|| leaf.inner().zeros_like());
    (loss.inner(), gradient)
}
