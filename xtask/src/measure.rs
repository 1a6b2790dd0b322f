//! The quality of a model on motions that it was not trained on, for its model card.

use std::error::Error;
use std::path::PathBuf;

use burn::tensor::Device;
use lamogen::{FRAMES_PER_SECOND, Motion, Request};
use lamogen_data::{Dataset, Entry, LoadOptions, Split};
use lamogen_eval::{CaptionedMotions, Estimate, Evaluator, evaluate_real_motions, fid};
use lamogen_model::Denoiser;
use lamogen_motion::{BoneDrift, FootSliding, Jitter};
use lamogen_train::{CaptionTokens, ValidationSet};
use serde_json::{Value, json};

use crate::subject::Subject;

/// The options of the measurement.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    /// Folder of the data set.
    #[arg(long)]
    pub data: PathBuf,
    /// Folder of the evaluator, as lamogen train --evaluator leaves it.
    #[arg(long)]
    pub evaluator: PathBuf,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub subject: Subject,
    /// Motions of every caption, from as many seeds.
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u64).range(1..=100))]
    pub repeats: u64,
    /// Which motions are measured: train, val or test.
    #[arg(long, default_value = "test")]
    pub split: Split,
}

/// The number of draws of captions and batches for the R-precision.
const DRAWS: usize = 20;

/// Measures the motions of a model and, for comparison, the real motions: losses on clean motions, R-precision, FID, foot sliding,
/// jitter, bone drift. Returns the results as JSON; `report` receives one line of text for each part.
///
/// The generated motions have the captions and lengths of the real ones. They are the motions of the network itself, not those of
/// the rigid body.
///
/// # Errors
///
/// If a file cannot be read, or a motion cannot be generated.
pub fn run(
    options: &Options,
    device: &Device,
    report: &mut dyn FnMut(String),
) -> Result<Value, Box<dyn Error>> {
    let model = options.subject.open(device)?;
    let dataset = Dataset::open(&options.data, &LoadOptions::default(), &mut |_| ())?;
    let evaluator = Evaluator::load(&options.evaluator, device)?;
    let network = model.network().motion_diffuse();
    let network = network.ok_or("expected a MotionDiffuse, found an MDM")?;
    let lengths = network.min_frames()..=network.max_frames();
    let tokens = CaptionTokens::new(&dataset, model.tokenizer().clone(), None, 0)?;
    let mut losses = serde_json::Map::new();
    for split in [Split::Validation, Split::Test] {
        let schedule = network.noise_schedule();
        let validation =
            ValidationSet::new(&dataset, &tokens, split, lengths.clone(), schedule, device);
        let validation = validation.ok_or("no motions to validate on")?;
        let loss = validation.loss(network);
        report(format!("{split}: validation loss {loss:.4}"));
        losses.insert(split.name().into(), loss.into());
    }
    let entries = dataset.split(options.split).filter(|entry| !entry.mirror);
    let entries: Vec<&Entry> = entries
        .filter(|entry| lengths.contains(&entry.frames))
        .collect();
    let real: Vec<Motion> = entries
        .iter()
        .map(|entry| dataset.motion(entry))
        .collect::<Result<_, _>>()?;
    let (real, embedded) = evaluate(&evaluator, &entries, &real, None)?;
    let mut generated = Vec::new();
    for seed in 0..options.repeats {
        let requests: Vec<Request> = entries
            .iter()
            .enumerate()
            .map(|(place, entry)| {
                let request = Request::new(&entry.captions[caption(entry, seed)].text)
                    .seconds(entry.frames as f32 / FRAMES_PER_SECOND)
                    .seed(seed * 100_000 + place as u64);
                options.subject.with_steps(request)
            })
            .collect();
        let generations = model.generate_all(&requests)?.into_iter();
        let motions: Vec<Motion> = generations
            .map(|generation| generation.network.guided)
            .collect();
        let (mut metrics, generated_embedded) =
            evaluate(&evaluator, &entries, &motions, Some(seed))?;
        metrics.insert(
            "fid",
            fid(embedded.motions(), generated_embedded.motions())?,
        );
        report(format!("seed {seed}: {metrics:.4?}"));
        generated.push(metrics);
    }
    let means = generated[0].keys().map(|name| {
        let values = generated.iter().map(|metrics| metrics[name]);
        let estimate = Estimate::of(values);
        let value = json!({ "mean": estimate.mean, "interval": estimate.interval });
        ((*name).to_owned(), value)
    });
    Ok(json!({
        "model": options.subject.model,
        "split": options.split.name(),
        "motions": entries.len(),
        "steps": options.subject.steps(&model),
        "temporal_smoothing": model.temporal_smoothing().map(|temporal_smoothing| json!({ "frames": temporal_smoothing.frames, "until": temporal_smoothing.until })),
        "repeats": options.repeats,
        "validation_loss": losses,
        "generated": means.collect::<serde_json::Map<_, _>>(),
        "real": real,
    }))
}

/// Returns the index of the caption from which a motion is generated.
fn caption(entry: &Entry, seed: u64) -> usize {
    seed as usize % entry.captions.len()
}

/// The values of the metrics by their names.
type Metrics = std::collections::BTreeMap<&'static str, f64>;

/// Evaluates motions with an evaluator and with metrics of the body. Generated motions, which have a seed, are compared with the
/// caption from which they were generated, real motions with all of their captions.
fn evaluate(
    evaluator: &Evaluator,
    entries: &[&Entry],
    motions: &[Motion],
    seed: Option<u64>,
) -> Result<(Metrics, CaptionedMotions), Box<dyn Error>> {
    let pairs = entries.iter().zip(motions).map(|(entry, motion)| {
        let captions = entry.captions.iter().map(|caption| caption.text.clone());
        let captions: Vec<String> = match seed {
            None => captions.collect(),
            Some(seed) => captions.skip(caption(entry, seed)).take(1).collect(),
        };
        let rows = motion.features().expect("motions of pose features");
        (captions, rows.as_flattened().to_vec())
    });
    let embedded = CaptionedMotions::embed(evaluator, pairs)?;
    let precision = evaluate_real_motions(&embedded, DRAWS, 0)?;
    let mut metrics = Metrics::from([
        ("r_precision_1", precision.r_precision[0].mean),
        ("r_precision_2", precision.r_precision[1].mean),
        ("r_precision_3", precision.r_precision[2].mean),
        ("distance", precision.distance.mean),
    ]);
    for motion in motions {
        let (sliding, jitter) = (FootSliding::of(motion), Jitter::of(motion));
        for (name, value) in [
            ("sliding_share", sliding.ratio),
            ("sliding_speed_m_s", sliding.speed),
            ("jitter_ankles_mm", jitter.ankles),
            ("jerk_m_s3", jitter.jerk),
            ("bone_drift_m", BoneDrift::of(motion).largest()),
        ] {
            *metrics.entry(name).or_default() += f64::from(value) / motions.len() as f64;
        }
    }
    Ok((metrics, embedded))
}
