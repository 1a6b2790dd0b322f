//! What a model makes of sentences, to be looked at.

use std::error::Error;
use std::path::PathBuf;

use burn::tensor::Device;
use lamogen::Request;
use lamogen_view::{Row, save, strip};

use crate::subject::Subject;

/// What is drawn.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    #[command(flatten)]
    #[allow(missing_docs)]
    pub subject: Subject,
    /// The picture to write: SVG or PNG.
    #[arg(long)]
    pub out: PathBuf,
    /// A sentence, several times for several; those of the model card without.
    #[arg(long)]
    pub prompt: Vec<String>,
    /// Seed of the start noise.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Length of the motions in seconds.
    #[arg(long, default_value_t = 4.0)]
    pub seconds: f32,
}

/// What the model card shows.
const PROMPTS: [&str; 14] = [
    "a person walks forward",
    "a person runs",
    "a person jumps",
    "a person waves with the left hand",
    "a person waves with the right hand",
    "a person bows",
    "a person kicks",
    "a person punches",
    "a person dances",
    "a person walks and turns left",
    "a person raises both hands",
    "a tired person walks",
    "a happy person walks",
    "an old person walks",
];

/// Poses of each motion.
const POSES: usize = 12;

/// Draws a strip of every sentence's motion, without tags.
///
/// # Errors
///
/// If the model cannot be read, a motion cannot be generated, or the picture cannot be written.
pub fn run(options: &Options, device: &Device) -> Result<(), Box<dyn Error>> {
    let model = options.subject.open(device)?;
    let sentences: Vec<&str> = match &options.prompt[..] {
        [] => PROMPTS.to_vec(),
        prompts => prompts.iter().map(String::as_str).collect(),
    };
    let request = |sentence: &&str| {
        let request = Request::new(*sentence).seconds(options.seconds);
        let steps = options.subject.steps as usize;
        request.steps(steps).seed(options.seed)
    };
    let requests: Vec<Request> = sentences.iter().map(request).collect();
    let motions = model.generate_all(&requests)?;
    let rows = sentences.iter().zip(&motions).map(|(label, made)| Row {
        label,
        motion: &made.guided,
    });
    save(&options.out, &strip(&rows.collect::<Vec<_>>(), POSES))?;
    Ok(())
}
