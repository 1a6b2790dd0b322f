//! The picture of one motion on characters of other proportions, for docs/characters.md.

use std::error::Error;
use std::ffi::OsStr;
use std::path::PathBuf;

use burn::tensor::Device;
use lamogen::Request;
use lamogen::character::{Character, CharacterOptions, RetargetOptions, SaveOptions};
use lamogen_files::{ReadOptions, Unit, UpAxis};
use lamogen_motion::Motion;
use lamogen_raster::png;
use lamogen_view::{LabelledMotion, save, strip};

use crate::subject::Subject;

/// The characters are those that the tests make.
#[allow(dead_code)]
#[path = "../../crates/lamogen-character/tests/characters/test_character.rs"]
mod test_character;

use test_character::TestCharacter;

/// The options of the picture.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    #[command(flatten)]
    #[allow(missing_docs)]
    pub subject: Subject,
    /// The picture to write: SVG or PNG.
    #[arg(long, default_value = "docs/images/characters.svg")]
    pub out: PathBuf,
    /// The sentence.
    #[arg(long, default_value = "a person jumps")]
    pub prompt: String,
    /// Seed of the start noise.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Length of the motion in seconds.
    #[arg(long, default_value_t = 3.0)]
    pub seconds: f32,
}

/// The number of poses that are drawn of each body.
const POSES: usize = 9;

/// Returns the characters of the picture.
fn bodies() -> [(&'static str, TestCharacter); 4] {
    let body = |sizes, shoulders, head, neck| TestCharacter {
        sizes,
        shoulders,
        head,
        neck,
        ..TestCharacter::default()
    };
    [
        ("an adult", body([1.0; 3], 1.0, 1.0, true)),
        ("a child", body([0.5, 0.65, 0.5], 0.65, 1.3, true)),
        (
            "a giant with long arms",
            body([1.45, 1.5, 2.0], 1.5, 1.2, true),
        ),
        (
            "a mascot without a neck",
            body([0.45, 0.95, 0.75], 1.4, 2.0, false),
        ),
    ]
}

/// Generates a motion, puts it on each character, and draws what their files hold.
///
/// # Errors
///
/// If the model cannot be read, the motion cannot be generated, or a file cannot be written or read.
pub fn run(options: &Options, device: &Device) -> Result<(), Box<dyn Error>> {
    let model = options.subject.open(device)?;
    let request = Request::new(&*options.prompt)
        .seconds(options.seconds)
        .seed(options.seed);
    let request = options.subject.with_steps(request);
    let motion = model.generate(&request)?.guided;
    let folder = tempfile::tempdir()?;
    let [hero, animated] = ["hero.glb", "animated.glb"].map(|name| folder.path().join(name));
    let reading = ReadOptions {
        unit: Some(Unit::Metre),
        up: Some(UpAxis::Y),
        ..ReadOptions::default()
    };
    let save_options = SaveOptions {
        replace_animations: true,
    };
    let motions: Vec<(&str, Motion)> = bodies()
        .into_iter()
        .map(|(name, body)| {
            body.write(&hero);
            let character = Character::open(&hero, &CharacterOptions::default())?;
            let animation = character.animate(&motion, &RetargetOptions::default())?;
            character.save(&animated, &[animation], &save_options)?;
            Ok((name, lamogen_files::read(&animated, &reading)?.motion))
        })
        .collect::<Result<_, Box<dyn Error>>>()?;
    let rows: Vec<LabelledMotion<'_>> = { motions.iter() }
        .map(|(label, motion)| LabelledMotion::new(label, motion))
        .collect();
    let svg = strip(&rows, POSES);
    match options.out.extension().and_then(OsStr::to_str) {
        Some("svg") => save(&options.out, &svg)?,
        Some("png") => save(&options.out, &png(&svg, 1.0)?)?,
        _ => return Err(format!("{}: expected .svg or .png", options.out.display()).into()),
    }
    Ok(())
}
