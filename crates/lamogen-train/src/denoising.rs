//! Training a denoiser.

use std::collections::HashMap;
use std::path::Path;

use burn::module::Module;
use burn::tensor::{Device, Tensor, TensorData};
use lamogen_data::{Dataset, Split};
use lamogen_guide::{Preset, Schedule, TemporalSmoothing, feature_scales};
use lamogen_model::{
    ModelConfig, MotionDiffuse, Precision, Prediction, SamplingDefaults, TrainingBatch,
    TrainingGradients,
};
use lamogen_motion::Normalization;

use crate::batches::{Batches, Visit};
use crate::config::TrainingConfig;
use crate::error::TrainError;
use crate::example::Example;
use crate::identity::first_difference;
use crate::laban::TrainingLaban;
use crate::losses::Truth;
use crate::model_folder::{self, write};
use crate::optimization::OptimizerConfig;
use crate::sentences::Sentences;
use crate::task::{StepGradients, TrainingTask};
use crate::tokens::CaptionTokens;
use crate::validation::Validation;

/// A text-to-motion denoiser that learns from a data set's training split.
///
/// ```text
/// seed, step ──Batches──▶ visits ──Example──▶ noisy motions ──MotionDiffuse::gradients──▶ loss, gradients
/// ```
pub struct DenoisingTask<'a> {
    dataset: &'a Dataset,
    tokens: &'a CaptionTokens,
    config: TrainingConfig,
    laban: Option<TrainingLaban>,
    laban_is_measured: bool,
    sentences: Option<&'a Sentences>,
    batches: Batches,
    schedule: Schedule,
    normalization: Normalization,
    validation: Option<Validation<'a>>,
    device: Device,
    metadata: HashMap<String, String>,
    start: Option<MotionDiffuse>,
}

impl<'a> DenoisingTask<'a> {
    /// A task on a device.
    ///
    /// # Errors
    ///
    /// If the training split has no motion that the network is made for.
    pub fn new(
        dataset: &'a Dataset,
        tokens: &'a CaptionTokens,
        config: &'a TrainingConfig,
        device: &Device,
    ) -> Result<Self, TrainError> {
        let (clip, tokenizer) = (&config.model.clip, tokens.tokenizer());
        let found = (tokenizer.context_length(), tokenizer.vocab_size());
        if found.0 != clip.context_length || found.1 > clip.vocab_size {
            return Err(TrainError::Captions {
                expected: clip.context_length,
                vocabulary: clip.vocab_size,
                found: found.0,
                found_vocabulary: found.1,
            });
        }
        let lengths = config.model.shortest()..=config.model.num_frames;
        let seed = config.optimization.seed;
        let batches = Batches::new(dataset, &config.denoising, seed, lengths.clone());
        let batches = batches.ok_or_else(|| TrainError::NoMotions {
            split: Split::Train,
            shortest: *lengths.start(),
            longest: *lengths.end(),
        })?;
        let laban = (config.denoising.laban_share > 0.0)
            .then(|| TrainingLaban::measure(dataset, batches.entries(), device));
        let mut config = config.clone();
        let laban_is_measured = config.model.laban_condition.is_none();
        if let (Some(laban), true) = (&laban, laban_is_measured) {
            config.model.laban_condition = Some(laban.condition());
        }
        Ok(DenoisingTask {
            batches,
            laban,
            laban_is_measured,
            sentences: None,
            validation: Validation::new(dataset, tokens, Split::Validation, lengths, device),
            schedule: Schedule::linear(),
            normalization: dataset.normalization(device),
            device: device.clone(),
            metadata: HashMap::new(),
            start: None,
            dataset,
            tokens,
            config,
        })
    }

    /// Sets what travels with the weights in their file, such as `license` and `attribution`.
    pub fn with_metadata(self, metadata: HashMap<String, String>) -> Self {
        DenoisingTask { metadata, ..self }
    }

    /// Begins with the weights of this network instead of fresh ones. Its captions' tokens must be its own tokenizer's, and the data
    /// normalised by its statistics ([`Dataset::with_normalization`]).
    ///
    /// # Errors
    ///
    /// If its sizes or its prediction are not those of the config.
    pub fn with_start(mut self, network: MotionDiffuse) -> Result<Self, TrainError> {
        // Statistics that were only measured give way to those that the network learned with.
        if self.laban_is_measured {
            self.config.model.laban_condition = network.config().laban_condition;
        }
        // How it is sampled is no size.
        let sampling = network.config().sampling.clone();
        let sampling = self.config.model.sampling.take().or(sampling);
        let found = ModelConfig {
            sampling: None,
            ..network.config().clone()
        };
        if self.config.model != found {
            let [expected, found] = [&self.config.model, &found]
                .map(|config| serde_json::to_value(config).expect("sizes are JSON"));
            let (size, expected, found) =
                first_difference("", &expected, &found).expect("equal configs are equal JSON");
            return Err(TrainError::Sizes {
                expected: format!("{size} = {expected}"),
                found: format!("{size} = {found}"),
            });
        }
        self.config.model.sampling = sampling;
        Ok(DenoisingTask {
            start: Some(network),
            ..self
        })
    }

