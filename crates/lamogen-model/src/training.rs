//! The interface through which a network is trained.

use burn::module::Module;
use burn::optim::GradientsParams;
use burn::tensor::{Int, Tensor};

use crate::config::LABAN_FEATURES;
use crate::denoiser::{Denoiser, FrameMask};

/// A denoiser whose weights can be trained.
pub trait TrainableDenoiser: Denoiser + Module {
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
    fn gradients(
        &self,
        batch: TrainingBatch,
        loss: impl FnOnce(Tensor<3>) -> Tensor<1>,
    ) -> TrainingGradients;

    /// Computes the network's output for a batch, `[batch, frames, features]`, without gradients.
    ///
    /// # Panics
    ///
    /// If a token or timestep is out of range, or sizes differ.
    fn predict(&self, batch: TrainingBatch) -> Tensor<3>;
}

/// The batch of one training step. None of its tensors is tracked by autodiff.
#[derive(Clone, Debug)]
pub struct TrainingBatch {
    /// The token ids of captions, `[captions, tokens]`. The end token is the largest id of each row.
    pub tokens: Tensor<2, Int>,
    /// The index of the caption of each motion. A caption that several motions share is encoded only once. The caption of a
    /// motion without text has no words.
    pub captions: Vec<usize>,
    /// Whether each motion is shown without text. A network that drops the text in another way than by a caption without
    /// words reads this.
    pub is_without_text: Vec<bool>,
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

impl TrainingGradients {
    /// Computes the gradients of a network's weights by autodiff. `sentences` are the loss of sentences, not tracked and not
    /// weighted, and the one that is added to `loss`.
    pub(crate) fn by_autodiff(
        loss: Tensor<1>,
        (sentence_loss, sentences): (Option<Tensor<1>>, Option<Tensor<1>>),
        network: &impl Module,
    ) -> TrainingGradients {
        let gradients = match sentences {
            Some(sentences) => (loss.clone() + sentences).backward(),
            None => loss.clone().backward(),
        };
        TrainingGradients {
            loss: loss.inner(),
            sentence_loss,
            gradients: GradientsParams::from_grads(gradients, network),
        }
    }
}

impl SentenceSimilarity {
    /// Computes the mean squared difference, over all pairs of sentences, between the cosines of a text encoder's features,
    /// `[sentences, width]`, and the given ones.
    pub(crate) fn loss(&self, features: Tensor<2>) -> Tensor<1> {
        let lengths = features.clone().square().sum_dim(1).sqrt();
        let features = features / lengths;
        let cosines = features.clone().matmul(features.transpose());
        (cosines - self.cosines.clone().autodiff()).square().mean()
    }
}

/// Computes a loss of an output and the gradient of the loss.
#[cfg(feature = "flex")]
pub(crate) fn loss_gradient(
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
