//! What may stand on the command line.

use std::path::PathBuf;
use std::str::FromStr;

use clap::{Args, Parser, Subcommand, ValueEnum};
use clap_complete::Shell;
use lamogen::files::{Unit, Up};
use lamogen::laban::GoalError;
use lamogen::model::Precision;
use lamogen::{
    Body, COMPONENTS, Component, DeviceName, Goal, PartScale, Preset, Request, Scale,
    TemporalSmoothing,
};
use serde::{Deserialize, Serialize};

use lamogen_data::Split;

use crate::eval::{Measure, Method, Study};
use crate::goals::Asked;
use crate::output::{Format, Output};

/// Human motion from a sentence and a few words of Laban movement analysis.
///
/// A text-to-motion model gives the motion that the sentence describes; then it is guided so that the motion
/// becomes strong or light, sudden or sustained, bound or free, near or far.
#[derive(Parser)]
#[command(
    name = "lamogen",
    version,
    subcommand_required = true,
    disable_help_subcommand = true,
    arg_required_else_help = true,
    after_help = "Exit codes: 0 done, 1 a motion could not be generated, 2 wrong arguments or requests, \
                  3 a file or model could not be read, 4 a file could not be written, 5 a batch is done \
                  but for some motions, 6 a training stopped before its last step, 130 ended by a signal."
)]
pub struct Arguments {
    #[command(subcommand)]
    pub task: Task,
    #[command(flatten)]
    pub console: ConsoleArguments,
}

/// What is said while working.
#[derive(Args)]
pub struct ConsoleArguments {
    /// Print the result as JSON, for machines.
    #[arg(long, global = true)]
    pub json: bool,
    /// Print no progress and no notices.
    #[arg(long, short, global = true)]
    pub quiet: bool,
}

#[derive(Subcommand)]
pub enum Task {
    /// Generate a motion from a sentence.
    #[command(after_help = GENERATE_HELP)]
    Generate(Box<Generate>),
    /// Measure a motion file: Weight, Time, Flow, Shape, their peaks, sliding feet, drifting bones, joints that twitch.
    Laban(Laban),
    /// Convert a motion file to another format, or to a picture of it.
    Convert(Convert),
    /// Show motion files in the browser, in 3D.
    Play(Play),
    /// Generate many motions from a file of requests; goes on where it was stopped.
    #[command(after_help = BATCH_HELP)]
    Batch(Batch),
    /// Pack motion capture with captions for training: HumanML3D's folder, or motion files.
    #[command(after_help = PACK_HELP)]
    Pack(Pack),
    /// Make variations of a data set's motions, with other Laban features, for training a network that is told them.
    Vary(Vary),
    /// Check the paper's claims on a model: its tables and ablations, as a report; goes on where it was stopped.
    #[command(after_help = EVAL_HELP)]
    Eval(Eval),
    /// Train a model on motion capture with captions; goes on where it was stopped.
    #[command(after_help = TRAIN_HELP)]
    Train(Train),
    /// List where this program can compute on this machine.
    Devices,
    /// Look at a model's files, or convert them.
    #[command(subcommand)]
    Model(Model),
    /// Print the help of a command, or a topic: model-folder, data, recipe, sentences.
    Help {
        /// The command and its parts, or the topic.
        words: Vec<String>,
    },
    /// Print a shell's completions of this command.
    Completions {
        /// The shell.
        shell: Shell,
    },
    /// Print this command's manual page, or write those of all its parts.
    Man {
        /// Folder for one page each part.
        #[arg(long)]
        out: Option<PathBuf>,
    },
}

const GENERATE_HELP: &str = "\
Factors are numbers, words, or keys over time: --weight strong, --weight 1.5, --weight \"0:1 1:1.5 2:0.5\" \
(second:factor, each holds until the next; with ~ between two keys the factor slides). Instead of a factor peak= and mean= ask \
for a value, in the unit that lamogen laban prints, and any for nothing at all.

Files: .glb and .bvh for Blender and engines, .npy (joints) and .features.npy for NumPy, .html a page that \
plays the motion, .gif, .svg and .png pictures, .csv the Laban series, .json everything.

Examples:
  lamogen generate \"a person jumps\" --weight strong --time sudden --seconds 4 --seed 7 --out jump.glb
  lamogen generate \"a person walks\" --weight \"0:light 2:strong\" --emphasis 10 --out walk.html
  lamogen generate \"a person walks\" --part arms:strong --part legs:light --out arms.html
  lamogen generate \"a person dances\" --like dance.bvh --shape any --out alike.html
  lamogen generate \"a person waves\" --shape far --samples 4 --out wave.gif";

