//! Training of a denoiser.

use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use burn::module::Module;
use burn::tensor::{Device, Tensor, TensorData};
use lamogen_data::{Dataset, Split};
use lamogen_guide::{LossTerm, PreparedTerm, Schedule, feature_scales};
use lamogen_model::{
    ModelConfig, MotionDiffuse, Prediction, TrainableDenoiser, TrainingBatch, TrainingGradients,
};
use lamogen_motion::{Normalization, joints};

use crate::batches::{BatchItem, BatchSampler};
use crate::config::TrainingConfig;
use crate::error::TrainError;
use crate::example::DenoisingExamples;
use crate::identity::first_difference;
use crate::laban::LabanLabels;
use crate::losses::NoisyMotions;
use crate::model_folder::{write_file, write_statistics_and_tokenizer};
use crate::network_config::NetworkConfig;
use crate::optimization::OptimizerConfig;
use crate::sentences::SentenceEmbeddings;
use crate::task::{StepGradients, TrainingTask};
use crate::tokens::CaptionTokens;
use crate::validation::ValidationSet;

/// The training of a text-to-motion denoiser on the training split of a data set.
///
/// ```text
/// seed, step ──BatchSampler──▶ batch items ──DenoisingExamples──▶ noisy motions ──TrainableDenoiser::gradients──▶ loss, gradients
/// ```
pub struct DenoisingTask<'a, M: NetworkConfig = ModelConfig> {
    dataset: &'a Dataset,
    tokens: &'a CaptionTokens,
    config: TrainingConfig<M>,
    laban: Option<LabanLabels>,
    /// Whether the statistics of Laban features are those of this data set, and not those of the config.
    laban_is_measured: bool,
    sentences: Option<&'a SentenceEmbeddings>,
    batches: BatchSampler,
    schedule: Schedule,
    normalization: Normalization,
    validation: Option<ValidationSet<'a>>,
    device: Device,
    metadata: HashMap<String, String>,
    /// The network to begin with; `None` for random weights.
    start: Option<M::Network>,
    /// Further terms of the loss.
    loss_terms: Vec<Arc<dyn LossTerm>>,
}

impl<'a, M: NetworkConfig> DenoisingTask<'a, M> {
    /// Creates a task that computes on a device.
    ///
    /// # Errors
    ///
    /// If the captions were encoded for another network, or the training split has no motion that is long enough for the network.
    pub fn new(
        dataset: &'a Dataset,
        tokens: &'a CaptionTokens,
        config: &'a TrainingConfig<M>,
        device: &Device,
    ) -> Result<Self, TrainError> {
        let (clip, tokenizer) = (config.model.text_tower(), tokens.tokenizer());
        let found = (tokenizer.context_length(), tokenizer.vocab_size());
        if found.0 != clip.context_length || found.1 > clip.vocab_size {
            return Err(TrainError::Captions {
                expected: clip.context_length,
                vocabulary: clip.vocab_size,
                found: found.0,
                found_vocabulary: found.1,
            });
        }
        let (lengths, schedule) = (config.model.lengths(), config.model.noise_schedule());
        let batches = BatchSampler::new(
            dataset,
            &config.denoising,
            config.optimization.seed,
            lengths.clone(),
            schedule.timesteps(),
        );
        let batches = batches.ok_or_else(|| TrainError::NoMotions {
            split: Split::Train,
            shortest: *lengths.start(),
            longest: *lengths.end(),
        })?;
        let laban = (config.denoising.laban_share > 0.0)
            .then(|| LabanLabels::measure(dataset, batches.entries(), device));
        let mut config = config.clone();
        let condition = { config.model.laban_condition() }.filter(|known| known.is_none());
        let laban_is_measured = condition.is_some();
        if let Some(condition) = condition {
            *condition = laban.as_ref().map(LabanLabels::condition);
        }
        Ok(DenoisingTask {
            batches,
            laban,
            laban_is_measured,
            sentences: None,
            validation: ValidationSet::new(
                dataset,
                tokens,
                Split::Validation,
                lengths,
                schedule,
                device,
            ),
            schedule: Schedule::new(schedule),
            normalization: dataset.normalization(device),
            device: device.clone(),
            metadata: HashMap::new(),
            start: None,
            loss_terms: Vec::new(),
            dataset,
            tokens,
            config,
        })
    }