    /// Lets the text encoder compute_gradients from sentences as well, as the config's `sentences_per_batch` and `sentence_weight` say.
    pub fn with_sentences(self, sentences: &'a Sentences) -> Self {
        DenoisingTask {
            sentences: Some(sentences),
            ..self
        }
    }

    /// Sizes of the network, with the statistics of Laban features where it is told any.
    pub fn model(&self) -> &ModelConfig {
        &self.config.model
    }

    /// What the network is to make of noisy motions: the clean ones or, where it learns what classifier-free guidance makes of the network it
    /// began with, these with so much more of what the sentence adds.
    fn distilled(&self, truth: Truth, batch: &TrainingBatch, visits: &[Visit]) -> Truth {
        let scale = self.config.denoising.text_scale;
        let (true, Some(teacher)) = (scale != 1.0, &self.start) else {
            return truth;
        };
        let prediction = self.config.model.prediction;
        let unsaid = self.tokens.empty();
        let unsaid = TensorData::new(unsaid.to_vec(), [1, unsaid.len()]);
        let free = TrainingBatch {
            tokens: Tensor::from_data(unsaid, &self.device),
            captions: vec![0; visits.len()],
            ..batch.clone()
        };
        let clean = |batch: TrainingBatch| truth.clean_of(teacher.predict(batch), prediction);
        let added = clean(batch.clone()) - clean(free);
        // Nothing is added to what is learned of motions of which nothing is said.
        let said: Vec<f32> = { visits.iter() }
            .map(|visit| f32::from(u8::from(visit.caption.is_some())))
            .collect();
        let said =
            Tensor::<3>::from_data(TensorData::new(said, [visits.len(), 1, 1]), &self.device);
        let [_, _, features] = added.dims();
        let beyond: Tensor<3> = feature_scales(scale, features, &self.device) - 1.0;
        let clean = truth.clean.clone() + added * said * beyond;
        truth.with_clean(clean)
    }

    /// How many motions are trained on, mirrored ones included.
    pub fn motions(&self) -> usize {
        self.batches.motions()
    }
}

/// How a network that is trained here is best sampled, where its config says nothing else. One that is narrower than a pose needs the help of
/// neighbouring frames (docs/method.md, "Frames that agree").
fn usual_sampling(config: &ModelConfig) -> SamplingDefaults {
    let is_narrow = config.latent_dim < config.input_feats;
    SamplingDefaults {
        preset: Some(Preset::Precise.name().to_owned()),
        temporal_smoothing: is_narrow.then_some(TemporalSmoothing::default().frames),
        text_scale: None,
        stand_in: None,
    }
}

impl TrainingTask for DenoisingTask<'_> {
    type Network = MotionDiffuse;

    fn optimization(&self) -> &OptimizerConfig {
        &self.config.optimization
    }

    fn start(&self, device: &Device) -> MotionDiffuse {
        let fresh =
            || MotionDiffuse::initial(&self.config.model, self.config.optimization.seed, device);
        { self.start.clone() }.map_or_else(fresh, |network| network.to_device(device))
    }

    fn compute_gradients(&self, network: &MotionDiffuse, step: u64) -> StepGradients {
        let visits = self.batches.draw(step);
        let Example { mut batch, truth } = Example::new(
            self.dataset,
            self.tokens,
            self.laban.as_ref(),
            &self.schedule,
            &visits,
            &self.device,
        );
        let truth = self.distilled(truth, &batch, &visits);
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
            let prediction = self.config.model.prediction;
            let parts = losses.of(output, &truth, prediction, &self.normalization);
            loss = Some(parts.prediction.inner());
            parts.total
        });
        StepGradients {
            loss: loss.expect("gradients ask for the loss"),
            total_loss: match sentence_loss {
                Some(sentence_loss) => total_loss + sentence_loss * denoising.sentence_weight,
                None => total_loss,
            },
            gradients,
            motions: visits.len(),
            frames: visits.iter().map(|visit| visit.frames.len()).sum(),
        }
    }

    fn validate(&self, network: &MotionDiffuse) -> Option<f64> {
        let validation = self.validation.as_ref()?;
        Some(match self.config.model.prediction {
            // Where nearly all is noise, a small error of the noise is a clean motion thousands of times off, and would decide alone.
            Prediction::Epsilon => validation.prediction_loss(network),
            Prediction::Sample | Prediction::V => validation.loss(network),
        })
    }

    fn save(&self, network: &MotionDiffuse, folder: &Path) -> Result<(), TrainError> {
        let path = folder.join("model.safetensors");
        network.save(path, Precision::F32, self.metadata.clone())?;
        let mut config = self.config.model.clone();
        let usual = usual_sampling(&config);
        config.sampling.get_or_insert(usual);
        let config = serde_json::to_vec_pretty(&config).expect("sizes are JSON");
        write(&folder.join("config.json"), &config)?;
        write(
            &folder.join("words.txt"),
            self.tokens.words().to_lines().as_bytes(),
        )?;
        model_folder::write_common(folder, self.dataset, self.tokens)
    }
}