const BATCH_HELP: &str = "\
Every line of the file is a request as JSON, with fields that mean what they mean to lamogen generate:
  {\"prompt\": \"a person jumps\", \"weight\": \"strong\", \"time\": 1.2, \"seconds\": 4, \"seed\": 7, \"id\": \"jump\"}
Only the prompt must be there. A motion's files are named by its id (letters A to Z and a to z, digits, - _ and .), or by its \
line's number.

A motion counts as finished once its .json is there and says the same request, options and files; it is not made \
again. Parts of the work go to several machines or jobs by --shard: 1/4, 2/4, 3/4, 4/4.";

const PACK_HELP: &str = "\
A source is a folder of HumanML3D's form (new_joint_vecs, texts, train.txt, val.txt, test.txt), a packed folder, or any \
folder of motion files with --captions: a line is a file, a tab and a caption, or JSON:
  {\"file\": \"walk.bvh\", \"captions\": [\"a person walks\"], \"split\": \"train\", \"start\": 1.5, \"end\": 6}
split (train, val, test), content, style, source, start and end (seconds) may be left out; captions of several lines about \
the same part of a file are put together.

Motion files are resampled to 20 frames a second and put on HumanML3D's body. Mirror images of the motions for training \
share the rows of their originals; left and right are exchanged in what is said of them.";

const EVAL_HELP: &str = "\
The folder gets records.jsonl (a line a motion), eval.json (of what), report.html, report.md with its pictures, and figures.json. Stop it \
whenever you like: the same command goes on. Parts of the work go to several machines or jobs by --shard: 1/4, 2/4, 3/4, 4/4; with all \
their records and one eval.json in one folder, --merge writes the report.

Example:
  lamogen train --evaluator --data data --out judge --steps 1000
  lamogen eval --data data --evaluator judge/best --out evidence --dry-run
  lamogen eval --data data --evaluator judge/best --out evidence";

const TRAIN_HELP: &str = "\
The folder of the run gets losses.jsonl and losses.svg, sample strips, checkpoints, model/ (the last measured weights) and best/ \
(those with the lowest validation loss); both are folders for --model. Ctrl-C stops with a checkpoint.

Example:
  lamogen pack HumanML3D --out data
  lamogen train --data data --config compact --out run --minutes 60
  lamogen generate \"a person jumps\" --model run/model --out jump.html";

/// Which model, and where it runs.
#[derive(Args, Clone)]
pub struct SourceArguments {
    /// Folder of a model instead of the embedded one.
    #[arg(long, value_name = "FOLDER")]
    pub model: Option<PathBuf>,
    /// Smooth predictions along time by a Gaussian of so many frames, such as 1, while there is much noise, so that the legs of a
    /// small network keep step; or off. Usually what the model's config.json says: 1 for the embedded model, off where it says nothing.
    #[arg(long, alias = "coherence", value_name = "FRAMES")]
    pub temporal_smoothing: Option<TemporalSmoothingChoice>,
    /// How strongly motions follow the sentence, by classifier-free guidance: 1 asks the network once a step, others, such as 2.5, twice. Usually
    /// what the model's config.json says: 2 for the embedded model, 1 where it says nothing. For models that were trained with text dropout.
    #[arg(long, value_name = "SCALE")]
    pub text_scale: Option<f64>,
    /// Where to compute; lamogen devices lists them.
    #[arg(long)]
    pub device: Option<DeviceName>,
}

/// Frames to smooth by, or `off`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TemporalSmoothingChoice(pub Option<TemporalSmoothing>);

impl FromStr for TemporalSmoothingChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "off" {
            return Ok(TemporalSmoothingChoice(None));
        }
        let frames: f32 = { text.parse() }
            .map_err(|_| format!("expected a number of frames such as 1, or off, found {text}"))?;
        let temporal_smoothing = TemporalSmoothing {
            frames,
            ..TemporalSmoothing::default()
        };
        match temporal_smoothing.check() {
            Ok(()) => Ok(TemporalSmoothingChoice(Some(temporal_smoothing))),
            Err(error) => Err(error.to_string()),
        }
    }
}

