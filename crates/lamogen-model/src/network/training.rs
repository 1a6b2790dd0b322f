//! The gradients of all weights, for training.
//!
//! On the CPU, the kernels of `lamogen-cpu` compute the decoder and its gradient. Autodiff tracks only the text encoder, the
//! timestep embedding and the contexts of the attention to the text:
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
use super::cpu::{self, CpuEvaluation};
use super::cross_attention::CrossAttentionContext;
use super::motion_diffuse::MotionDiffuse;
use crate::config::LABAN_FEATURES;
use crate::denoiser::{Denoiser, DenoiserInput, FrameMask, Prompt};

/// The batch of one training step. None of its tensors is tracked by autodiff.
#[derive(Clone, Debug)]
pub struct TrainingBatch {
    /// The token ids of captions, `[captions, tokens]`. The end token is the largest id of each row.
    pub tokens: Tensor<2, Int>,
    /// The index of the caption of each motion. A caption that several motions share is encoded only once.
    pub captions: Vec<usize>,
    /// The noisy motions, normalised, `[batch, frames, features]`.
    pub x_t: Tensor<3>,
    /// The timestep of each motion.
    pub timesteps: Vec<usize>,
    /// The mask of the frames that are part of each motion.
    pub mask: FrameMask,
    /// The means over time of each motion's Laban features, as far as they are given (see [`Denoiser::embed_laban`]). `None`
    /// if no features are given for any motion.
    pub laban: Option<Vec<[Option<f32>; LABAN_FEATURES]>>,
    /// The sentences with similarities that the text encoder also learns.
    pub sentences: Option<SentenceSimilarity>,
}

/// Sentences and the similarity of each pair of them.
///
/// A text encoder learns these similarities from a larger encoder (relational knowledge distillation, Park et al. 2019).
#[derive(Clone, Debug)]
pub struct SentenceSimilarity {
    /// The token ids, `[sentences, tokens]`. The end token is the largest id of each row.
    pub tokens: Tensor<2, Int>,
    /// The cosine similarities of all pairs of sentences in the larger encoder, `[sentences, sentences]`.
    pub cosines: Tensor<2>,
    /// The weight of the loss, which is the mean squared difference of the cosines over all pairs.
    pub weight: f64,
}

/// The result of one training step.
#[derive(Debug)]
pub struct TrainingGradients {
    /// The value of the loss function, not tracked by autodiff.
    pub loss: Tensor<1>,
    /// The mean squared difference of the sentences' cosines, before it is multiplied by its weight, not tracked by autodiff.
    /// `None` if the batch has no sentences.
    pub sentence_loss: Option<Tensor<1>>,
    /// The gradient of the loss with respect to each weight.
    pub gradients: GradientsParams,
}

impl MotionDiffuse {
    /// Computes the gradients of a loss of the network's output with respect to all weights.
    ///
    /// `loss` receives the output, `[batch, frames, features]`, tracked by autodiff, and returns one number. The output past
    /// a motion's length has no meaning and must not influence the loss.
    ///
    /// On the CPU (`flex`), the results do not depend on the number of threads.
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
        if let Some(evaluation) = self.untracked_cpu_evaluation(&input, &context) {
            let (output, tape) = evaluation.record_for_training();
            let (loss, gradient) = loss_gradient(output, loss);
            let gradients = evaluation.gradients(tape, gradient);
            return TrainingGradients {
                loss,
                sentence_loss,
                gradients: self.all_gradients(input, &context, sentences, gradients),
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

    /// Computes the network's output for a batch, `[batch, frames, features]`, without gradients.
    ///
    /// # Panics
    ///
    /// If a token or timestep is out of range, or sizes differ.
    pub fn predict(&self, batch: TrainingBatch) -> Tensor<3> {
        let (input, context) = self.prepare(batch);
        self.denoise(input, &context)
    }

    /// Prepares the input and context of the decoder. Each caption is encoded once for all motions that share it.
    fn prepare(&self, batch: TrainingBatch) -> (DenoiserInput, CrossAttentionContext) {
        let prompt = select_prompts(self.encode_ids(batch.tokens), &batch.captions);
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

    /// Computes the mean squared difference, over all pairs of sentences, between the cosines of this text encoder and the
    /// given ones.
    fn sentence_loss(&self, similarity: &SentenceSimilarity) -> Tensor<1> {
        let sentences = self.sentence_features(similarity.tokens.clone().autodiff());
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
    /// Prepares an evaluation by the CPU's kernels, without autodiff. Returns `None` if not all tensors lie in the CPU's
    /// memory.
    fn untracked_cpu_evaluation(
        &self,
        input: &DenoiserInput,
        context: &CrossAttentionContext,
    ) -> Option<CpuEvaluation> {
        let input = DenoiserInput {
            x_t: input.x_t.clone().inner(),
            time: input.time.clone().inner(),
            embedding: input.embedding.clone().inner(),
            modulation: None,
            mask: input.mask.clone(),
        };
        let context = context.0.iter().map(|text| text.clone().inner());
        let context = CrossAttentionContext(context.collect());
        CpuEvaluation::new(|| self.valid().to_kernel(), &input, &context)
    }

    /// Computes the gradients of all weights from the gradients of the decoder and of its inputs.
    fn all_gradients(
        &self,
        input: DenoiserInput,
        context: &CrossAttentionContext,
        sentences: Option<Tensor<1>>,
        decoder_gradients: lamogen_cpu::DecoderGradients,
    ) -> GradientsParams {
        let condition = input.time + input.embedding;
        let gradient = cpu::tensor(decoder_gradients.condition, condition.dims());
        // A surrogate loss: its gradient with respect to the decoder's inputs is the given one.
        let mut surrogate = (condition * gradient).sum();
        for (text, gradient) in context.0.iter().zip(decoder_gradients.text) {
            let gradient = cpu::tensor(gradient, text.dims());
            surrogate = surrogate + (text.clone() * gradient).sum();
        }
        if let Some(sentences) = sentences {
            surrogate = surrogate + sentences;
        }
        let mut gradients = GradientsParams::from_grads(surrogate.backward(), self);
        self.register_gradients(decoder_gradients.weights, &mut gradients);
        gradients
    }
}

/// Selects the encoded caption of each motion.
fn select_prompts(
    prompt: Prompt<CrossAttentionContext>,
    captions: &[usize],
) -> Prompt<CrossAttentionContext> {
    if captions.iter().copied().eq(0..prompt.embedding.dims()[0]) {
        return prompt;
    }
    let rows: Vec<i32> = captions.iter().map(|&caption| caption as i32).collect();
    let rows = Tensor::<1, Int>::from_data(&rows[..], &prompt.embedding.device());
    let texts = prompt.context.0.into_iter();
    let texts = texts.map(|text| text.select(0, rows.clone()));
    Prompt {
        context: CrossAttentionContext(texts.collect()),
        embedding: prompt.embedding.select(0, rows),
    }
}

/// Computes a loss of an output and the gradient of the loss.
#[cfg(feature = "flex")]
fn loss_gradient(
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
