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
use crate::denoiser::{Denoiser, DenoiserInput, Prompt};
#[cfg(feature = "flex")]
use crate::training::loss_gradient;
use crate::training::{TrainableDenoiser, TrainingBatch, TrainingGradients};

impl TrainableDenoiser for MotionDiffuse {
    /// On the CPU, the kernels compute the decoder and its gradient.
    fn gradients(
        &self,
        batch: TrainingBatch,
        loss: impl FnOnce(Tensor<3>) -> Tensor<1>,
    ) -> TrainingGradients {
        assert!(
            self.device().is_autodiff(),
            "expected a network that autodiff follows"
        );
        let sentences = batch.sentences.as_ref().map(|similarity| {
            let features = self.sentence_features(similarity.tokens.clone().autodiff());
            let loss = similarity.loss(features);
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
        TrainingGradients::by_autodiff(loss, (sentence_loss, sentences), self)
    }

    fn predict(&self, batch: TrainingBatch) -> Tensor<3> {
        let (input, context) = self.prepare(batch);
        self.denoise(input, &context)
    }
}

impl MotionDiffuse {
    /// Prepares the input and context of the decoder. Each caption is encoded once for all motions that share it.
    fn prepare(&self, batch: TrainingBatch) -> (DenoiserInput, CrossAttentionContext) {
        let prompt = select_prompts(self.encode_ids(batch.tokens), &batch.captions);
        let laban = { batch.laban }.and_then(|means| self.embed_laban(&means));
        let input = DenoiserInput {
            x_t: batch.x_t,
            time: self.embed_timesteps(&batch.timesteps),
            timesteps: batch.timesteps,
            embedding: match laban {
                Some(laban) => prompt.embedding + laban,
                None => prompt.embedding,
            },
            modulation: None,
            mask: batch.mask,
        };
        (input, prompt.context)
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
            timesteps: input.timesteps.clone(),
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