/// How passes run.
#[derive(Args, Clone)]
pub struct PassArguments {
    /// DDIM steps of each pass, 1 to 1000.
    #[arg(long)]
    pub steps: Option<usize>,
    /// Steps and guidance together: precise is the embedded model's default, paper that of others.
    #[arg(long, value_enum)]
    pub preset: Option<PresetName>,
    /// How much the components that shall change count in the loss beside those that shall not: more follows
    /// the factors more exactly and keeps the others less.
    #[arg(long, value_name = "WEIGHT")]
    pub emphasis: Option<f32>,
    /// Whose motion is measured, guided and written: that of a rigid body, or the network's, whose bones may stretch. Precise and fast
    /// have the rig, paper has the network.
    #[arg(long, value_enum)]
    pub body: Option<BodyName>,
}

/// Whose motion is measured and written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum BodyName {
    Rig,
    Network,
}

impl BodyName {
    pub fn name(self) -> &'static str {
        match self {
            BodyName::Rig => "rig",
            BodyName::Network => "network",
        }
    }

    /// The name of what guidance works on.
    pub fn of(body: Body) -> BodyName {
        match body {
            Body::Rig => BodyName::Rig,
            Body::Network => BodyName::Network,
        }
    }

    fn body(self) -> Body {
        match self {
            BodyName::Rig => Body::Rig,
            BodyName::Network => Body::Network,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PresetName {
    Precise,
    Fast,
    Paper,
}

impl PresetName {
    pub fn preset(self) -> Preset {
        match self {
            PresetName::Precise => Preset::Precise,
            PresetName::Fast => Preset::Fast,
            PresetName::Paper => Preset::Paper,
        }
    }
}

impl PassArguments {
    /// Sets them on a request. `default` is what the model runs with if nothing is said.
    pub fn apply(&self, mut request: Request, default: Preset) -> Request {
        let preset = self.preset.map_or(default, PresetName::preset);
        request = request.preset(preset);
        if let Some(steps) = self.steps {
            request = request.steps(steps);
        }
        let mut guidance = preset.guidance();
        if let Some(emphasis) = self.emphasis {
            guidance.emphasis = [emphasis; COMPONENTS];
        }
        if let Some(body) = self.body {
            guidance.body = body.body();
        }
        request.guidance(guidance)
    }
}

/// What the components shall become.
#[derive(Args, Clone)]
pub struct GoalArguments {
    /// Weight (kinetic energy): light, strong, a factor, keys over time, peak=, mean=, or any.
    #[arg(long, value_name = "GOAL", value_parser = goal(Component::Weight))]
    pub weight: Option<Goal>,
    /// Time (acceleration): sustained, sudden, a factor, keys over time, peak=, mean=, or any.
    #[arg(long, value_name = "GOAL", value_parser = goal(Component::Time))]
    pub time: Option<Goal>,
    /// Flow (jerk): bound, free, a factor, keys over time, peak=, mean=, or any.
    #[arg(long, value_name = "GOAL", value_parser = goal(Component::Flow))]
    pub flow: Option<Goal>,
    /// Shape (the room that the body takes): near, far, a factor, keys over time, peak=, mean=, or any.
    #[arg(long, value_name = "GOAL", value_parser = goal(Component::Shape))]
    pub shape: Option<Goal>,
    /// Factors on Weight, Time, Flow and Shape at once, such as 1.5,1.2,1,1.
    #[arg(long, value_name = "W,T,F,S", value_parser = scale, conflicts_with_all = ["weight", "time", "flow", "shape"])]
    pub scale: Option<Scale>,
    /// A motion file whose Weight, Time, Flow and Shape shall be reached, stretched to this motion's length; --weight and the others
    /// replace what it says of them. Beside parts, Weight, Time and Flow need factors or any instead.
    #[arg(long, value_name = "FILE", conflicts_with = "scale")]
    pub like: Option<PathBuf>,
    /// A part of the body with factors of its own on Weight, Time and Flow, such as arms:strong,sudden or left-leg:weight=0.7; parts
    /// are arms, left-arm, right-arm, legs, left-leg, right-leg, head and torso. May be given several times;
    /// --weight, --time and --flow are then factors on the rest of the body.
    #[arg(long, value_name = "PART:WORDS")]
    pub part: Vec<PartScale>,
}

impl GoalArguments {
    /// All that is asked for.
    pub fn asked(&self) -> Asked {
        Asked {
            goals: [&self.weight, &self.time, &self.flow, &self.shape].map(Clone::clone),
            scale: self.scale,
            like: self.like.clone(),
            parts: self.part.clone(),
        }
    }
}

fn goal(
    component: Component,
) -> impl Fn(&str) -> Result<Goal, GoalError> + Clone + Send + Sync + 'static {
    move |text| Goal::parse(component, text)
}

fn scale(text: &str) -> Result<Scale, String> {
    let numbers: Result<Vec<f32>, _> = text.split(',').map(|part| part.trim().parse()).collect();
    let factors = numbers.ok().and_then(|numbers| numbers.try_into().ok());
    let factors = factors.ok_or("expected four numbers with commas, such as 1.5,1.2,1,1")?;
    Scale::new(factors).map_err(|error| error.to_string())
}

/// How motion files are written.
#[derive(Args, Clone)]
pub struct WritingArguments {
    /// Frames a second of .bvh and .glb.
    #[arg(long, default_value_t = 20.0, value_parser = fps)]
    pub fps: f32,
    /// Unit of .bvh: cm, m, dm, mm, in, cmu, or a number of metres.
    #[arg(long, default_value = "cm")]
    pub bvh_unit: Unit,
    /// Names of the joints in .bvh.
    #[arg(long, value_enum, default_value = "humanml3d")]
    pub bvh_names: BvhNamesName,
    /// Width of .gif in pixels; usually 320 a motion.
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(160..=4096))]
    pub gif_width: Option<u32>,
}

