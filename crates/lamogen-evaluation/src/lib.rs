//! The paper's evaluation of a model: methods, tags and studies over the sentences of a data set, measured on what users get.
//!
//! ```text
//! options ──plan.rs──▶ planned motions ──runner.rs──▶ records (a line each) ──summary.rs──▶ figures ─┬─report.rs──▶ report.md, report.html
//!                       measure.rs: on a BVH ─┘                       side_effects.rs ─┘ pictures.rs ──┘
//! ```
//!
//! `lamogen eval` is [`evaluate`] with the command's options. A program calls it for any [`Denoiser`]:
//!
//! ```no_run
//! use lamogen_evaluation::{EvaluatedModel, EvaluationOptions, accepted_lengths, evaluate};
//! use lamogen::{Device, LaMoGen};
//! use lamogen_data::{Dataset, LoadOptions};
//! use lamogen_eval::Evaluator;
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let device = Device::flex();
//! let model = LaMoGen::embedded(&device)?; // or LaMoGen::new(network, tokenizer, normalization)
//! let evaluator = Evaluator::load("judge/best", &device)?;
//! let lengths = accepted_lengths(model.network(), &evaluator);
//! let limits = LoadOptions { min_frames: *lengths.start(), ..LoadOptions::default() };
//! let dataset = Dataset::open("data", &limits, &mut |_| ())?;
//! let model = EvaluatedModel { model: &model, name: "my network", fingerprint: "weights of today".into() };
//! let options = EvaluationOptions { prompts: Some(64), ..EvaluationOptions::default() };
//! let evaluation = evaluate(&model, &evaluator, &dataset, "evidence".as_ref(), &options, &mut ())?;
//! println!("{} motions, {} missing, {:?}", evaluation.motions, evaluation.missing, evaluation.files);
//! # Ok(())
//! # }
//! ```

mod document;
mod error;
mod judge;
mod measure;
mod paper;
mod pictures;
mod plan;
mod record;
mod report;
mod runner;
mod side_effects;
mod summary;

use std::collections::HashMap;
use std::fmt::Display;
use std::fs;
use std::io::{ErrorKind, Write};
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::time::Instant;

use burn::tensor::Device;
use lamogen_data::{BenchmarkClip, BenchmarkSplit, Checksum, Dataset, Entry, Split};
use lamogen_eval::protocol::{Protocol, PublicEvaluator, Replication};
use lamogen_eval::{Embeddings, Evaluator, RetrievalBatches};
use lamogen_guide::Preset;
use lamogen_model::Denoiser;
use lamogen_motion::{remove_stale_temporaries, write_atomically};
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha12Rng;
use serde_json::{Value, json};

pub use error::{EvaluationError, EvaluationErrorKind};
use judge::{MotionEvaluator, ScoreBasis, ScoreSource};
use lamogen::LaMoGen;
use lamogen::Motion;
pub use measure::MeasurementTarget;
use plan::{EvalPlan, EvalPrompt, Multimodality, PlanDefaults, PlannedMotion, PromptSelection};
pub use plan::{Method, Study};
use record::{BodyMeasurements, MotionOutcome, RecordFile, RecordKey, read_records};
use runner::{EvalRunner, evaluation_failure};
use summary::EvalData;

/// The number of motions that are generated and evaluated together.
const BATCH_SIZE: usize = 8;
/// The most sets of real motions of other sentences, and the most motions of all these sets, but for one.
const OTHER_SETS: usize = 10;
const OTHER_MOTIONS: usize = 2000;

/// What an evaluation generates and measures. The default is all of the paper's tables and lamogen's own studies.
#[derive(Clone, Debug)]
pub struct EvaluationOptions {
    /// The split of the data set whose sentences are used.
    pub split: Split,
    /// How many of its sentences, at least 2; `None` for all. R-precision needs 32.
    pub prompts: Option<usize>,
    /// The number of motions for each sentence, from as many seeds; 95 % intervals are over these.
    pub repeats: u64,
    /// The preset of all settings; `None` for the model's own.
    pub preset: Option<Preset>,
    /// The number of DDIM steps of each pass; `None` for those of the preset.
    pub steps: Option<usize>,
    /// The number of DDIM steps of the method that moves the start noise: each of its updates is a pass.
    pub noise_steps: usize,
    /// The methods that are compared with the text alone.
    pub methods: Vec<Method>,
    /// What is varied.
    pub studies: Vec<Study>,
    /// The form of the motions that is measured.
    pub measure: MeasurementTarget,
    /// The number of sentences of each study, at least 2.
    pub study_prompts: usize,
    /// The part of the work to do: the first number, from 1, of the second; `None` for all of it.
    pub shard: Option<(usize, usize)>,
    /// Whether to generate nothing that is missing, and to write the report of the records in the folder.
    pub merge: bool,
    /// The motions of MultiModality, with the public evaluator only; `None` leaves it out.
    pub multimodality: Option<MultimodalityOptions>,
}

