//! Pictures of the motions that a model generates from sentences.

use std::error::Error;
use std::ffi::OsStr;
use std::path::PathBuf;

use burn::tensor::Device;
use lamogen::Request;
use lamogen_raster::png;
use lamogen_view::{LabelledMotion, save, strip};

use crate::subject::Subject;

/// The options of the pictures.
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

/// The sentences of the model card: ten simple ones, then ways of walking, hands, fights, exercises, and motions on the floor.
const PROMPTS: [&str; 40] = [
    "a person walks forward",
    "a person runs",
    "a person jumps",
    "a person waves",
    "a person dances",
    "a person kicks",
    "a person punches",
    "a person sits down",
    "someone picks something up",
    "a person stands still",
    "a person walks backward",
    "a person steps to the left",
    "a person walks and turns left",
    "someone runs forward, makes a half turn to the right and runs forward",
    "a person walks around in a circle",
    "a person stops, looks around and walks on",
    "a person walks like a chicken",
    "an angry person walks",
    "a drunk person walks",
    "a person sneaks forward",
    "a person waves with the right hand",
    "a person raises both hands",
    "a person throws a ball",
    "a person drinks from a bottle",
    "a person claps",
    "a person directs traffic",
    "a person throws a right punch",
    "a person kicks with the left foot",
    "a person does a karate move",
    "a person squats twice",
    "a person does a lunge with the left leg",
    "a person balances on one leg",
    "a person does jumping jacks",
    "a person does a push-up",
    "a person hops on one foot",
    "a person jumps forward",
    "a person climbs up a ladder",
    "a person crawls forward",
    "a person lies down on the ground",
    "a person does a cartwheel",
];

/// The number of poses that are drawn of each motion.
const POSES: usize = 9;

/// Draws a strip of the motion of each sentence, without tags.
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
        options.subject.with_steps(request).seed(options.seed)
    };
    let requests: Vec<Request> = sentences.iter().map(request).collect();
    let motions = model.generate_all(&requests)?;
    let rows = sentences
        .iter()
        .zip(&motions)
        .map(|(label, generation)| LabelledMotion::new(label, &generation.guided));
    let svg = strip(&rows.collect::<Vec<_>>(), POSES);
    match options.out.extension().and_then(OsStr::to_str) {
        Some("svg") => save(&options.out, &svg)?,
        Some("png") => save(&options.out, &png(&svg, 1.0)?)?,
        _ => return Err(format!("{}: expected .svg or .png", options.out.display()).into()),
    }
    Ok(())
}