impl WritingArguments {
    /// The options that change nothing in files of these formats, each in a sentence.
    pub fn unused(&self, formats: &[Format]) -> Vec<String> {
        let given = [
            ("--fps", self.fps != 20.0, &[Format::Bvh, Format::Glb][..]),
            (
                "--bvh-unit",
                self.bvh_unit != Unit::Centimetre,
                &[Format::Bvh],
            ),
            (
                "--bvh-names",
                self.bvh_names != BvhNamesName::HumanMl3d,
                &[Format::Bvh],
            ),
            ("--gif-width", self.gif_width.is_some(), &[Format::Gif]),
        ];
        let unused = given
            .into_iter()
            .filter(|(_, is_given, of)| *is_given && !of.iter().any(|one| formats.contains(one)));
        unused
            .map(|(option, _, of)| {
                let endings: Vec<String> =
                    of.iter().map(|one| format!(".{}", one.ending())).collect();
                format!(
                    "{option} changes nothing here: it is for {}",
                    endings.join(" and ")
                )
            })
            .collect()
    }
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum BvhNamesName {
    #[value(name = "humanml3d")]
    HumanMl3d,
    Mixamo,
}

impl BvhNamesName {
    pub fn name(self) -> &'static str {
        match self {
            BvhNamesName::HumanMl3d => "humanml3d",
            BvhNamesName::Mixamo => "mixamo",
        }
    }
}

fn fps(text: &str) -> Result<f32, String> {
    let rate = text
        .parse()
        .ok()
        .filter(|rate| (0.001..=10_000.0).contains(rate));
    rate.ok_or_else(|| "expected 0.001 to 10000 frames a second".into())
}

fn two_factors(text: &str) -> Result<[f32; 2], String> {
    let numbers: Result<Vec<f32>, _> = text.split(',').map(|part| part.trim().parse()).collect();
    let factors = numbers.ok().and_then(|numbers| numbers.try_into().ok());
    factors.ok_or_else(|| "expected two factors with a comma, such as 0.35,2.2".into())
}

fn speed(text: &str) -> Result<f32, String> {
    let speed = text
        .parse()
        .ok()
        .filter(|speed| (0.1..=10.0).contains(speed));
    speed.ok_or_else(|| "expected a speed of 0.1 to 10".into())
}

/// How motion files are read.
#[derive(Args, Clone)]
pub struct ReadingArguments {
    /// Unit of the file: m, dm, cm, mm, in, cmu, or a number of metres; usually told by the body's size.
    #[arg(long)]
    pub unit: Option<Unit>,
    /// Axis of the file that points up, y, z, -y or -z; usually told by the body.
    #[arg(long, allow_hyphen_values = true)]
    pub up: Option<Up>,
    /// Frames a second of a .bvh, in place of what it says, or of a .npy, which says nothing and is taken for one of 20.
    #[arg(long, value_name = "FPS", value_parser = fps)]
    pub input_fps: Option<f32>,
    /// Animation of a .glb or .gltf, by its name; usually the first.
    #[arg(long, value_name = "NAME")]
    pub animation: Option<String>,
    /// JointMapping file for a skeleton with unknown names: a JSON object such as {"pelvis": "Root", …}.
    #[arg(long, value_name = "MAPPING")]
    pub names: Option<PathBuf>,
    /// Format of standard input, where the file is -; usually told by its first bytes.
    #[arg(long, value_name = "FORMAT")]
    pub from: Option<StreamFormat>,
}