/// The motions of MultiModality. The default is that of the public evaluation: 30 for each of 100 texts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MultimodalityOptions {
    /// The number of texts; of fewer sentences, all of them.
    pub texts: usize,
    /// The number of motions of each text, at least 2. Distances are of 10 drawn pairs; of 10 motions and fewer, of all pairs.
    pub motions: u64,
}

impl Default for MultimodalityOptions {
    fn default() -> Self {
        MultimodalityOptions {
            texts: Protocol::MULTIMODALITY_TEXTS,
            motions: Protocol::MULTIMODALITY_MOTIONS as u64,
        }
    }
}

impl Default for EvaluationOptions {
    fn default() -> Self {
        EvaluationOptions {
            split: Split::Test,
            prompts: None,
            repeats: 1,
            preset: None,
            steps: None,
            noise_steps: 10,
            methods: Method::RIVALS.to_vec(),
            studies: Study::ALL.to_vec(),
            measure: MeasurementTarget::Rig,
            study_prompts: 64,
            shard: None,
            merge: false,
            multimodality: Some(MultimodalityOptions::default()),
        }
    }
}

/// The lengths in frames that the public evaluation draws, of motions of 40 to 199 frames.
pub const PUBLIC_LENGTHS: RangeInclusive<usize> = 36..=196;

/// The public evaluation of HumanML3D: the published evaluator and a split of the data set ([`lamogen_eval::protocol`]).
#[derive(Clone, Copy)]
pub struct PublicBenchmark<'a> {
    /// The evaluator. Without one, what needs no evaluator is computed; without its words, what needs no texts.
    pub evaluator: Option<&'a PublicEvaluator>,
    /// The motions with their captions.
    pub split: &'a BenchmarkSplit,
}

/// A model to evaluate.
#[derive(Clone)]
pub struct EvaluatedModel<'a, D> {
    /// The model, with the preset, temporal smoothing and text scale that it is sampled with.
    pub model: &'a LaMoGen<D>,
    /// What the report calls it.
    pub name: &'a str,
    /// A text that is another one for other weights (`lamogen_train::fingerprint` makes one of a module's): records of other weights are refused.
    pub fingerprint: String,
}

/// Sees an evaluation while it runs.
pub trait EvaluationObserver {
    /// Gets a notice for people, such as that the data set has fewer sentences than were asked for.
    fn notice(&mut self, text: &str) {
        let _ = text;
    }

    /// Gets the number of motions that were generated in this call, that of all to generate, and the name of the current setting.
    fn progress(&mut self, done: usize, total: usize, setting: &str) {
        let _ = (done, total, setting);
    }
}

impl EvaluationObserver for () {}

/// The result of an evaluation.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Evaluation {
    /// The number of motions of the plan.
    pub motions: usize,
    /// How many of them have no record yet: they are for other shards.
    pub missing: usize,
    /// The files of the report: `report.md`, `report.html`, `figures.json`. Empty where other shards are still to come.
    pub files: Vec<PathBuf>,
}

/// How many motions of a setting are missing, and how long one takes.
#[derive(Clone, Debug, PartialEq)]
pub struct EvaluationEstimate {
    /// The name of the setting.
    pub setting: String,
    /// The number of missing motions.
    pub motions: usize,
    /// The seconds that one takes, as the first ones took.
    pub seconds_each: f64,
}

/// Returns the lengths in frames of motions that the network can generate and the evaluator can read.
pub fn accepted_lengths(network: &impl Denoiser, evaluator: &Evaluator) -> RangeInclusive<usize> {
    let longest = evaluator.network().config().max_motion_length;
    network.min_frames()..=network.max_frames().min(longest)
}

