//! Measures what places cost that people really were at: those of captured motions, asked of their sentences.
//!
//! ```text
//! captured motion ──its pelvis, wrist or pose at moments──▶ places ─┐
//!       └──caption──────────────────────────────────────────────────┴▶ motion ──BVH, read back──▶ R-precision, FID, jerk, distances
//! ```

use std::error::Error;
use std::fmt::Write;
use std::path::PathBuf;

use burn::tensor::Device;
use lamogen::motion::{FRAMES_PER_SECOND, FootSliding, Jitter, encode_canonical};
use lamogen::{
    Facing, GroundPath, Joint, KeyPose, LaMoGen, Motion, Places, Reach, ReachPart, Request,
    Waypoint,
};
use lamogen_data::{Dataset, Entry, LoadOptions, Split};
use lamogen_eval::{Evaluator, MatchingScore, RetrievalBatches, fid};

use crate::places::through_file;
use crate::subject::Subject;

/// The options of the measurement.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    #[command(flatten)]
    #[allow(missing_docs)]
    pub subject: Subject,
    /// A data set of captured motions with captions, whose test split is used.
    #[arg(long)]
    pub data: PathBuf,
    /// The folder of an evaluator.
    #[arg(long)]
    pub evaluator: PathBuf,
    /// Captured motions, spread over the test split.
    #[arg(long, default_value_t = 64)]
    pub prompts: usize,
}

/// What is asked of a motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Asked {
    Nothing,
    Path,
    Hand,
    Pose,
}

/// How often batches of captions are drawn.
const DRAWS: u64 = 20;
/// The moments of a path, as shares of the length.
const PATH_MOMENTS: [f32; 3] = [1.0 / 3.0, 2.0 / 3.0, 1.0];

impl Asked {
    const ALL: [Asked; 4] = [Asked::Nothing, Asked::Path, Asked::Hand, Asked::Pose];

    fn name(self) -> &'static str {
        match self {
            Asked::Nothing => "text alone",
            Asked::Path => "path through three places",
            Asked::Hand => "right hand at one position",
            Asked::Pose => "pose at one moment",
        }
    }

    /// Returns places that a captured motion passes.
    fn places(self, captured: &Motion) -> Result<Places, Box<dyn Error>> {
        let frames = captured.frames();
        let seconds = |frame: usize| frame as f32 / FRAMES_PER_SECOND;
        let position = |frame: usize, joint: Joint| captured.joints()[frame][joint.index()];
        let middle = frames / 2;
        let mut places = Places {
            // The captured body may walk sideways or backward.
            facing: Facing::Free,
            ..Places::default()
        };
        match self {
            Asked::Nothing => {}
            Asked::Path => {
                let points = PATH_MOMENTS.map(|share| {
                    let frame = ((share * frames as f32) as usize).min(frames - 1);
                    let [x, _, z] = position(frame, Joint::Pelvis);
                    Waypoint {
                        seconds: seconds(frame),
                        place: [x, z],
                    }
                });
                places.path = Some(GroundPath::new(points)?);
            }
            Asked::Hand => {
                let part = ReachPart::RightHand;
                let wrist = position(middle, part.joint());
                places
                    .reaches
                    .push(Reach::new(part, seconds(middle), wrist)?);
            }
            Asked::Pose => {
                let pose = captured.joints()[middle];
                places.poses.push(KeyPose::new(seconds(middle), pose)?);
            }
        }
        Ok(places)
    }
}

/// A sentence with the captured motion that it describes.
struct CapturedMotion {
    prompt: String,
    motion: Motion,
}

/// The measurements of the motions of one kind of places.
#[derive(Default)]
struct Figures {
    distances: Vec<f32>,
    jerk: Vec<f32>,
    sliding: Vec<f32>,
    features: Vec<Vec<f32>>,
}