/// A format of motion that may come in by standard input.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum StreamFormat {
    Bvh,
    Glb,
    Gltf,
    Npy,
}

impl StreamFormat {
    /// How names of such files end.
    pub fn ending(self) -> &'static str {
        match self {
            StreamFormat::Bvh => "bvh",
            StreamFormat::Glb => "glb",
            StreamFormat::Gltf => "gltf",
            StreamFormat::Npy => "npy",
        }
    }

    /// What the first bytes say.
    pub fn told_by(bytes: &[u8]) -> Option<StreamFormat> {
        let text = bytes.trim_ascii_start();
        let starts = |beginning: &[u8]| text.starts_with(beginning);
        if bytes.starts_with(b"glTF") {
            Some(StreamFormat::Glb)
        } else if bytes.starts_with(b"\x93NUMPY") {
            Some(StreamFormat::Npy)
        } else if starts(b"{") {
            Some(StreamFormat::Gltf)
        } else if text.len() >= 9 && text[..9].eq_ignore_ascii_case(b"HIERARCHY") {
            Some(StreamFormat::Bvh)
        } else {
            None
        }
    }
}

#[derive(Args)]
#[command(allow_negative_numbers = true)]
pub struct Generate {
    /// What the person does, such as "a person jumps".
    pub prompt: String,
    #[command(flatten)]
    pub goals: GoalArguments,
    /// Length in seconds: 2 to 9.8 with the embedded model and most others.
    #[arg(long, default_value_t = 3.0)]
    pub seconds: f32,
    /// Seed of the start noise: the same seed gives the same motion.
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// How many motions, from as many seeds: this one and the next. Files are then named by their seed.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub samples: u32,
    /// File to write; its ending says which format. May be given several times.
    #[arg(long, short, value_name = "FILE", default_value = "motion.html")]
    pub out: Vec<Output>,
    /// Only the motion of the text alone.
    #[arg(long, conflicts_with_all = ["weight", "time", "flow", "shape", "scale", "like", "part", "emphasis"])]
    pub baseline_only: bool,
    #[command(flatten)]
    pub pass: PassArguments,
    #[command(flatten)]
    pub source: SourceArguments,
    #[command(flatten)]
    pub writing: WritingArguments,
}

#[derive(Args)]
pub struct Laban {
    /// Motion files: .bvh, .glb, .gltf or .npy; - is standard input.
    #[arg(required = true)]
    pub files: Vec<PathBuf>,
    /// A motion to compare each of them with.
    #[arg(long, value_name = "OTHER")]
    pub compare: Option<PathBuf>,
    #[command(flatten)]
    pub reading: ReadingArguments,
}

#[derive(Args)]
pub struct Convert {
    /// The file to read: .bvh, .glb, .gltf or .npy; - is standard input.
    #[arg(value_name = "FROM")]
    pub source: PathBuf,
    /// The file to write: .bvh, .glb, .npy, .features.npy, .csv (Laban series), .svg, .png, .gif, .html or .json.
    pub to: Output,
    /// Give the motion rigid bones and feet that stand where they stand: they neither slide nor sink into the ground, which is taken to be as
    /// low as the feet come.
    #[arg(long)]
    pub clean_feet: bool,
    #[command(flatten)]
    pub reading: ReadingArguments,
    #[command(flatten)]
    pub writing: WritingArguments,
}

#[derive(Args)]
pub struct Play {
    /// Motion files, up to four: .bvh, .glb, .gltf or .npy.
    #[arg(required = true, num_args = 1..=4)]
    pub files: Vec<PathBuf>,
    /// Where to write the page; usually among the temporary files.
    #[arg(long, short, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Write the page, but do not open it.
    #[arg(long)]
    pub no_open: bool,
    #[command(flatten)]
    pub reading: ReadingArguments,
}