/// Evaluates a model on the sentences of a data set: generates motions by every method and tag, measures them, and writes a report with the paper's
/// tables, studies and pictures to a folder.
///
/// A line is kept of every motion (`records.jsonl`), so that a call may end at any time; the same call goes on from there.
///
/// # Errors
///
/// If a sentence makes no sense to the model, the data set has fewer than two motions of [accepted lengths](accepted_lengths), the folder holds the records of another
/// evaluation, or a file cannot be read or written.
pub fn evaluate<D: Denoiser>(
    model: &EvaluatedModel<'_, D>,
    evaluator: &Evaluator,
    dataset: &Dataset,
    folder: &Path,
    options: &EvaluationOptions,
    observer: &mut dyn EvaluationObserver,
) -> Result<Evaluation, EvaluationError> {
    let sources = dataset_sources(model.model, evaluator, dataset, options, observer)?;
    evaluate_sources(model, sources, folder, options, observer)
}

/// Evaluates a model as papers on HumanML3D do: as [`evaluate`], with the public evaluator and by its rules ([`lamogen_eval::protocol`]). Every repeat is a
/// replication, with captions and lengths of its own; the public evaluation has 20.
///
/// # Errors
///
/// As [`evaluate`]; if the model does not generate motions of 36 to 196 frames ([`LaMoGen::with_min_frames`]), a caption has no tokens, or the evaluator's statistics are those of
/// something else.
pub fn evaluate_publicly<D: Denoiser>(
    model: &EvaluatedModel<'_, D>,
    benchmark: PublicBenchmark<'_>,
    folder: &Path,
    options: &EvaluationOptions,
    observer: &mut dyn EvaluationObserver,
) -> Result<Evaluation, EvaluationError> {
    let sources = public_sources(model.model, benchmark, options, observer)?;
    evaluate_sources(model, sources, folder, options, observer)
}

/// Checks everything that [`evaluate`] checks, and estimates what is left to do by generating some motions of each setting. Writes nothing.
///
/// # Errors
///
/// As [`evaluate`].
pub fn estimate<D: Denoiser>(
    model: &EvaluatedModel<'_, D>,
    evaluator: &Evaluator,
    dataset: &Dataset,
    folder: &Path,
    options: &EvaluationOptions,
    observer: &mut dyn EvaluationObserver,
) -> Result<Vec<EvaluationEstimate>, EvaluationError> {
    let sources = dataset_sources(model.model, evaluator, dataset, options, observer)?;
    estimate_sources(model, sources, folder, options)
}

/// Checks everything that [`evaluate_publicly`] checks, and estimates what is left to do, as [`estimate`] does.
///
/// # Errors
///
/// As [`evaluate_publicly`].
pub fn estimate_publicly<D: Denoiser>(
    model: &EvaluatedModel<'_, D>,
    benchmark: PublicBenchmark<'_>,
    folder: &Path,
    options: &EvaluationOptions,
    observer: &mut dyn EvaluationObserver,
) -> Result<Vec<EvaluationEstimate>, EvaluationError> {
    let sources = public_sources(model.model, benchmark, options, observer)?;
    estimate_sources(model, sources, folder, options)
}

