//! Arguments that several commands share.

use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::{Arc, OnceLock};

use clap::{Args, ValueEnum};
use lamogen::character::{Character, CharacterOptions};
use lamogen::files::{JointMapping, Unit, UpAxis};
use lamogen::model::SamplingMethod;
use lamogen::{Body, COMPONENTS, DeviceName, Preset, Request, RootMotion, TemporalSmoothing};

use crate::failure::{Failure, FailureCode};
use crate::output::OutputFormat;

/// The model, its sampling options, and the device that it runs on.
#[derive(Args, Clone)]
pub struct ModelArguments {
    /// Folder of a model instead of the embedded one.
    #[arg(long, value_name = "FOLDER")]
    pub model: Option<PathBuf>,
    /// Smooth predictions along time by a Gaussian of so many frames, such as 1, while there is much noise, so that the legs of a
    /// small network keep step; or off. Usually what the model's config.json says: 1 for the embedded model, off where it says nothing.
    #[arg(long, alias = "coherence", value_name = "FRAMES")]
    pub temporal_smoothing: Option<TemporalSmoothingChoice>,
    /// How strongly motions follow the sentence, by classifier-free guidance: 1 asks the network once a step, others, such as 2.5, twice. Usually
    /// what the model's config.json says: 3 for the embedded model, 1 where it says nothing. For models that were trained with text dropout.
    #[arg(long, value_name = "SCALE")]
    pub text_scale: Option<f64>,
    /// Scale only predictions at this timestep and noisier ones; below it, the network is asked once a step. What a motion does is decided
    /// while there is much noise. Usually what the model's config.json says: 500 of 1000 for the embedded model, 0 where it says nothing.
    #[arg(long, value_name = "TIMESTEP")]
    pub text_scale_until: Option<usize>,
    /// How a step of sampling goes on: ddim, where the start noise decides the motion, or ddpm, which draws noise at each step. Usually what the
    /// model's authors do: ddpm for MDM, ddim for all others.
    #[arg(long, value_name = "METHOD")]
    pub sampler: Option<SamplingMethod>,
    /// Where to compute; lamogen devices lists them.
    #[arg(long)]
    pub device: Option<DeviceName>,
}

/// The value of `--temporal-smoothing`: a number of frames, or `off`.
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

/// The options of the passes of the network.
#[derive(Args, Clone, Default)]
pub struct PassArguments {
    /// DDIM steps of each pass, 1 to 1000.
    #[arg(long)]
    pub steps: Option<usize>,
    /// Steps and guidance together: precise is the embedded model's default, paper that of other MotionDiffuse models, fast that of MDM.
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
    /// Make the motion a loop: its last frame leads into the first, in pose and velocity.
    #[arg(long = "loop")]
    pub is_looped: bool,
}

impl PassArguments {
    /// Sets the options on a request. `default` is the preset of the model, for arguments without a preset.
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
        request.guidance(guidance).looped(self.is_looped)
    }
}

/// The value of `--preset`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
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

    /// Returns the name of a preset.
    pub fn of(preset: Preset) -> PresetName {
        match preset {
            Preset::Precise => PresetName::Precise,
            Preset::Fast => PresetName::Fast,
            Preset::Paper => PresetName::Paper,
        }
    }
}

/// The value of `--body`: the body of the motion that is measured, guided and written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
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

    /// Returns the name of the body that guidance works on.
    pub fn of(body: Body) -> BodyName {
        match body {
            Body::Rig => BodyName::Rig,
            Body::Network => BodyName::Network,
        }
    }

    pub fn body(self) -> Body {
        match self {
            BodyName::Rig => Body::Rig,
            BodyName::Network => Body::Network,
        }
    }
}

