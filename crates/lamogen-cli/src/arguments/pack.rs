//! The arguments of `lamogen pack`.

use std::path::PathBuf;

use clap::Args;

use super::shared::MotionReadingArguments;

/// The text below the options in the help.
pub const AFTER_HELP: &str = "\
A source is a folder of HumanML3D's form (new_joint_vecs, texts, train.txt, val.txt, test.txt), a packed folder, or any \
folder of motion files with --captions: a line is a file, a tab and a caption, or JSON:
  {\"file\": \"walk.bvh\", \"captions\": [\"a person walks\"], \"split\": \"train\", \"start\": 1.5, \"end\": 6}
split (train, val, test), content, style, source, start and end (seconds) may be left out; captions of several lines about \
the same part of a file are put together.

Motion files are resampled to 20 frames a second and put on HumanML3D's body. Mirror images of the motions for training \
share the rows of their originals; left and right are exchanged in what is said of them.";

/// The arguments of `lamogen pack`.
#[derive(Args)]
pub struct PackArguments {
    /// The folder to read; several data sets become one.
    #[arg(required = true, value_name = "SOURCE")]
    pub sources: Vec<PathBuf>,
    /// Folder to write.
    #[arg(long, short, value_name = "FOLDER")]
    pub out: PathBuf,
    /// What is said of motion files, a line each.
    #[arg(long, value_name = "FILE")]
    pub captions: Option<PathBuf>,
    /// Further captions of motions that have some, a line of JSON each: {"name": "run_3", "captions": ["a kid dashes off"]}, or of kinds of motion (see docs/data.md).
    #[arg(long, value_name = "FILE")]
    pub more_captions: Option<PathBuf>,
    /// Add motions that are put together from motions for training, by a recipe (see docs/data.md).
    #[arg(long, value_name = "FILE")]
    pub compositions: Option<PathBuf>,
    /// Add motions for training at other speeds, such as 0.8,1.25, but for those that leave the ground or whose captions say how fast they are.
    #[arg(long, value_delimiter = ',', value_parser = parse_speed)]
    pub speeds: Vec<f32>,
    /// Give motions for training mirror images, where they have none (the default).
    #[arg(long, overrides_with = "no_mirror")]
    pub mirror: bool,
    /// Make no mirror images.
    #[arg(long, overrides_with = "mirror")]
    pub no_mirror: bool,
    /// Leave out motions of fewer frames, at 20 a second.
    #[arg(long, value_name = "FRAMES", default_value_t = 40)]
    pub min_frames: usize,
    /// Cut motion files of more frames into equal windows, usually of up to 196; leave out longer motions of a data
    /// set, usually those of 200 and more.
    #[arg(long, value_name = "FRAMES")]
    pub max_frames: Option<usize>,
    /// By what motion files without a split are dealt out: 80 % training, 5 % validation, 15 % test.
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// Replace a packed folder that is already there.
    #[arg(long)]
    pub force: bool,
    #[command(flatten)]
    pub reading: MotionReadingArguments,
}

/// Parses a speed, relative to that of the original motion.
fn parse_speed(text: &str) -> Result<f32, String> {
    let speed = text
        .parse()
        .ok()
        .filter(|speed| (0.1..=10.0).contains(speed));
    speed.ok_or_else(|| "expected a speed of 0.1 to 10".into())
}