/// Evaluates a model on sentences and real motions.
fn evaluate_sources<D: Denoiser>(
    model: &EvaluatedModel<'_, D>,
    sources: EvalSources<'_>,
    folder: &Path,
    options: &EvaluationOptions,
    observer: &mut dyn EvaluationObserver,
) -> Result<Evaluation, EvaluationError> {
    if folder.exists() && !folder.is_dir() {
        let reason = "expected a folder, found a file";
        return Err(EvaluationError::output(folder, reason));
    }
    remove_stale_temporaries(folder);
    let device = model.model.network().device();
    let plan = EvalPlan::new(options, plan_defaults(model.model), sources.prompts.len())
        .with_multimodality(sources.multimodality.clone());
    let run = check_run(model, (&sources, &device), (folder, &plan), options)?;
    let CheckedRun {
        runner,
        all,
        texts,
        identity,
        is_begun,
    } = run;
    if !is_begun {
        begin_folder(folder, &identity)?;
    }
    if !options.merge {
        generate_missing(folder, options, &all, &runner, observer)?;
    }
    let records = read_records(&record_files(folder)?)?;
    let missing = missing_motions(&all, &records).len();
    let mut files = Vec::new();
    if missing > 0 && options.shard.is_some() {
        observer.notice(&format!(
            "{missing} of {} motions are for other shards; --merge writes the report of what there is",
            all.len()
        ));
    } else {
        if missing > 0 {
            observer.notice(&format!(
                "{missing} of {} motions are not made yet; the report is of the others",
                all.len()
            ));
        }
        let data = EvalData {
            records: &records,
            prompts: &sources.prompts,
            bodies: &sources.bodies,
            scores: sources.score_basis(&texts, options)?,
            multimodality: plan.multimodality.as_ref(),
            repeats: options.repeats,
        };
        let title = format!("Report on {}", model.name);
        let report = report::Report::new(&plan, &data, &runner, &title, missing);
        files = report.map_err(evaluation_failure)?.write(folder)?;
    }
    Ok(Evaluation {
        motions: all.len(),
        missing,
        files,
    })
}

/// Checks an evaluation on sentences and real motions, and estimates what is left to do.
fn estimate_sources<D: Denoiser>(
    model: &EvaluatedModel<'_, D>,
    sources: EvalSources<'_>,
    folder: &Path,
    options: &EvaluationOptions,
) -> Result<Vec<EvaluationEstimate>, EvaluationError> {
    let device = model.model.network().device();
    let plan = EvalPlan::new(options, plan_defaults(model.model), sources.prompts.len())
        .with_multimodality(sources.multimodality.clone());
    let run = check_run(model, (&sources, &device), (folder, &plan), options)?;
    let CheckedRun { runner, all, .. } = &run;
    let records = match run.is_begun {
        true => read_records(&record_files(folder)?)?,
        false => HashMap::new(),
    };
    let missing = missing_motions(all, &records);
    let mut estimates = Vec::new();
    for setting in &plan.settings {
        let of_setting = missing.iter();
        let of_setting = of_setting.filter(|planned| planned.setting.name == setting.name);
        let of_setting: Vec<PlannedMotion<'_>> = of_setting.copied().collect();
        if of_setting.is_empty() {
            continue;
        }
        let first = &of_setting[..BATCH_SIZE.min(of_setting.len())];
        let start = Instant::now();
        runner.records(first)?;
        estimates.push(EvaluationEstimate {
            setting: setting.name.clone(),
            motions: of_setting.len(),
            seconds_each: start.elapsed().as_secs_f64() / first.len() as f64,
        });
    }
    Ok(estimates)
}

/// The sentences, the real motions, and the evaluator.
struct EvalSources<'a> {
    evaluator: MotionEvaluator<'a>,
    prompts: Vec<EvalPrompt>,
    /// The measurements of the prompts' real motions.
    bodies: Vec<BodyMeasurements>,
    scores: ScoreSource<'a>,
    /// The checksum of captions and real motions.
    checksum: u64,
    multimodality: Option<Multimodality>,
}

impl EvalSources<'_> {
    /// Returns what scores are computed from. `texts` are the embeddings of the captions of every repeat, for evaluators that were trained by lamogen.
    fn score_basis<'b>(
        &'b self,
        texts: &'b [Embeddings],
        options: &EvaluationOptions,
    ) -> Result<ScoreBasis<'b>, EvaluationError> {
        match &self.scores {
            ScoreSource::None => Ok(ScoreBasis::None),
            ScoreSource::Trained { real, others } => Ok(ScoreBasis::Trained {
                texts,
                real,
                others,
            }),
            // Fewer motions form no batch.
            ScoreSource::Public { clips, .. } if clips.len() < RetrievalBatches::SIZE => {
                Ok(ScoreBasis::None)
            }
            ScoreSource::Public {
                evaluator,
                clips,
                replications,
            } => {
                let form = |rows: &[f32]| {
                    let motion = Motion::from_pose_features(rows.as_chunks().0.to_vec());
                    let motion = motion.map_err(|error| error.to_string())?;
                    Ok(options.measure.measured_motion(&motion)?.features())
                };
                let protocol = Protocol::embed(evaluator, clips, replications, &form);
                let protocol = protocol.map_err(evaluation_failure)?;
                Ok(ScoreBasis::Public(Box::new(protocol)))
            }
        }
    }
}