/// The options of writing motion files.
#[derive(Args, Clone)]
pub struct WritingArguments {
    /// Frames a second of .glb, .bvh, .vrma and .npy; usually 20, which are exactly the motion's own, and 30 in .vrma and on a character.
    #[arg(long, value_parser = parse_fps)]
    pub fps: Option<f32>,
    /// Unit of .bvh: cm, m, dm, mm, in, cmu, or a number of metres.
    #[arg(long, default_value = "cm")]
    pub bvh_unit: Unit,
    /// Names of the joints in .bvh.
    #[arg(long, value_enum, default_value = "humanml3d")]
    pub bvh_names: BvhNaming,
    /// Width of .gif in pixels; usually 320 a motion.
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(160..=4096))]
    pub gif_width: Option<u32>,
    /// Where the travel along the ground goes: into the hips, as in Blender (the default); into a root node above them, as game
    /// engines want it; or nowhere, so that planted feet slide under a body that stays in place.
    #[arg(long, value_enum, value_name = "PLACE")]
    pub root_motion: Option<RootMotionName>,
    /// Keep the body in place: short for --root-motion none.
    #[arg(long, conflicts_with = "root_motion")]
    pub in_place: bool,
    #[command(flatten)]
    pub onto: OntoArguments,
}

/// The value of `--root-motion`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum RootMotionName {
    Hips,
    Root,
    None,
}

impl RootMotionName {
    fn root_motion(self) -> RootMotion {
        match self {
            RootMotionName::Hips => RootMotion::Hips,
            RootMotionName::Root => RootMotion::Root,
            RootMotionName::None => RootMotion::None,
        }
    }
}

/// The options of writing motions onto a character.
#[derive(Args, Clone, Default)]
pub struct OntoArguments {
    /// Character to put the motion on: a .glb, .gltf or .vrm with a skin, or a .bvh with a skeleton. The file that is written is this
    /// file with one more animation; a .bvh has the motion in place of its own.
    #[arg(long, value_name = "FILE")]
    pub onto: Option<PathBuf>,
    /// Name of the animation; usually the sentence.
    #[arg(long, value_name = "NAME", requires = "onto")]
    pub animation_name: Option<String>,
    /// Drop the animations that the character's file has.
    #[arg(long, requires = "onto")]
    pub replace_animations: bool,
    /// Node at or above the character's skeleton, if its file has several.
    #[arg(long, value_name = "NODE", requires = "onto")]
    pub character: Option<String>,
    /// Mapping file for a character with unknown names, as --names is for motions.
    #[arg(long, value_name = "MAPPING", requires = "onto")]
    pub onto_names: Option<PathBuf>,
    /// Let feet slide as they do when the character has other proportions than the motion's body.
    #[arg(long, requires = "onto")]
    pub free_feet: bool,
    /// Let hands that touch each other or the body miss or enter them on a character of other proportions.
    #[arg(long, requires = "onto")]
    pub free_hands: bool,
    /// What becomes of straight fingers: bent as those of a relaxed hand, or kept as they are.
    #[arg(long, value_enum, default_value = "relax", requires = "onto")]
    pub hands: HandsName,
    /// The character, once it is read.
    #[arg(skip)]
    opened: Arc<OnceLock<Character>>,
}

/// The value of `--hands`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum HandsName {
    #[default]
    Relax,
    Keep,
}

impl OntoArguments {
    /// Returns the character, if there is one. It is read at the first call.
    pub fn open(&self) -> Result<Option<&Character>, Failure> {
        let Some(path) = &self.onto else {
            return Ok(None);
        };
        if let Some(character) = self.opened.get() {
            return Ok(Some(character));
        }
        let mapping = self
            .onto_names
            .as_ref()
            .map(JointMapping::read)
            .transpose()?;
        let options = CharacterOptions {
            mapping,
            root: self.character.clone(),
        };
        let character = Character::open(path, &options)?;
        Ok(Some(self.opened.get_or_init(|| character)))
    }

    /// Returns what is to be said about the character, once it is read.
    fn notice(&self) -> Option<String> {
        let notice = self.opened.get()?.rest_pose_notice()?;
        Some(format!("{}: {notice}", self.onto.as_ref()?.display()))
    }
}