#[derive(Args)]
pub struct Pack {
    /// The folder to read; several data sets become one.
    #[arg(required = true, value_name = "SOURCE")]
    pub sources: Vec<PathBuf>,
    /// Folder to write.
    #[arg(long, short, value_name = "FOLDER")]
    pub out: PathBuf,
    /// What is said of motion files, a line each.
    #[arg(long, value_name = "FILE")]
    pub captions: Option<PathBuf>,
    /// Further captions of motions that have some, a line of JSON each: {"name": "run_3", "captions": ["a kid dashes off"]}.
    #[arg(long, value_name = "FILE")]
    pub more_captions: Option<PathBuf>,
    /// Add motions for training at other speeds, such as 0.8,1.25, but for those that leave the ground or whose captions say how fast they are.
    #[arg(long, value_delimiter = ',', value_parser = speed)]
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
    pub reading: ReadingArguments,
}

#[derive(Args)]
pub struct Vary {
    /// The data set.
    pub data: PathBuf,
    /// Folder to write: the data set with its variations. Until all are made, they are kept beside it in a folder with .work behind its name,
    /// and the same command goes on after a stop.
    #[arg(long, short, value_name = "FOLDER")]
    pub out: PathBuf,
    /// Variations of every motion for training.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u16).range(1..=100))]
    pub count: u16,
    /// The smallest and the largest factor on a component.
    #[arg(long, default_value = "0.35,2.2", value_name = "LEAST,MOST", value_parser = two_factors)]
    pub factors: [f32; 2],
    /// By what factors are drawn.
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// Where to compute; lamogen devices lists them.
    #[arg(long)]
    pub device: Option<DeviceName>,
    /// Replace a packed folder that is already there.
    #[arg(long)]
    pub force: bool,
}

#[derive(Args)]
#[command(allow_negative_numbers = true)]
pub struct Batch {
    /// The requests, one JSON object a line; - is standard input.
    pub requests: PathBuf,
    /// Folder for the files.
    #[arg(long, short, value_name = "FOLDER")]
    pub out: PathBuf,
    /// Formats to write beside each motion's .json.
    #[arg(long, value_enum, value_delimiter = ',', default_value = "glb")]
    pub format: Vec<Format>,
    /// Which part of the lines to work on: 2/8 is the second of eight.
    #[arg(long, value_name = "I/N", value_parser = shard)]
    pub shard: Option<(usize, usize)>,
    /// How many motions run together: usually 1 on a CPU, where each is then exactly the motion that generate gives, and 8 on a GPU.
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub batch_size: Option<u32>,
    #[command(flatten)]
    pub pass: PassArguments,
    #[command(flatten)]
    pub source: SourceArguments,
    #[command(flatten)]
    pub writing: WritingArguments,
}

fn shard(text: &str) -> Result<(usize, usize), String> {
    let parts = text.split_once('/');
    let numbers = parts.and_then(|(i, n)| Some((i.parse().ok()?, n.parse().ok()?)));
    match numbers {
        Some((i, n)) if (1..=n).contains(&i) => Ok((i, n)),
        _ => Err("expected a part of a whole, such as 2/8, from 1/8 to 8/8".into()),
    }
}

#[derive(Args)]
pub struct Eval {
    #[command(flatten)]
    pub source: SourceArguments,
    /// Folder of the data: packed by lamogen pack, or HumanML3D's.
    #[arg(long, value_name = "FOLDER")]
    pub data: PathBuf,
    /// Folder of the evaluator, as lamogen train --evaluator leaves it in best.
    #[arg(long, value_name = "FOLDER")]
    pub evaluator: PathBuf,
    /// Folder for the records and the report.
    #[arg(long, short, value_name = "FOLDER")]
    pub out: PathBuf,
    /// Which motions' sentences: train, val or test.
    #[arg(long, default_value = "test")]
    pub split: Split,
    /// How many sentences, at least 2; usually all. R-precision needs 32.
    #[arg(long, value_name = "N", value_parser = sentences)]
    pub prompts: Option<u64>,
    /// Motions of each sentence, from as many seeds; intervals are over these.
    #[arg(long, default_value_t = 1, value_name = "R", value_parser = clap::value_parser!(u64).range(1..=1000))]
    pub repeats: u64,
    /// Steps and guidance together; usually the model's own.
    #[arg(long, value_enum)]
    pub preset: Option<PresetName>,
    /// DDIM steps of each pass; usually the preset's.
    #[arg(long, value_parser = steps)]
    pub steps: Option<usize>,
    /// DDIM steps where the start noise is moved: each of its updates is a pass.
    #[arg(long, default_value_t = 10, value_parser = steps)]
    pub noise_steps: usize,
    /// What is compared with the text alone.
    #[arg(long, value_enum, value_delimiter = ',', num_args = 0.., default_values = ["laban", "embedding", "prompt", "raw", "classifier", "noise"])]
    pub methods: Vec<Method>,
    /// What is varied; --studies without a name leaves all out.
    #[arg(long, value_enum, value_delimiter = ',', num_args = 0.., default_values = ["interpolation", "pareto-front", "presets", "learning-rate", "rise", "steps", "update", "updates", "finish", "divisor", "smoothing"])]
    pub studies: Vec<Study>,
    /// On what motions are measured.
    #[arg(long, value_enum, default_value = "rig")]
    pub measure: Measure,
    /// How many sentences each study is made with, at least 2.
    #[arg(long, default_value_t = 64, value_name = "N", value_parser = sentences)]
    pub study_prompts: u64,
    /// Do a part of the work only: the I-th of N.
    #[arg(long, value_name = "I/N", value_parser = shard, conflicts_with = "merge")]
    pub shard: Option<(usize, usize)>,
    /// Make none of the motions that are missing, but those of the pictures: write the report of the records in the folder. Give it the
    /// options of the run; what they ask for and is not there is left out.
    #[arg(long)]
    pub merge: bool,
    /// Check the files, and say what there is still to do, in all shards together, and how long it takes, by trying some motions of each
    /// kind.
    #[arg(long, conflicts_with_all = ["merge", "shard"])]
    pub dry_run: bool,
}