/// An evaluation of which everything has been checked that can be wrong before the first motion.
struct CheckedRun<'a, D> {
    runner: EvalRunner<'a, D>,
    /// All motions of the plan.
    all: Vec<PlannedMotion<'a>>,
    /// The evaluator's embeddings of the captions of every repeat.
    texts: Vec<Embeddings>,
    /// What records of this run are known by.
    identity: Value,
    /// Whether the folder has records of this run.
    is_begun: bool,
}

/// Checks sentences, captions and folder, before anything is generated.
fn check_run<'a, D: Denoiser>(
    model: &EvaluatedModel<'a, D>,
    (sources, device): (&'a EvalSources<'a>, &'a Device),
    (folder, plan): (&Path, &'a EvalPlan),
    options: &EvaluationOptions,
) -> Result<CheckedRun<'a, D>, EvaluationError> {
    let runner = EvalRunner {
        model: model.model,
        evaluator: sources.evaluator,
        prompts: &sources.prompts,
        device,
        measure: options.measure,
    };
    let all: Vec<PlannedMotion<'a>> = plan.planned_motions().collect();
    runner.check(&all)?;
    let texts = match sources.evaluator {
        MotionEvaluator::Trained(evaluator) => {
            embed_captions(evaluator, &sources.prompts, options.repeats)?
        }
        MotionEvaluator::Public(_) | MotionEvaluator::None => Vec::new(),
    };
    let identity = run_identity(plan, &runner, &model.fingerprint, sources.checksum);
    Ok(CheckedRun {
        is_begun: is_begun(folder, options, &identity)?,
        runner,
        all,
        texts,
        identity,
    })
}

/// Returns the planned motions without a record.
fn missing_motions<'a>(
    all: &[PlannedMotion<'a>],
    records: &HashMap<RecordKey, MotionOutcome>,
) -> Vec<PlannedMotion<'a>> {
    let missing = all
        .iter()
        .filter(|planned| !records.contains_key(&planned.key()));
    missing.copied().collect()
}

/// Returns the evaluator's embeddings of the captions of every repeat.
fn embed_captions(
    evaluator: &Evaluator,
    prompts: &[EvalPrompt],
    repeats: u64,
) -> Result<Vec<Embeddings>, EvaluationError> {
    let embed_repeat = |repeat| {
        let captions = prompts.iter().map(|prompt| prompt.caption(repeat));
        let captions: Vec<&str> = captions.collect();
        evaluator.texts(&captions)
    };
    let texts = (0..repeats).map(embed_repeat).collect::<Result<_, _>>();
    texts.map_err(|error| EvaluationError::new(EvaluationErrorKind::Input, error))
}

/// Loads the prompts of a data set, and embeds and measures their real motions.
fn dataset_sources<'a, D: Denoiser>(
    model: &LaMoGen<D>,
    evaluator: &'a Evaluator,
    data: &Dataset,
    options: &EvaluationOptions,
    observer: &mut dyn EvaluationObserver,
) -> Result<EvalSources<'a>, EvaluationError> {
    let lengths = accepted_lengths(model.network(), evaluator);
    let entries: Vec<&Entry> = data
        .split(options.split)
        .filter(|entry| !entry.mirror && lengths.contains(&entry.frames))
        .collect();
    let entries = selected(&entries, &lengths, options, observer)?;
    let measure = |entry: &&Entry| {
        let motion = data.motion(entry).map_err(|error| error.to_string())?;
        let measured = options.measure.measured_motion(&motion)?;
        Ok((measured.features(), measured.body()))
    };
    let embed = |entries: &[&Entry]| {
        let measurements: Result<(Vec<Vec<f32>>, Vec<BodyMeasurements>), String> =
            entries.iter().map(measure).collect();
        let (features, bodies) = measurements
            .map_err(|error| EvaluationError::new(EvaluationErrorKind::Input, error))?;
        let points = evaluator.motions(&features).map_err(evaluation_failure)?;
        Ok::<_, EvaluationError>((points, bodies))
    };
    let (real, bodies) = embed(&entries)?;
    let others = other_motions(data, &lengths, options.split, entries.len());
    let others = { others.iter() }
        .map(|set| Ok(embed(set)?.0))
        .collect::<Result<_, EvaluationError>>()?;
    let prompts = entries.iter().map(|entry| EvalPrompt {
        captions: entry
            .captions
            .iter()
            .map(|caption| caption.text.clone())
            .collect(),
        frames: vec![entry.frames],
    });
    let prompts: Vec<EvalPrompt> = prompts.collect();
    let mut checksum = Checksum::new(0);
    for (place, prompt) in prompts.iter().enumerate() {
        let captions = prompt.captions.join("\n");
        for bytes in [captions.as_bytes(), &prompt.frames[0].to_le_bytes()] {
            checksum.add(bytes);
        }
        for number in real.row(place) {
            checksum.add(&number.to_le_bytes());
        }
    }
    Ok(EvalSources {
        evaluator: MotionEvaluator::Trained(evaluator),
        prompts,
        bodies,
        scores: ScoreSource::Trained { real, others },
        checksum: checksum.value(),
        multimodality: None,
    })
}