/// Generates the motions and returns a table in Markdown.
///
/// # Errors
///
/// If a file cannot be read, a motion cannot be generated, or numbers become infinite.
pub fn run(
    options: &Options,
    device: &Device,
    report: &mut dyn FnMut(&str),
) -> Result<String, Box<dyn Error>> {
    let model = options.subject.open(device)?;
    let evaluator = Evaluator::load(&options.evaluator, device)?;
    let captured = captured_motions(options, &model)?;
    let folder = tempfile::tempdir()?;
    let mut all: Vec<(Asked, Figures)> = Vec::new();
    for asked in Asked::ALL {
        let mut figures = Figures::default();
        for (place, CapturedMotion { prompt, motion }) in captured.iter().enumerate() {
            let places = asked.places(motion)?;
            let request = Request::new(prompt)
                .frames(motion.frames())
                .seed(place as u64)
                .places(places.clone());
            let generation = model.generate(&options.subject.with_steps(request))?;
            let made = through_file(&generation.guided, folder.path())?;
            // With nothing asked, the places of the path are measured, which the text alone misses.
            let outcomes = match asked {
                Asked::Nothing => Asked::Path.places(motion)?.outcomes(&made),
                _ => places.outcomes(&made),
            };
            figures
                .distances
                .extend(outcomes.iter().map(|outcome| 100.0 * outcome.distance()));
            figures.jerk.push(Jitter::of(&made).jerk);
            figures.sliding.push(FootSliding::of(&made).speed);
            figures
                .features
                .push(encode_canonical(made.joints()).into_flattened());
            report(&format!(
                "{}, {} of {}: {prompt}",
                asked.name(),
                place + 1,
                captured.len()
            ));
        }
        all.push((asked, figures));
    }
    table(&evaluator, &captured, &all)
}

/// Reads captured motions of the test split that the model can make at their own length.
fn captured_motions(
    options: &Options,
    model: &LaMoGen,
) -> Result<Vec<CapturedMotion>, Box<dyn Error>> {
    let lengths = model.lengths();
    let limits = LoadOptions {
        min_frames: *lengths.start(),
        max_frames: *lengths.end(),
    };
    let dataset = Dataset::open(&options.data, &limits, &mut |_| ())?;
    let entries: Vec<&Entry> = dataset.split(Split::Test).collect();
    let count = options.prompts.min(entries.len());
    let spread = (0..count).map(|place| entries[place * entries.len() / count]);
    spread
        .map(|entry| {
            Ok(CapturedMotion {
                prompt: entry.captions[0].text.clone(),
                motion: dataset.motion(entry)?,
            })
        })
        .collect()
}

/// Compares the motions of all kinds of places with those of the text alone.
fn table(
    evaluator: &Evaluator,
    captured: &[CapturedMotion],
    all: &[(Asked, Figures)],
) -> Result<String, Box<dyn Error>> {
    let captions: Vec<&str> = captured
        .iter()
        .map(|captured| captured.prompt.as_str())
        .collect();
    let texts = evaluator.texts(&captions)?;
    let real: Vec<Vec<f32>> = { captured.iter() }
        .map(|captured| encode_canonical(captured.motion.joints()).into_flattened())
        .collect();
    let real = evaluator.motions(&real)?;
    let top3 = |points: &lamogen_eval::Embeddings| -> Result<f64, Box<dyn Error>> {
        let mut sum = 0.0;
        for draw in 0..DRAWS {
            let RetrievalBatches { batches, .. } =
                RetrievalBatches::distinct(&captions, RetrievalBatches::SIZE, draw);
            sum += MatchingScore::of(&texts, points, &batches)?.r_precision[2];
        }
        Ok(sum / DRAWS as f64)
    };
    let mean = |values: &[f32]| values.iter().sum::<f32>() / values.len() as f32;
    let worst = |values: &[f32]| values.iter().copied().fold(0.0, f32::max);
    let mut table = String::from(
        "| asked | top-3 R-precision | FID | cm off: mean, worst | jerk m/s³ | times that of the text alone: mean, median | sliding m/s |\n|---|--:|--:|--:|--:|--:|--:|\n",
    );
    writeln!(
        table,
        "| (captured motions) | {:.3} | | | | | |",
        top3(&real)?
    )?;
    let alone = &all[0].1;
    for (asked, figures) in all {
        let points = evaluator.motions(&figures.features)?;
        let mut times: Vec<f32> = { figures.jerk.iter().zip(&alone.jerk) }
            .map(|(jerk, alone)| jerk / alone)
            .collect();
        times.sort_by(f32::total_cmp);
        writeln!(
            table,
            "| {} | {:.3} | {:.2} | {:.1}, {:.1} | {:.0} | {:.2}, {:.2} | {:.3} |",
            asked.name(),
            top3(&points)?,
            fid(&real, &points)?,
            mean(&figures.distances),
            worst(&figures.distances),
            mean(&figures.jerk),
            mean(&times),
            times[times.len() / 2],
            mean(&figures.sliding),
        )?;
    }
    Ok(table)
}