impl Default for WritingArguments {
    fn default() -> Self {
        WritingArguments {
            fps: None,
            bvh_unit: Unit::Centimetre,
            bvh_names: BvhNaming::HumanMl3d,
            gif_width: None,
            root_motion: None,
            in_place: false,
            onto: OntoArguments::default(),
        }
    }
}

impl WritingArguments {
    /// Returns where files keep the travel of motions.
    pub fn root_motion(&self) -> RootMotion {
        match (self.in_place, self.root_motion) {
            (true, _) => RootMotion::None,
            (false, Some(name)) => name.root_motion(),
            (false, None) => RootMotion::default(),
        }
    }

    /// Checks that the options fit the formats, and that the character can be read. Commands call this before their work.
    pub fn check(&self, formats: &[OutputFormat]) -> Result<(), Failure> {
        let usage = |message| Err(Failure::new(FailureCode::Usage, message));
        if formats.contains(&OutputFormat::Vrma) && self.root_motion() == RootMotion::Root {
            return usage(
                "--root-motion: expected hips or none for .vrma, which has no root above the hips, found root".to_owned(),
            );
        }
        let character = self.onto.open()?;
        if let Some(character) = character {
            character.check_root_motion(self.root_motion())?;
        }
        let needs_character = [OutputFormat::Vrm, OutputFormat::Gltf];
        for format in formats {
            let has_one = character.is_some_and(|character| format.holds(character));
            if needs_character.contains(format) && !has_one {
                let ending = format.ending();
                return usage(format!(
                    "expected a character for .{ending}, found none: --onto names its file, a .glb, .gltf or .vrm"
                ));
            }
        }
        let holds_character =
            character.is_some_and(|character| formats.iter().any(|format| format.holds(character)));
        if character.is_some() && !holds_character && formats.contains(&OutputFormat::Vrma) {
            let message = "--onto: expected no character for .vrma, found one: a .vrma plays on every VRM character";
            return Err(Failure::new(FailureCode::Usage, message).hint(
                "leave --onto away, or write .vrm for the character with the motion inside",
            ));
        }
        if let Some(character) = character
            && !formats.iter().any(|format| format.holds(character))
        {
            let expected = match character.is_bvh() {
                true => ".bvh",
                false => ".glb, .gltf or .vrm",
            };
            let path = self.onto.onto.as_deref().unwrap_or(Path::new(""));
            return usage(format!(
                "expected a file that ends in {expected} for the character {}, found none",
                path.display()
            ));
        }
        Ok(())
    }

    /// Returns a notice for each option that was given and has no effect on files of these formats, and what is to be said about the
    /// character.
    pub fn notices(&self, formats: &[OutputFormat]) -> Vec<String> {
        let given = [
            (
                "--fps",
                self.fps.is_some(),
                &[
                    OutputFormat::Bvh,
                    OutputFormat::Glb,
                    OutputFormat::Vrma,
                    OutputFormat::Gltf,
                    OutputFormat::Vrm,
                    OutputFormat::Npy,
                ][..],
            ),
            (
                "--onto",
                self.onto.onto.is_some(),
                &[
                    OutputFormat::Glb,
                    OutputFormat::Gltf,
                    OutputFormat::Vrm,
                    OutputFormat::Bvh,
                ],
            ),
            (
                "--root-motion",
                self.root_motion.is_some(),
                &OutputFormat::WITH_TRAVEL,
            ),
            ("--in-place", self.in_place, &OutputFormat::WITH_TRAVEL),
            (
                "--bvh-unit",
                self.bvh_unit != Unit::Centimetre,
                &[OutputFormat::Bvh],
            ),
            (
                "--bvh-names",
                self.bvh_names != BvhNaming::HumanMl3d,
                &[OutputFormat::Bvh],
            ),
            (
                "--gif-width",
                self.gif_width.is_some(),
                &[OutputFormat::Gif],
            ),
        ];
        let unused = given.into_iter().filter(|(_, is_given, affected)| {
            *is_given && !affected.iter().any(|format| formats.contains(format))
        });
        let unused = unused.map(|(option, _, affected)| {
            let endings: Vec<String> = affected
                .iter()
                .map(|format| format!(".{}", format.ending()))
                .collect();
            format!(
                "{option} changes nothing here: it is for {}",
                endings.join(" and ")
            )
        });
        self.onto.notice().into_iter().chain(unused).collect()
    }
}