/// Draws sets of `size` real motions of other sentences, which are in other splits, without motions in common. Large sets vary little, and
/// fewer of them are drawn.
fn other_motions<'d>(
    data: &'d Dataset,
    lengths: &RangeInclusive<usize>,
    split: Split,
    size: usize,
) -> Vec<Vec<&'d Entry>> {
    let is_other =
        |entry: &&Entry| entry.split != split && !entry.mirror && lengths.contains(&entry.frames);
    let mut entries: Vec<&Entry> = data.entries().iter().filter(is_other).collect();
    entries.shuffle(&mut ChaCha12Rng::seed_from_u64(0));
    let sets = (OTHER_MOTIONS / size).clamp(1, OTHER_SETS);
    let sets = entries.chunks_exact(size).take(sets);
    sets.map(<[&Entry]>::to_vec).collect()
}

/// Selects as many motions as the options ask for, at equal distances. `lengths` are those of the motions, for the error.
fn selected<T: Copy>(
    all: &[T],
    lengths: &RangeInclusive<usize>,
    options: &EvaluationOptions,
    observer: &mut dyn EvaluationObserver,
) -> Result<Vec<T>, EvaluationError> {
    let wanted = options.prompts.unwrap_or(all.len());
    if wanted > all.len() {
        observer.notice(&format!(
            "the {} split has {} sentences, not {wanted}: all are taken",
            options.split,
            all.len()
        ));
    }
    if all.len() < 2 {
        let message = format!(
            "expected at least 2 motions of {} to {} frames in the {} split of the data set, found {}",
            lengths.start(),
            lengths.end(),
            options.split,
            all.len()
        );
        return Err(EvaluationError::new(EvaluationErrorKind::Input, message));
    }
    let places = PromptSelection::spread(wanted, all.len()).iter();
    Ok(places.map(|place| all[place]).collect())
}