    /// Adds a term to the loss: the same trait that guidance takes terms by. It measures the clean motion that follows from the network's
    /// prediction; [`LossTerm::target`] gets the values of the motion of the data in the place of the baseline. The loss of the term is the sum over its
    /// values of `((measured - target) · weight)²`, as the mean over all frames; where the network predicts noise, it is weighted by `ᾱ` as the other
    /// losses of the clean motion are.
    ///
    /// The terms are not part of the config, so a run that is resumed needs the same ones again.
    ///
    /// # Errors
    ///
    /// If the term's values or its target are of the wrong shape or not finite on the motions of the first step.
    pub fn with_loss_term(mut self, term: Arc<dyn LossTerm>) -> Result<Self, TrainError> {
        let DenoisingExamples { motions, .. } = self.examples(&self.batches.draw(0));
        PreparedTerm::new(
            term.clone(),
            joints(self.normalization.denormalize(motions.clean)),
            motions.mask.lengths(),
            1.0,
        )?;
        self.loss_terms.push(term);
        Ok(self)
    }

    /// Returns the tensors of batch items.
    fn examples(&self, items: &[BatchItem]) -> DenoisingExamples {
        DenoisingExamples::new(
            self.dataset,
            self.tokens,
            self.laban.as_ref(),
            &self.schedule,
            items,
            &self.device,
        )
    }

    /// Computes the loss of the further terms for a network's output `[batch, frames, features]`.
    fn loss_of_terms(&self, output: Tensor<3>, motions: &NoisyMotions) -> Option<Tensor<1>> {
        if self.loss_terms.is_empty() {
            return None;
        }
        let lengths = motions.mask.lengths();
        let frames: usize = lengths.iter().sum();
        let prediction = self.config.model.prediction();
        let of = |features: Tensor<3>| joints(self.normalization.denormalize(features));
        let expected = of(motions.clean.clone());
        let found = of(motions.predicted_clean(output, prediction));
        let losses = self.loss_terms.iter().map(|term| {
            let prepared = PreparedTerm::new(term.clone(), expected.clone(), lengths, 1.0);
            // A target that is not finite makes a loss that is not, with which the run ends.
            let Ok(prepared) = prepared else {
                return Tensor::full([1], f32::NAN, &self.device);
            };
            let losses = prepared.loss(found.clone()).sum_dim(1);
            let losses = match prediction {
                Prediction::Sample | Prediction::V => losses,
                Prediction::Epsilon => losses * motions.alpha_cumprod.clone().squeeze_dim::<2>(2),
            };
            losses.sum() / frames as f64
        });
        losses.reduce(|all, loss| all + loss)
    }

    /// Sets the metadata in the file of the weights, such as `license` and `attribution`.
    pub fn with_metadata(self, metadata: HashMap<String, String>) -> Self {
        DenoisingTask { metadata, ..self }
    }

    /// Lets the text encoder also learn from sentences, by the config's `sentences_per_batch` and `sentence_weight`.
    pub fn with_sentences(self, sentences: &'a SentenceEmbeddings) -> Self {
        DenoisingTask {
            sentences: Some(sentences),
            ..self
        }
    }

    /// Returns the config of the network, with the statistics of Laban features if it has them as a condition.
    pub fn model(&self) -> &M {
        &self.config.model
    }

    /// Adds the effect of classifier-free guidance to the clean motions, if guidance is distilled.
    ///
    /// The effect is the difference of the clean motions that the network to begin with predicts with and without the sentence,
    /// times `text_scale` minus 1.
    fn add_guidance(
        &self,
        motions: NoisyMotions,
        batch: &TrainingBatch,
        items: &[BatchItem],
    ) -> NoisyMotions {
        let scale = self.config.denoising.text_scale;
        let (true, Some(teacher)) = (scale != 1.0, &self.start) else {
            return motions;
        };
        let prediction = self.config.model.prediction();
        let empty = self.tokens.empty();
        let empty = TensorData::new(empty.to_vec(), [1, empty.len()]);
        let without_text = TrainingBatch {
            tokens: Tensor::from_data(empty, &self.device),
            captions: vec![0; items.len()],
            is_without_text: vec![true; items.len()],
            ..batch.clone()
        };
        let clean =
            |batch: TrainingBatch| motions.predicted_clean(teacher.predict(batch), prediction);
        let effect = clean(batch.clone()) - clean(without_text);
        // Motions without a caption keep their target.
        let has_text: Vec<f32> = { items.iter() }
            .map(|item| f32::from(u8::from(item.caption.is_some())))
            .collect();
        let has_text = TensorData::new(has_text, [items.len(), 1, 1]);
        let has_text = Tensor::<3>::from_data(has_text, &self.device);
        let [_, _, features] = effect.dims();
        let excess: Tensor<3> = feature_scales(scale, features, &self.device) - 1.0;
        let clean = motions.clean.clone() + effect * has_text * excess;
        motions.with_clean(clean)
    }

