//! Training a denoiser.

use std::fs;
use std::path::Path;

use lamogen::model::{MotionDiffuse, Prediction};
use lamogen::{Device, FRAMES_PER_SECOND, LaMoGen, Request};
use lamogen_data::{Dataset, Split};
use lamogen_train::{
    CaptionTokens, DenoisingTask, Sentences, TrainingConfig, TrainingTask, fingerprint, identity,
};
use lamogen_view::{Row, save, strip};

use super::start::Start;
use super::{Vocabulary, ended, metadata, open, read, tokens, work};
use crate::arguments::Train;
use crate::console::Console;
use crate::failure::{Code, Failure};
use crate::source::device;

pub fn run(options: &Train, console: &Console) -> Result<(), Failure> {
    let device = device(options.device)?;
    let start = { options.from.as_deref() }.map(|folder| Start::open(folder, &device));
    let start = start.transpose()?;
    let config = config(&options.config, start.as_ref())?;
    let model = &config.model;
    if config.denoising.text_scale != 1.0 && start.is_none() {
        let message = "the recipe learns what classifier-free guidance makes of another network (denoising.text_scale): expected --from MODEL";
        return Err(Failure::new(Code::Usage, message));
    }
    if model.prediction != Prediction::Sample && model.latent_dim < model.input_feats {
        console.notice(format!(
            "the network predicts noise in {} features through {} channels: what does not fit through cannot be learned; \
             \"sample\" has no such limit",
            model.input_feats, model.latent_dim
        ));
    }
    let dataset = open(options, model.shortest()..=model.num_frames, console)?;
    let vocabulary = Vocabulary {
        size: model.clip.vocab_size,
        context_length: model.clip.context_length,
    };
    let dataset = match &start {
        Some(start) => dataset.with_normalization(start.model.normalization()),
        None => dataset,
    };
    let tokenizer = match (&start, &options.tokenizer) {
        (Some(start), _) => start.tokenizer.clone(),
        (None, path) => path.as_deref().map(read).transpose()?,
    };
    let texts = { options.sentences.as_deref() }.map(|path| read_text(&path.with_extension("txt")));
    let texts = texts.transpose()?.unwrap_or_default();
    let phrasings = config.denoising.phrasings;
    let tokens = tokens(tokenizer, vocabulary, &dataset, phrasings, &texts, console)?;
    let sentences = sentences(options, &config, &tokens)?;
    let licence = start.as_ref().and_then(|start| start.model.licence());
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
        let network = start.model.network();
        task = task.with_start(network.clone())?;
        identity["from"] = fingerprint(network).into();
    }
    let samples = match &options.sample[..] {
        [] => usual(&dataset),
        sentences => sentences.to_vec(),
    };
    let samples = Samples {
        options,
        dataset: &dataset,
        tokens: &tokens,
        device: &device,
        sentences: samples,
    };
    samples.check(task.start(&device))?;
    let look = |step, network: &_| samples.draw(step, network);
    let counted = (&task, task.motions());
    let result = work(counted, &identity, &device, look, options, console)?;
    let model = options.out.join("model");
    let hint = format!("lamogen generate \"…\" --model {}", super::quoted(&model));
    ended(options, &result, &hint, &[], console)
}

/// The sentences that the text encoder learns from, where the recipe asks for some.
fn sentences(
    options: &Train,
    config: &TrainingConfig,
    tokens: &CaptionTokens,
) -> Result<Option<Sentences>, Failure> {
    let count = config.denoising.sentences_per_batch;
    match (&options.sentences, count) {
        (None, 0) => Ok(None),
        (Some(path), 1..) => {
            let sentences = Sentences::read(path, tokens.tokenizer());
            Ok(Some(sentences.map_err(|error| Failure::new(Code::Input, error))?))
        }
        (None, _) => Err(Failure::new(
            Code::Usage,
            format!("the recipe learns from {count} sentences a step (denoising.sentences_per_batch): expected --sentences FILE.npy"),
        )
        .hint("`lamogen help sentences` says how such a file is made; 0 in a recipe of your own learns from captions alone")),
        (Some(_), _) => Err(Failure::new(
            Code::Usage,
            "--sentences is given, but the recipe learns from none: expected denoising.sentences_per_batch of 2 or above",
        )),
    }
}