fn sentences(text: &str) -> Result<u64, String> {
    let count = text.parse().ok().filter(|count| *count >= 2);
    count.ok_or_else(|| "expected at least 2 sentences".into())
}

fn steps(text: &str) -> Result<usize, String> {
    let steps = text.parse().ok();
    let steps = steps.filter(|steps| (1..=1000).contains(steps));
    steps.ok_or_else(|| "expected 1 to 1000 steps".into())
}

#[derive(Args)]
pub struct Train {
    /// Folder of the data: packed by lamogen pack, or HumanML3D's.
    #[arg(long, value_name = "FOLDER")]
    pub data: PathBuf,
    /// What to train, and how: compact, a recipe for a network as large as the embedded one, or a JSON file.
    #[arg(long, default_value = "compact", value_name = "FILE")]
    pub config: PathBuf,
    /// Folder of the run. If a run was stopped there, the same command goes on with it.
    #[arg(long, short, value_name = "RUN")]
    pub out: PathBuf,
    /// Train the network that judges how well motions match texts, instead of one that generates; compact is then its recipe.
    #[arg(long)]
    pub evaluator: bool,
    /// How many steps.
    #[arg(long, conflicts_with = "minutes", required_unless_present = "minutes", value_parser = clap::value_parser!(u64).range(1..))]
    pub steps: Option<u64>,
    /// As many steps as fit into this time, going by the first ones.
    #[arg(long, value_parser = minutes)]
    pub minutes: Option<f64>,
    /// Stop after so many minutes, with a checkpoint; the same command goes on later.
    #[arg(long, alias = "sitting", value_name = "MINUTES", value_parser = minutes)]
    pub time_limit: Option<f64>,
    /// Begin with the weights of a model, a folder or embedded, instead of fresh ones; its sizes, tokenizer and statistics are kept,
    /// and its licence where none is given.
    #[arg(long, value_name = "MODEL", conflicts_with_all = ["evaluator", "tokenizer"])]
    pub from: Option<PathBuf>,
    /// A tokenizer.json; without one it is CLIP's for a network with CLIP's vocabulary, else learned from the captions.
    #[arg(long, value_name = "FILE")]
    pub tokenizer: Option<PathBuf>,
    /// Embeddings of sentences by a sentence encoder, one a row, with the sentences in the .txt beside it: what a recipe with sentences_per_batch
    /// teaches the text encoder.
    #[arg(long, value_name = "FILE.npy", conflicts_with = "evaluator")]
    pub sentences: Option<PathBuf>,
    /// Steps between two measurements on the validation split, with pictures.
    #[arg(long, default_value_t = 500, value_name = "STEPS", value_parser = clap::value_parser!(u64).range(1..))]
    pub validate_every: u64,
    /// Minutes between two checkpoints.
    #[arg(long, default_value_t = 5.0, value_name = "MINUTES", value_parser = minutes)]
    pub checkpoint_minutes: f64,
    /// Sentence for the sample pictures, several times for several; usually captions of the data.
    #[arg(long, value_name = "SENTENCE", conflicts_with = "evaluator")]
    pub sample: Vec<String>,
    /// Licence of the weights, as an SPDX identifier; it travels in the file.
    #[arg(long)]
    pub license: Option<String>,
    /// Whom to name when the weights or what they make is passed on.
    #[arg(long)]
    pub attribution: Option<String>,
    /// Where to compute; lamogen devices lists them.
    #[arg(long)]
    pub device: Option<DeviceName>,
}