    /// Returns the number of training motions, mirrored ones included.
    pub fn motions(&self) -> usize {
        self.batches.motions()
    }
}

impl DenoisingTask<'_> {
    /// Begins with the weights of this network instead of random ones. The captions must be encoded by the network's tokenizer, and
    /// the data normalised by its statistics ([`Dataset::with_normalization`]). If the config has more layers, blocks are added that compute nothing
    /// at first ([`MotionDiffuse::with_layers`]).
    ///
    /// # Errors
    ///
    /// If the other sizes or the prediction of the network are not those of the config.
    pub fn with_initial_network(mut self, network: MotionDiffuse) -> Result<Self, TrainError> {
        // The statistics with which the network was trained replace those that were measured here.
        if self.laban_is_measured {
            self.config.model.laban_condition = network.config().laban_condition;
        }
        // The sampling defaults are not compared, since they are not sizes.
        let sampling = network.config().sampling.clone();
        let sampling = self.config.model.sampling.take().or(sampling);
        let layers = self.config.model.num_layers;
        let network = match network.config().num_layers < layers {
            true => network.with_layers(layers, self.config.optimization.seed),
            false => network,
        };
        let found = ModelConfig {
            sampling: None,
            ..network.config().clone()
        };
        if self.config.model != found {
            let [expected, found] = [&self.config.model, &found]
                .map(|config| serde_json::to_value(config).expect("sizes are JSON"));
            let (path, expected, found) =
                first_difference("", &expected, &found).expect("equal configs are equal JSON");
            return Err(TrainError::Sizes {
                expected: format!("{path} = {expected}"),
                found: format!("{path} = {found}"),
            });
        }
        self.config.model.sampling = sampling;
        Ok(DenoisingTask {
            start: Some(network),
            ..self
        })
    }
}

impl<M: NetworkConfig> TrainingTask for DenoisingTask<'_, M> {
    type Network = M::Network;

    fn optimization(&self) -> &OptimizerConfig {
        &self.config.optimization
    }

    fn initial_network(&self, device: &Device) -> M::Network {
        let seed = self.config.optimization.seed;
        let initial = || self.config.model.initial_network(seed, device);
        { self.start.clone() }.map_or_else(initial, |network| network.to_device(device))
    }

    fn compute_gradients(&self, network: &M::Network, step: u64) -> StepGradients {
        let items = self.batches.draw(step);
        let DenoisingExamples { mut batch, motions } = self.examples(&items);
        let motions = self.add_guidance(motions, &batch, &items);
        let denoising = &self.config.denoising;
        let count = denoising.sentences_per_batch;
        batch.sentences = { self.sentences }.filter(|_| count > 0).map(|sentences| {
            sentences.draw(
                self.config.optimization.seed,
                step,
                count,
                denoising.sentence_weight,
                &self.device,
            )
        });
        let mut loss = None;
        let TrainingGradients {
            loss: total_loss,
            sentence_loss,
            gradients,
        } = network.gradients(batch, |output| {
            let losses = &self.config.denoising.losses;
            let prediction = self.config.model.prediction();
            let values = losses.evaluate(output.clone(), &motions, prediction, &self.normalization);
            loss = Some(values.prediction.inner());
            match self.loss_of_terms(output, &motions) {
                Some(terms) => values.total + terms,
                None => values.total,
            }
        });
        StepGradients {
            loss: loss.expect("gradients ask for the loss"),
            total_loss: match sentence_loss {
                Some(sentence_loss) => total_loss + sentence_loss * denoising.sentence_weight,
                None => total_loss,
            },
            gradients,
            motions: items.len(),
            frames: items.iter().map(|item| item.frames.len()).sum(),
        }
    }

    fn validate(&self, network: &M::Network) -> Option<f64> {
        let validation = self.validation.as_ref()?;
        Some(match self.config.model.prediction() {
            // At timesteps that are nearly all noise, a small error of the predicted noise is an error of the clean motion
            // thousands of times as large, and would dominate the mean.
            Prediction::Epsilon => validation.prediction_loss(network),
            Prediction::Sample | Prediction::V => validation.loss(network),
        })
    }

    fn save(&self, network: &M::Network, folder: &Path) -> Result<(), TrainError> {
        let TrainingConfig {
            model, denoising, ..
        } = &self.config;
        model.save(network, denoising, folder, &self.metadata)?;
        write_file(
            &folder.join("words.txt"),
            self.tokens.words().to_lines().as_bytes(),
        )?;
        write_statistics_and_tokenizer(folder, self.dataset, self.tokens)
    }
}