fn read_text(path: &Path) -> Result<String, Failure> {
    fs::read_to_string(path)
        .map_err(|reason| Failure::new(Code::Input, format!("{}: {reason}", path.display())))
}

/// The recipe. One that comes with the program trains a network of any sizes; a file states them, and must state those of the
/// network to begin with.
fn config(path: &Path, start: Option<&Start>) -> Result<TrainingConfig, Failure> {
    let sizes = start.map(|start| start.model.config());
    if path == "compact" {
        let recipe = TrainingConfig::compact();
        let model = sizes.cloned().unwrap_or(recipe.model);
        return Ok(TrainingConfig { model, ..recipe });
    }
    Ok(TrainingConfig::from_file(path)?)
}

/// Strips of what the averaged network generates.
struct Samples<'a> {
    options: &'a Train,
    dataset: &'a Dataset,
    tokens: &'a CaptionTokens,
    device: &'a Device,
    sentences: Vec<String>,
}

impl Samples<'_> {
    fn model(&self, network: MotionDiffuse) -> LaMoGen {
        let normalization = self.dataset.normalization(self.device);
        LaMoGen::new(network, self.tokens.tokenizer().clone(), normalization)
    }

    fn requests(&self, model: &LaMoGen) -> Vec<Request> {
        const STEPS: usize = 50;
        const SECONDS: f32 = 4.0;
        let seconds = |frames: usize| frames as f32 / FRAMES_PER_SECOND;
        let config = model.config();
        let seconds = SECONDS.clamp(seconds(config.shortest()), seconds(config.num_frames));
        let request = |sentence| Request::new(sentence).seconds(seconds).steps(STEPS);
        self.sentences.iter().map(request).collect()
    }

    /// Whether the network will be able to draw all sentences: better asked before the first step.
    fn check(&self, network: MotionDiffuse) -> Result<(), Failure> {
        let model = self.model(network);
        let requests = self.requests(&model);
        for (sentence, request) in self.sentences.iter().zip(&requests) {
            model.check(request).map_err(|problem| {
                Failure::new(Code::Usage, format!("--sample {sentence:?}: {problem}"))
            })?;
        }
        Ok(())
    }

    fn draw(&self, step: u64, network: &MotionDiffuse) -> Result<(), Failure> {
        const POSES: usize = 12;
        let model = self.model(network.clone());
        let requests = self.requests(&model);
        let motions = model.generate_all(&requests)?;
        let rows = self
            .sentences
            .iter()
            .zip(&motions)
            .map(|(label, made)| Row {
                label,
                motion: &made.guided,
            });
        let rows: Vec<Row<'_>> = rows.collect();
        let folder = self.options.out.join("samples");
        fs::create_dir_all(&folder).map_err(|reason| Failure::output(&folder, reason))?;
        let path = folder.join(format!("step-{step:08}.svg"));
        save(&path, &strip(&rows, POSES)).map_err(|error| Failure::new(Code::Output, error))
    }
}

/// First captions of motions that were not trained on, of as many contents as can be shown.
fn usual(dataset: &Dataset) -> Vec<String> {
    const SHOWN: usize = 8;
    let mut contents: Vec<Option<&str>> = Vec::new();
    let unseen = dataset
        .split(Split::Validation)
        .chain(dataset.split(Split::Test))
        .chain(dataset.split(Split::Train));
    let new = unseen.filter(|entry| {
        let content = entry.content.as_deref();
        let is_new = content.is_none() || !contents.contains(&content);
        contents.push(content);
        is_new
    });
    new.take(SHOWN)
        .map(|entry| entry.captions[0].text.clone())
        .collect()
}
