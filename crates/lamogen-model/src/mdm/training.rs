//! The initial weights of MDM, and the gradients of all weights, for training.
//!
//! On the CPU, the kernels of `lamogen-cpu` compute the layers of the frames and their gradients. Autodiff tracks only the
//! text encoder and the timestep embedding.

#[cfg(feature = "flex")]
use burn::module::Module;
use burn::optim::GradientsParams;
use burn::tensor::{Device, Int, Tensor, TensorData};

use super::config::MdmConfig;
#[cfg(feature = "flex")]
use super::cpu::CpuEvaluation;
use super::network::{Mdm, MdmContext};
use super::text::MdmText;
use crate::denoiser::{Denoiser, DenoiserInput};
#[cfg(feature = "flex")]
use crate::network::cpu;
use crate::network::initialize;
use crate::tokens::TokenBatch;
#[cfg(feature = "flex")]
use crate::training::loss_gradient;
use crate::training::{TrainableDenoiser, TrainingBatch, TrainingGradients};

impl Mdm {
    /// Creates a network for training, with a text encoder whose weights are replaced too. All weights are drawn on the host,
    /// so that a seed gives the same network on every device.
    ///
    /// Linear layers are initialised as in PyTorch, but with biases of zero, and embeddings of tokens as in CLIP. The last
    /// layer starts at zero, so that the network predicts the mean pose at first.
    ///
    /// # Panics
    ///
    /// If the features of the text encoder do not have the config's `text_width`.
    pub fn initial(config: &MdmConfig, text: MdmText, seed: u64, device: &Device) -> Self {
        let network = Mdm::new(config, text, device);
        initialize(network, seed, |path, shape, draw| {
            let count = shape.iter().product();
            match *path {
                [.., "positional_embedding"] => draw.normal(0.01, count),
                [.., "token_embedding", "weight"] => draw.normal(0.02, count),
                ["output", "weight"] => vec![0.0; count],
                [.., "gamma"] => vec![1.0; count],
                [.., "weight"] => draw.uniform((shape[0] as f32).powf(-0.5), count),
                _ => vec![0.0; count],
            }
        })
    }

    /// Prepares the input and the context of the frames' layers. Each caption is encoded once for all motions that share it,
    /// and zeros take the place of the features of texts that are left out.
    fn prepare(&self, batch: TrainingBatch) -> (DenoiserInput, MdmContext) {
        let motions = batch.captions.len();
        let device = batch.x_t.device();
        let rows: Vec<i32> = { batch.captions.iter() }
            .map(|&caption| caption as i32)
            .collect();
        let rows = Tensor::<1, Int>::from_data(&rows[..], &batch.tokens.device());
        let keep: Vec<f32> = { batch.is_without_text.iter() }
            .map(|&is_without_text| f32::from(u8::from(!is_without_text)))
            .collect();
        let keep = Tensor::<3>::from_data(TensorData::new(keep, [motions, 1, 1]), &device);
        let features = self.text_features(batch.tokens).select(0, rows) * keep;
        let input = DenoiserInput {
            x_t: batch.x_t,
            time: self.embed_timesteps(&batch.timesteps),
            timesteps: batch.timesteps,
            modulation: None,
            mask: batch.mask,
            embedding: self.embed(features.clone()),
        };
        (input, MdmContext::of_tokens(features.dims()[1]))
    }

    /// Computes the features of captions, `[captions, tokens, width]`.
    fn text_features(&self, ids: Tensor<2, Int>) -> Tensor<3> {
        self.text().forward(&TokenBatch::from(ids)).tokens
    }
}

#[cfg(feature = "flex")]
impl Mdm {
    /// Prepares an evaluation by the CPU's kernels, without autodiff. Returns `None` if not all tensors lie in the CPU's
    /// memory.
    fn untracked_cpu_evaluation(
        &self,
        input: &DenoiserInput,
        context: &MdmContext,
    ) -> Option<CpuEvaluation<'_>> {
        let input = DenoiserInput {
            x_t: input.x_t.clone(),
            timesteps: input.timesteps.clone(),
            time: input.time.clone().inner(),
            embedding: input.embedding.clone().inner(),
            modulation: None,
            mask: input.mask.clone(),
        };
        CpuEvaluation::new(
            || self.valid().to_kernel(),
            self.positions(),
            &input,
            context,
        )
    }
}

/// The text encoder is trained with the network. It must be the text tower of a CLIP, which finds the end of a caption by its
/// ids.
impl TrainableDenoiser for Mdm {
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
            let features = self.text_features(similarity.tokens.clone().autodiff());
            let [sentences, tokens, width] = features.dims();
            let loss = similarity.loss(features.reshape([sentences, tokens * width]));
            (loss.clone().inner(), loss * similarity.weight)
        });
        let (sentence_loss, sentences) = sentences.unzip();
        let (input, context) = self.prepare(TrainingBatch {
            tokens: batch.tokens.autodiff(),
            ..batch
        });
        #[cfg(feature = "flex")]
        if let Some(evaluation) = self.untracked_cpu_evaluation(&input, &context) {
            let (output, tape) = evaluation.record();
            let (loss, gradient) = loss_gradient(output, loss);
            let computed = evaluation.gradients(&tape, gradient);
            let tokens = context.conditioned_tokens(&input);
            let gradient = cpu::tensor(computed.tokens, tokens.dims());
            // A surrogate loss: its gradient with respect to the tokens is the given one.
            let mut surrogate = (tokens * gradient).sum();
            if let Some(sentences) = sentences {
                surrogate = surrogate + sentences;
            }
            let mut gradients = GradientsParams::from_grads(surrogate.backward(), self);
            self.register_gradients(computed.weights, &mut gradients);
            return TrainingGradients {
                loss,
                sentence_loss,
                gradients,
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
