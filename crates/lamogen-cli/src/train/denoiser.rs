//! Training a denoiser.

use std::fs;
use std::path::Path;

use lamogen::model::{ClipTextConfig, Denoiser, Prediction};
use lamogen::{Device, FRAMES_PER_SECOND, LaMoGen, Request};
use lamogen_data::{Dataset, Split};
use lamogen_train::{
    AnyTrainingConfig, CaptionTokens, DenoisingTask, NetworkConfig, SentenceEmbeddings, TrainError,
    TrainingConfig, TrainingTask, fingerprint, identity,
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
    let training = Training {
        options,
        console,
        device,
        start: start.as_ref(),
    };
    match read_config(&options.config, training.start)? {
        AnyTrainingConfig::MotionDiffuse(config) => {
            let (width, features) = (config.model.latent_dim, config.model.input_feats);
            if config.model.prediction != Prediction::Sample && width < features {
                console.notice(format!(
                    "the network predicts noise in {features} features through {width} channels: what does not fit through \
                     cannot be learned; \"sample\" has no such limit"
                ));
            }
            training.train(&config, |task| match training.start {
                Some(start) => task.with_initial_network(start.network.clone()),
                None => Ok(task),
            })
        }
        AnyTrainingConfig::Mdm(config) => match &options.from {
            None => training.train(&config, |task| Ok(task)),
            Some(_) => Err(Failure::new(
                FailureCode::Usage,
                "--from is given, but the recipe trains an MDM: expected a recipe of the kind of network that the training begins with",
            )),
        },
    }
}

/// The training of a denoiser of any family.
struct Training<'a> {
    options: &'a TrainArguments,
    console: &'a Console,
    device: Device,
    start: Option<&'a StartModel>,
}

impl Training<'_> {
    /// Trains with a recipe. `begin` gives the task the network to begin with, if there is one.
    fn train<M: NetworkConfig>(
        &self,
        config: &TrainingConfig<M>,
        begin: impl for<'t> FnOnce(DenoisingTask<'t, M>) -> Result<DenoisingTask<'t, M>, TrainError>,
    ) -> Result<(), Failure> {
        let (options, console) = (self.options, self.console);
        if config.denoising.text_scale != 1.0 && self.start.is_none() {
            let message = "the recipe learns what classifier-free guidance makes of another network (denoising.text_scale): expected --from MODEL";
            return Err(Failure::new(FailureCode::Usage, message));
        }
        let dataset = open_dataset(options, config.model.lengths(), console)?;
        let dataset = match self.start {
            Some(start) => dataset.with_normalization(&start.normalization),
            None => dataset,
        };
        let tokens = self.caption_tokens(
            config.model.text_tower(),
            config.denoising.phrasings,
            &dataset,
        )?;
        let sentences = read_sentences(options, config.denoising.sentences_per_batch, &tokens)?;
        let licence = self.start.and_then(|start| start.licence.as_ref());
        let mut task = DenoisingTask::new(&dataset, &tokens, config, &self.device)?
            .with_metadata(metadata(options, licence));
        let mut identity = identity("denoiser", config, &dataset, &tokens);
        if let Some(sentences) = &sentences {
            task = task.with_sentences(sentences);
            identity["sentences"] = sentences.checksum().into();
        }
        task = begin(task)?;
        if let Some(start) = self.start {
            identity["from"] = fingerprint(&start.network).into();
        }
        let samples = match &options.sample[..] {
            [] => default_sample_sentences(&dataset),
            sentences => sentences.to_vec(),
        };
        let samples = SampleStrips {
            options,
            dataset: &dataset,
            tokens: &tokens,
            device: &self.device,
            sentences: samples,
        };
        samples.check(task.initial_network(&self.device))?;
        let draw_samples = |step, network: &M::Network| samples.draw(step, network);
        let counted_task = (&task, task.motions());
        let outcome = run_training(
            counted_task,
            &identity,
            &self.device,
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

    /// Encodes the captions for a text tower: by the tokenizer of the model that the training begins with, by the given
    /// one, or by a new one.
    fn caption_tokens(
        &self,
        tower: &ClipTextConfig,
        phrasings: usize,
        dataset: &Dataset,
    ) -> Result<CaptionTokens, Failure> {
        let options = self.options;
        let vocabulary = Vocabulary {
            size: tower.vocab_size,
            context_length: tower.context_length,
        };
        let tokenizer = match (self.start, &options.tokenizer) {
            (Some(start), _) => start.tokenizer.clone(),
            (None, path) => path.as_deref().map(read_file).transpose()?,
        };
        let texts =
            { options.sentences.as_deref() }.map(|path| read_text(&path.with_extension("txt")));
        let texts = texts.transpose()?.unwrap_or_default();
        caption_tokens(
            tokenizer,
            vocabulary,
            dataset,
            phrasings,
            &texts,
            self.console,
        )
    }
}

/// Reads the sentences that the text encoder learns from, if the recipe needs them.
fn read_sentences(
    options: &TrainArguments,
    count: usize,
    tokens: &CaptionTokens,
) -> Result<Option<SentenceEmbeddings>, Failure> {
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
fn read_config(path: &Path, start: Option<&StartModel>) -> Result<AnyTrainingConfig, Failure> {
    let sizes = start.map(|start| start.network.config());
    if path == "compact" {
        let recipe = TrainingConfig::compact();
        let model = sizes.cloned().unwrap_or(recipe.model);
        let recipe = TrainingConfig { model, ..recipe };
        return Ok(AnyTrainingConfig::MotionDiffuse(recipe));
    }
    Ok(AnyTrainingConfig::from_file(path)?)
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
    fn model<N: Denoiser>(&self, network: N) -> LaMoGen<N> {
        let normalization = self.dataset.normalization(self.device);
        LaMoGen::new(network, self.tokens.tokenizer().clone(), normalization)
    }

    /// Makes a request for each sentence.
    fn requests(&self, model: &LaMoGen<impl Denoiser>) -> Vec<Request> {
        const STEPS: usize = 50;
        const SECONDS: f32 = 4.0;
        let seconds = |frames: usize| frames as f32 / FRAMES_PER_SECOND;
        let network = model.network();
        let seconds = SECONDS.clamp(seconds(network.min_frames()), seconds(network.max_frames()));
        let steps = STEPS.min(network.noise_schedule().timesteps());
        let request = |sentence| Request::new(sentence).seconds(seconds).steps(steps);
        self.sentences.iter().map(request).collect()
    }

    /// Checks whether the network can generate the motions of all sentences. This is called before the first step.
    fn check(&self, network: impl Denoiser) -> Result<(), Failure> {
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
    fn draw(&self, step: u64, network: &(impl Denoiser + Clone)) -> Result<(), Failure> {
        const POSES: usize = 12;
        let model = self.model(network.clone());
        let requests = self.requests(&model);
        let motions = model.generate_all(&requests)?;
        let rows = self
            .sentences
            .iter()
            .zip(&motions)
            .map(|(label, generation)| LabelledMotion::new(label, &generation.guided));
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