/// The value of `--bvh-names`: the names of the joints in a BVH file.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum BvhNaming {
    #[value(name = "humanml3d")]
    HumanMl3d,
    Mixamo,
}

impl BvhNaming {
    pub fn name(self) -> &'static str {
        match self {
            BvhNaming::HumanMl3d => "humanml3d",
            BvhNaming::Mixamo => "mixamo",
        }
    }
}

/// The options of reading motion files.
#[derive(Args, Clone, Default)]
pub struct MotionReadingArguments {
    /// Unit of the file: m, dm, cm, mm, in, cmu, or a number of metres; usually told by the body's size.
    #[arg(long)]
    pub unit: Option<Unit>,
    /// Axis of the file that points up, y, z, -y or -z; usually told by the body.
    #[arg(long, allow_hyphen_values = true)]
    pub up: Option<UpAxis>,
    /// Frames a second of a .bvh, in place of what it says, or of a .npy, which says nothing and is taken for one of 20.
    #[arg(long, value_name = "FPS", value_parser = parse_fps)]
    pub input_fps: Option<f32>,
    /// Animation of a .glb, .gltf, .vrm or .vrma, by its name; usually the first.
    #[arg(long, value_name = "NAME")]
    pub animation: Option<String>,
    /// Mapping file for a skeleton with unknown names: a JSON object such as {"pelvis": "Root", …}.
    #[arg(long, value_name = "MAPPING")]
    pub names: Option<PathBuf>,
    /// Format of standard input, where the file is -; usually told by its first bytes.
    #[arg(long, value_name = "FORMAT")]
    pub from: Option<StreamFormat>,
}

/// A format of motion that can be read from standard input.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum StreamFormat {
    Bvh,
    Glb,
    Gltf,
    Npy,
}

impl StreamFormat {
    /// Returns the file name extension of the format.
    pub fn ending(self) -> &'static str {
        match self {
            StreamFormat::Bvh => "bvh",
            StreamFormat::Glb => "glb",
            StreamFormat::Gltf => "gltf",
            StreamFormat::Npy => "npy",
        }
    }

    /// Detects the format by the first bytes of a file.
    pub fn detect(bytes: &[u8]) -> Option<StreamFormat> {
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

/// Parses a shard such as `2/8`: its number from 1, and the number of shards.
pub fn parse_shard(text: &str) -> Result<(usize, usize), String> {
    let parts = text.split_once('/');
    let numbers = parts.and_then(|(i, n)| Some((i.parse().ok()?, n.parse().ok()?)));
    match numbers {
        Some((i, n)) if (1..=n).contains(&i) => Ok((i, n)),
        _ => Err("expected a part of a whole, such as 2/8, from 1/8 to 8/8".into()),
    }
}

/// Parses a frame rate in frames a second.
fn parse_fps(text: &str) -> Result<f32, String> {
    let rate = text
        .parse()
        .ok()
        .filter(|rate| (0.001..=10_000.0).contains(rate));
    rate.ok_or_else(|| "expected 0.001 to 10000 frames a second".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shards_are_counted_from_one() {
        assert_eq!(parse_shard("2/8"), Ok((2, 8)));
        for wrong in ["0/8", "9/8", "1", "a/b", "1/0", "-1/2"] {
            assert!(parse_shard(wrong).is_err(), "{wrong}");
        }
    }
}
