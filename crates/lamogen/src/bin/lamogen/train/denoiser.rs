//! Training a denoiser.

use std::fs;
use std::path::Path;

use lamogen::model::{MotionDiffuse, Prediction};
use lamogen::{Device, FRAMES_PER_SECOND, LaMoGen, Request};
use lamogen_data::{Dataset, Split};
use lamogen_train::{
    CaptionTokens, DenoisingTask, SentenceEmbeddings, TrainingConfig, TrainingTask, fingerprint,
    identity,
};
use lamogen_view::{LabelledMotion, save, strip};

use super::start::StartModel;
use super::{
    Vocabulary, caption_tokens, metadata, open_dataset, read_file, report_outcome, run_training,
};
use crate::arguments::TrainArguments;
use crate::console::Console;
use crate::failure::{Failure, FailureCode};
use crate::source::open_device;

/// Trains a denoiser.
pub fn run(options: &TrainArguments, console: &Console) -> Result<(), Failure> {
    let device = open_device(options.device)?;
    let start = { options.from.as_deref() }.map(|folder| StartModel::open(folder, &device));
    let start = start.transpose()?;
    let config = read_config(&options.config, start.as_ref())?;
    let model = &config.model;
    if config.denoising.text_scale != 1.0 && start.is_none() {
        let message = "the recipe learns what classifier-free guidance makes of another network (denoising.text_scale): expected --from MODEL";
        return Err(Failure::new(FailureCode::Usage, message));
    }
    if model.prediction != Prediction::Sample && model.latent_dim < model.input_feats {
        console.notice(format!(
            "the network predicts noise in {} features through {} channels: what does not fit through cannot be learned; \
             \"sample\" has no such limit",
            model.input_feats, model.latent_dim
        ));
    }
    let dataset = open_dataset(options, model.shortest()..=model.num_frames, console)?;
    let vocabulary = Vocabulary {
        size: model.clip.vocab_size,
        context_length: model.clip.context_length,
    };
    let dataset = match &start {
        Some(start) => dataset.with_normalization(&start.normalization),
        None => dataset,
    };
    let tokenizer = match (&start, &options.tokenizer) {
        (Some(start), _) => start.tokenizer.clone(),
        (None, path) => path.as_deref().map(read_file).transpose()?,
    };
    let texts = { options.sentences.as_deref() }.map(|path| read_text(&path.with_extension("txt")));
    let texts = texts.transpose()?.unwrap_or_default();
    let phrasings = config.denoising.phrasings;
    let tokens = caption_tokens(tokenizer, vocabulary, &dataset, phrasings, &texts, console)?;
    let sentences = read_sentences(options, &config, &tokens)?;
    let licence = start.as_ref().and_then(|start| start.licence.as_ref());
    let mut task = DenoisingTask::new(&dataset, &tokens, &config, &device)?
        .with_metadata(metadata(options, licence));
    if let Some(sentences) = &sentences {
        task = task.with_sentences(sentences);
    }
    let mut identity = identity("denoiser", &config, &dataset, &tokens);
    if let Some(sentences) = &sentences {
        identity["sentences"] = sentences.checksum().into();
    }
    if let Some(start) = &start {
        let network = &start.network;
        task = task.with_initial_network(network.clone())?;
        identity["from"] = fingerprint(network).into();
    }
    let samples = match &options.sample[..] {
        [] => default_sample_sentences(&dataset),
        sentences => sentences.to_vec(),
    };
    let samples = SampleStrips {
        options,
        dataset: &dataset,
        tokens: &tokens,
        device: &device,
        sentences: samples,
    };
    samples.check(task.initial_network(&device))?;
    let draw_samples = |step, network: &_| samples.draw(step, network);
    let counted_task = (&task, task.motions());
    let outcome = run_training(
        counted_task,
        &identity,
        &device,
        draw_samples,
        options,
        console,
    )?;
    let model = options.out.join("model");
    let hint = format!(
        "lamogen generate \"…\" --model {}",
        super::shell_quoted(&model)
    );
    report_outcome(options, &outcome, &hint, &[], console)
}

/// Reads the sentences that the text encoder learns from, if the recipe needs them.
fn read_sentences(
    options: &TrainArguments,
    config: &TrainingConfig,
    tokens: &CaptionTokens,
) -> Result<Option<SentenceEmbeddings>, Failure> {
    let count = config.denoising.sentences_per_batch;
    match (&options.sentences, count) {
        (None, 0) => Ok(None),
        (Some(path), 1..) => {
            let sentences = SentenceEmbeddings::read(path, tokens.tokenizer());
            Ok(Some(sentences.map_err(|error| Failure::new(FailureCode::Input, error))?))
        }
        (None, _) => Err(Failure::new(
            FailureCode::Usage,
            format!("the recipe learns from {count} sentences a step (denoising.sentences_per_batch): expected --sentences FILE.npy"),
        )
        .hint("`lamogen help sentences` says how such a file is made; 0 in a recipe of your own learns from captions alone")),
        (Some(_), _) => Err(Failure::new(
            FailureCode::Usage,
            "--sentences is given, but the recipe learns from none: expected denoising.sentences_per_batch of 2 or above",
        )),
    }
}