/// Draws the sentences of the public evaluation, and measures the real motions.
fn public_sources<'a, D: Denoiser>(
    model: &LaMoGen<D>,
    benchmark: PublicBenchmark<'a>,
    options: &EvaluationOptions,
    observer: &mut dyn EvaluationObserver,
) -> Result<EvalSources<'a>, EvaluationError> {
    let input = |error: String| EvaluationError::new(EvaluationErrorKind::Input, error);
    let accepted = model.lengths();
    if ![PUBLIC_LENGTHS.start(), PUBLIC_LENGTHS.end()]
        .into_iter()
        .all(|length| accepted.contains(length))
    {
        return Err(input(format!(
            "expected a model that generates motions of {} to {} frames, which the public evaluation draws, found one of {} to {}",
            PUBLIC_LENGTHS.start(),
            PUBLIC_LENGTHS.end(),
            accepted.start(),
            accepted.end()
        )));
    }
    let all: Vec<&'a BenchmarkClip> = benchmark.split.clips().iter().collect();
    if let Some(evaluator) = benchmark.evaluator {
        { evaluator.check_statistics(benchmark.split) }
            .map_err(|error| input(error.to_string()))?;
        for clip in &all {
            for caption in &clip.captions {
                { evaluator.check_caption(caption) }
                    .map_err(|error| input(format!("{}: {error}", clip.name)))?;
            }
        }
    }
    let clips = selected(&all, &PUBLIC_LENGTHS, options, observer)?;
    let replications = (0..options.repeats).map(|repeat| Replication::draw(&clips, repeat));
    let replications: Vec<Replication> = replications.collect();
    let prompt = |(place, clip): (usize, &&BenchmarkClip)| {
        let samples = replications.iter().map(|draws| draws.samples[place]);
        EvalPrompt {
            captions: { samples.clone() }
                .map(|sample| clip.captions[sample.caption].text.clone())
                .collect(),
            frames: samples.map(|sample| sample.frames).collect(),
        }
    };
    let prompts = clips.iter().enumerate().map(prompt).collect();
    let mut checksum = Checksum::new(0);
    let mut bodies = Vec::new();
    for clip in &clips {
        for caption in &clip.captions {
            checksum.add(caption.text.as_bytes());
            checksum.add(caption.tokens.as_deref().unwrap_or_default().as_bytes());
        }
        for number in &clip.features {
            checksum.add(&number.to_le_bytes());
        }
        let body = Motion::from_pose_features(clip.features.as_chunks().0.to_vec())
            .map_err(|error| error.to_string())
            .and_then(|motion| Ok(options.measure.measured_motion(&motion)?.body()));
        bodies.push(body.map_err(|error| input(format!("{}: {error}", clip.name)))?);
    }
    let multimodality = options.multimodality.map(|multimodality| Multimodality {
        motions: multimodality.motions,
        prompts: { replications.iter() }
            .map(|draws| {
                let texts = multimodality.texts.min(draws.order.len());
                draws.order[..texts].to_vec()
            })
            .collect(),
    });
    Ok(match benchmark.evaluator {
        Some(evaluator) => EvalSources {
            evaluator: MotionEvaluator::Public(evaluator),
            prompts,
            bodies,
            scores: ScoreSource::Public {
                evaluator,
                clips,
                replications,
            },
            checksum: checksum.value(),
            multimodality,
        },
        None => EvalSources {
            evaluator: MotionEvaluator::None,
            prompts,
            bodies,
            scores: ScoreSource::None,
            checksum: checksum.value(),
            multimodality: None,
        },
    })
}