fn minutes(text: &str) -> Result<f64, String> {
    let minutes = text.parse().ok();
    let minutes = minutes.filter(|minutes| (0.0..=1e6).contains(minutes));
    minutes.ok_or_else(|| "expected 0 to 1000000 minutes".into())
}

#[derive(Subcommand)]
pub enum Model {
    /// Say what a model is: sizes, licence, lengths, defaults.
    Info {
        /// Folder of the model; the embedded one without.
        folder: Option<PathBuf>,
    },
    /// Convert a checkpoint to safetensors: half the size in 16 bits, a quarter in 8, and no pickle.
    Convert {
        /// A latest.tar of MotionDiffuse, or a file in safetensors.
        from: PathBuf,
        /// The file to write, ending in .safetensors.
        to: PathBuf,
        /// Bits a stored number: 32, 16, or 8 with a scale for each row of a matrix, off by at most a 254th of the largest of the row.
        #[arg(long, default_value = "32")]
        bits: Precision,
        /// The same as --bits 16.
        #[arg(long, conflicts_with = "bits")]
        half: bool,
        /// Licence of the weights, as an SPDX identifier; it travels in the file.
        #[arg(long)]
        license: Option<String>,
        /// Whom to name when the weights or what they make is passed on.
        #[arg(long)]
        attribution: Option<String>,
        /// Let --license and --attribution replace others that the file states: for whoever owns the weights.
        #[arg(long)]
        force: bool,
    },
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_arguments_are_consistent() {
        Arguments::command().debug_assert();
    }

    #[test]
    fn goals_are_words_numbers_keys_or_values_of_their_own_component() {
        let parse = |arguments: &[&str]| {
            let all = [&["lamogen", "generate", "a person jumps"], arguments].concat();
            Arguments::try_parse_from(all).map(|arguments| match arguments.task {
                Task::Generate(options) => {
                    options.goals.asked().goals(&lamogen::Device::flex()).ok()?
                }
                _ => None,
            })
        };
        assert_eq!(parse(&[]).unwrap(), None);
        let goals = parse(&["--weight", "0:1 1:1.5 2:0.5", "--time", "sudden"]);
        let goals = goals.unwrap().unwrap();
        assert_eq!(goals.scale().at(1.5), [1.5, 1.2, 1.0, 1.0]);
        let goals = parse(&["--scale", "1.5, 1.2,1,0.5", "--part", "arms:light"]);
        let goals = goals.unwrap().unwrap();
        assert_eq!(goals.scale().at(0.0), [1.5, 1.2, 1.0, 0.5]);
        assert_eq!(goals.parts().len(), 1);
        let goals = parse(&["--shape", "peak=1.5", "--flow", "any"]);
        let goals = goals.unwrap().unwrap();
        assert_eq!(goals.to_string(), "Flow any, Shape peak=1.5");
        for (wrong, part) in [
            (&["--weight", "sudden"][..], "speaks of Time"),
            (&["--scale", "1,2,3"], "four numbers"),
            (&["--scale", "1,2,3,-1"], "at least 0"),
            (
                &["--scale", "1,1,1,1", "--flow", "free"],
                "cannot be used with",
            ),
            (
                &["--baseline-only", "--flow", "free"],
                "cannot be used with",
            ),
            (
                &["--baseline-only", "--part", "arms:strong"],
                "cannot be used with",
            ),
            (
                &["--scale", "1,1,1,1", "--like", "a.bvh"],
                "cannot be used with",
            ),
            (&["--part", "arms:far"], "Shape is of the whole body"),
            (&["--shape", "mean=-1"], "at least 0"),
            (&["--samples", "0"], "1..=10000"),
        ] {
            let message = parse(wrong).unwrap_err().to_string();
            assert!(message.contains(part), "{message}");
        }
    }

    #[test]
    fn shards_are_counted_from_one() {
        assert_eq!(shard("2/8"), Ok((2, 8)));
        for wrong in ["0/8", "9/8", "1", "a/b", "1/0", "-1/2"] {
            assert!(shard(wrong).is_err(), "{wrong}");
        }
    }
}