/// Reads a text file.
fn read_text(path: &Path) -> Result<String, Failure> {
    fs::read_to_string(path)
        .map_err(|reason| Failure::new(FailureCode::Input, format!("{}: {reason}", path.display())))
}

/// Reads the recipe. The recipe that comes with the program fits a start model of any size. A file states the sizes of
/// the network; they must be those of the start model, if there is one.
fn read_config(path: &Path, start: Option<&StartModel>) -> Result<TrainingConfig, Failure> {
    let sizes = start.map(|start| start.network.config());
    if path == "compact" {
        let recipe = TrainingConfig::compact();
        let model = sizes.cloned().unwrap_or(recipe.model);
        return Ok(TrainingConfig { model, ..recipe });
    }
    Ok(TrainingConfig::from_file(path)?)
}

/// Draws strips of motions that the network with averaged weights generates.
struct SampleStrips<'a> {
    options: &'a TrainArguments,
    dataset: &'a Dataset,
    tokens: &'a CaptionTokens,
    device: &'a Device,
    sentences: Vec<String>,
}

impl SampleStrips<'_> {
    /// Makes a model of the network.
    fn model(&self, network: MotionDiffuse) -> LaMoGen<MotionDiffuse> {
        let normalization = self.dataset.normalization(self.device);
        LaMoGen::new(network, self.tokens.tokenizer().clone(), normalization)
    }

    /// Makes a request for each sentence.
    fn requests(&self, model: &LaMoGen<MotionDiffuse>) -> Vec<Request> {
        const STEPS: usize = 50;
        const SECONDS: f32 = 4.0;
        let seconds = |frames: usize| frames as f32 / FRAMES_PER_SECOND;
        let config = model.network().config();
        let seconds = SECONDS.clamp(seconds(config.shortest()), seconds(config.num_frames));
        let request = |sentence| Request::new(sentence).seconds(seconds).steps(STEPS);
        self.sentences.iter().map(request).collect()
    }

    /// Checks whether the network can generate the motions of all sentences. This is called before the first step.
    fn check(&self, network: MotionDiffuse) -> Result<(), Failure> {
        let model = self.model(network);
        let requests = self.requests(&model);
        for (sentence, request) in self.sentences.iter().zip(&requests) {
            model.check(request).map_err(|problem| {
                Failure::new(
                    FailureCode::Usage,
                    format!("--sample {sentence:?}: {problem}"),
                )
            })?;
        }
        Ok(())
    }

    /// Draws the motions of all sentences in one picture.
    fn draw(&self, step: u64, network: &MotionDiffuse) -> Result<(), Failure> {
        const POSES: usize = 12;
        let model = self.model(network.clone());
        let requests = self.requests(&model);
        let motions = model.generate_all(&requests)?;
        let rows = self
            .sentences
            .iter()
            .zip(&motions)
            .map(|(label, generation)| LabelledMotion {
                label,
                motion: &generation.guided,
            });
        let rows: Vec<LabelledMotion<'_>> = rows.collect();
        let folder = self.options.out.join("samples");
        fs::create_dir_all(&folder).map_err(|reason| Failure::output(&folder, reason))?;
        let path = folder.join(format!("step-{step:08}.svg"));
        save(&path, &strip(&rows, POSES)).map_err(|error| Failure::new(FailureCode::Output, error))
    }
}

/// Returns the first captions of motions with different contents. Motions that are not trained on come first.
fn default_sample_sentences(dataset: &Dataset) -> Vec<String> {
    /// The number of sentences that a picture can show.
    const MAX_SENTENCES: usize = 8;
    let mut contents: Vec<Option<&str>> = Vec::new();
    let entries = dataset
        .split(Split::Validation)
        .chain(dataset.split(Split::Test))
        .chain(dataset.split(Split::Train));
    let entries = entries.filter(|entry| {
        let content = entry.content.as_deref();
        let is_new = content.is_none() || !contents.contains(&content);
        contents.push(content);
        is_new
    });
    entries
        .take(MAX_SENTENCES)
        .map(|entry| entry.captions[0].text.clone())
        .collect()
}