/// Generates and measures the motions of this shard that have no record yet.
fn generate_missing<D: Denoiser>(
    folder: &Path,
    options: &EvaluationOptions,
    all: &[PlannedMotion<'_>],
    runner: &EvalRunner<'_, D>,
    observer: &mut dyn EvaluationObserver,
) -> Result<(), EvaluationError> {
    let (part, parts) = options.shard.unwrap_or((1, 1));
    let name = match parts {
        1 => "records.jsonl".into(),
        _ => format!("records-{part}-of-{parts}.jsonl"),
    };
    let mut record_file = RecordFile::open(&folder.join(name))?;
    let records = read_records(&record_files(folder)?)?;
    // A shard gets whole groups. The groups are then the same with and without shards, and so are the last bits of the
    // numbers.
    let settings = all.chunk_by(|a, b| a.setting.name == b.setting.name);
    let groups = settings.flat_map(|setting| setting.chunks(BATCH_SIZE));
    let groups_of_shard = groups.skip(part - 1).step_by(parts);
    let pending = groups_of_shard.map(|group| missing_motions(group, &records));
    let pending: Vec<Vec<PlannedMotion<'_>>> = pending.filter(|group| !group.is_empty()).collect();
    let total = pending.iter().map(Vec::len).sum();
    let mut done = 0;
    for group in &pending {
        let setting = &group[0].setting.name;
        observer.progress(done, total, setting);
        for record in runner.records(group)? {
            record_file.add(&record)?;
        }
        done += group.len();
        observer.progress(done, total, setting);
    }
    Ok(())
}

/// The file with the identity of the run that the records of a folder belong to.
const IDENTITY: &str = "eval.json";

/// Returns the identity of a run: the model, the evaluator, the data set and the options.
fn run_identity<D: Denoiser>(
    plan: &EvalPlan,
    runner: &EvalRunner<'_, D>,
    fingerprint: &str,
    data: u64,
) -> Value {
    let PlanDefaults {
        preset,
        given_steps: _,
        noise_steps,
        timesteps: _,
    } = plan.defaults;
    let mut identity = json!({
        "model": fingerprint,
        "evaluator": runner.evaluator.fingerprint(),
        "temporal_smoothing": runner.model.temporal_smoothing().map(|smoothing| smoothing.frames),
        "text_scale": runner.model.text_scale().scale,
        "text_scale_until": runner.model.text_scale().until,
        "prompts": runner.prompts.len(),
        "data": format!("{data:016x}"),
        "preset": preset.name(),
        "steps": plan.defaults.steps(),
        "embedding_steps": plan.defaults.steps_of(Preset::Fast),
        "noise_steps": noise_steps,
        "measure": runner.measure.name(),
        "generator": concat!("lamogen ", env!("CARGO_PKG_VERSION")),
    });
    let method = runner.model.sampling_method();
    if method != runner.model.network().sampling_method() {
        identity["sampler"] = method.name().into();
    }
    identity
}

/// Returns the preset of a model, and the number of timesteps that its network was trained with.
fn plan_defaults<D: Denoiser>(model: &LaMoGen<D>) -> (Preset, usize) {
    let timesteps = model.network().noise_schedule().timesteps();
    (model.preset(), timesteps)
}

/// Whether the folder has records of this run. A folder with records of another run, or with records of an unknown run,
/// is an error.
fn is_begun(
    folder: &Path,
    options: &EvaluationOptions,
    identity: &Value,
) -> Result<bool, EvaluationError> {
    let path = folder.join(IDENTITY);
    let input = |reason: &dyn Display| {
        EvaluationError::new(
            EvaluationErrorKind::Input,
            format!("{}: {reason}", path.display()),
        )
    };
    let found = match fs::read_to_string(&path) {
        Ok(found) => found,
        Err(error)
            if error.kind() == ErrorKind::NotFound
                && !options.merge
                && (!folder.exists() || record_files(folder)?.is_empty()) =>
        {
            return Ok(false);
        }
        Err(error) => {
            let hint = "it lies beside the records, in the folder where they were made";
            return Err(input(&error).hint(hint));
        }
    };
    let found: Value = serde_json::from_str(&found).map_err(|error| input(&error))?;
    let differs = |name: &&str| found.get(*name) != identity.get(*name);
    let fields = identity.as_object().into_iter().flatten();
    let mut other: Vec<&str> = fields
        .map(|(name, _)| name.as_str())
        .filter(differs)
        .collect();
    if other.contains(&"prompts") || other.contains(&"measure") {
        // The checksum of the data depends on the number of sentences and on how the real motions are measured, so it
        // is not listed beside these.
        other.retain(|name| *name != "data");
    }
    if other.is_empty() {
        return Ok(true);
    }
    let other: Vec<String> = { other.into_iter() }
        .map(|name| {
            let text = |value: &Value| value.get(name).map_or("nothing".into(), Value::to_string);
            format!("{name} is {}, now {}", text(&found), text(identity))
        })
        .collect();
    let message = format!(
        "{}: the records in this folder are of another run: {}",
        path.display(),
        other.join(", ")
    );
    Err(
        EvaluationError::new(EvaluationErrorKind::Options, message).hint(match options.merge {
            true => "--merge goes with the options of the run",
            false => "another --out begins anew",
        }),
    )
}

/// Makes a folder for the records of this run, with the file of its identity.
fn begin_folder(folder: &Path, identity: &Value) -> Result<(), EvaluationError> {
    fs::create_dir_all(folder).map_err(|error| EvaluationError::output(folder, error))?;
    let path = folder.join(IDENTITY);
    let text = format!("{identity:#}\n");
    write_atomically(&path, |file| file.write_all(text.as_bytes()))
        .map_err(|error| EvaluationError::output(&path, error))
}

/// Returns all record files in a folder, in the order of their names.
fn record_files(folder: &Path) -> Result<Vec<PathBuf>, EvaluationError> {
    let unreadable = |error| {
        EvaluationError::new(
            EvaluationErrorKind::Input,
            format!("{}: {error}", folder.display()),
        )
    };
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        let name = path
            .file_name()
            .map(|name| name.to_string_lossy().into_owned());
        if name.is_some_and(|name| name.starts_with("records") && name.ends_with(".jsonl")) {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}
