//! How good a model is on motions that it has not seen: what stands in its model card.

use std::error::Error;
use std::path::PathBuf;

use burn::tensor::Device;
use lamogen::{FRAMES_PER_SECOND, Motion, Request};
use lamogen_data::{Dataset, Entry, LoadOptions, Split};
use lamogen_eval::{CaptionedMotions, Estimate, Evaluator, fid, real_motions};
use lamogen_model::Denoiser;
use lamogen_motion::{BoneDrift, FootSliding, Jitter};
use lamogen_train::{CaptionTokens, Validation};
use serde_json::{Value, json};

use crate::subject::Subject;

/// What is measured.
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

/// Repetitions of captions and batches for R-precision.
const DRAWS: usize = 20;

/// Measures a model and, beside it, the real motions: losses on clean motions, R-precision, FID, foot sliding, jitter, bone
/// drift. Generated motions have captions and lengths of the real ones, and are what the network itself gives.
///
/// # Errors
///
/// If a file cannot be read, or a motion cannot be generated.
pub fn run(
    options: &Options,
    device: &Device,
    tell: &mut dyn FnMut(String),
) -> Result<Value, Box<dyn Error>> {
    let model = options.subject.open(device)?;
    let dataset = Dataset::open(&options.data, &LoadOptions::default(), &mut |_| ())?;
    let judge = Evaluator::load(&options.evaluator, device)?;
    let network = model.network();
    let lengths = network.min_frames()..=network.max_frames();
    let tokens = CaptionTokens::new(&dataset, model.tokenizer().clone(), None, 0)?;
    let mut losses = serde_json::Map::new();
    for split in [Split::Validation, Split::Test] {
        let validation = Validation::new(&dataset, &tokens, split, lengths.clone(), device);
        let validation = validation.ok_or("no motions to validate on")?;
        let loss = validation.loss(network);
        tell(format!("{split}: validation loss {loss:.4}"));
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
    let (real, embedded) = judged(&judge, &entries, &real, None)?;
    let mut generated = Vec::new();
    for seed in 0..options.repeats {
        let requests: Vec<Request> = entries
            .iter()
            .enumerate()
            .map(|(place, entry)| {
                Request::new(&entry.captions[caption(entry, seed)].text)
                    .seconds(entry.frames as f32 / FRAMES_PER_SECOND)
                    .steps(options.subject.steps as usize)
                    .seed(seed * 100_000 + place as u64)
            })
            .collect();
        let made = model.generate_all(&requests)?;
        let made: Vec<Motion> = made.into_iter().map(|made| made.network.guided).collect();
        let (mut figures, found) = judged(&judge, &entries, &made, Some(seed))?;
        figures.insert("fid", fid(embedded.motions(), found.motions())?);
        tell(format!("seed {seed}: {figures:.4?}"));
        generated.push(figures);
    }
    let means = generated[0].keys().map(|name| {
        let values = generated.iter().map(|figures| figures[name]);
        let estimate = Estimate::of(values);
        let value = json!({ "mean": estimate.mean, "interval": estimate.interval });
        ((*name).to_owned(), value)
    });
    Ok(json!({
        "model": options.subject.model,
        "split": options.split.name(),
        "motions": entries.len(),
        "steps": options.subject.steps,
        "temporal_smoothing": model.temporal_smoothing().map(|temporal_smoothing| json!({ "frames": temporal_smoothing.frames, "until": temporal_smoothing.until })),
        "repeats": options.repeats,
        "validation_loss": losses,
        "generated": means.collect::<serde_json::Map<_, _>>(),
        "real": real,
    }))
}

/// Which caption a motion is generated from.
fn caption(entry: &Entry, seed: u64) -> usize {
    seed as usize % entry.captions.len()
}

type Figures = std::collections::BTreeMap<&'static str, f64>;

/// What a judge and a ruler make of motions. Generated ones are held against the caption they come from, real ones against all of
/// theirs.
fn judged(
    judge: &Evaluator,
    entries: &[&Entry],
    motions: &[Motion],
    seed: Option<u64>,
) -> Result<(Figures, CaptionedMotions), Box<dyn Error>> {
    let pairs = entries.iter().zip(motions).map(|(entry, motion)| {
        let captions = entry.captions.iter().map(|caption| caption.text.clone());
        let captions: Vec<String> = match seed {
            None => captions.collect(),
            Some(seed) => captions.skip(caption(entry, seed)).take(1).collect(),
        };
        let rows = motion.features().expect("motions of pose features");
        (captions, rows.as_flattened().to_vec())
    });
    let found = CaptionedMotions::embed(judge, pairs)?;
    let precision = real_motions(&found, DRAWS, 0)?;
    let mut figures = Figures::from([
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
            *figures.entry(name).or_default() += f64::from(value) / motions.len() as f64;
        }
    }
    Ok((figures, found))
}
