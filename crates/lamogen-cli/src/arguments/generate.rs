//! The arguments of `lamogen generate`.

use std::path::PathBuf;

use clap::Args;
use lamogen::laban::GoalError;
use lamogen::{
    Component, Facing, Goal, GroundPath, PartScale, Places, PoseFile, Reach, RequestedGoals, Scale,
};

use super::sentences::SentenceArguments;
use super::shared::{ModelArguments, PassArguments, WritingArguments};
use crate::output::OutputFile;

/// The text below the options in the help.
pub const AFTER_HELP: &str = "\
Factors are numbers, words, or keys over time: --weight strong, --weight 1.5, --weight \"0:1 1:1.5 2:0.5\" \
(second:factor, each holds until the next; with ~ between two keys the factor slides). Instead of a factor peak= and mean= ask \
for a value, in the unit that lamogen laban prints, and any for nothing at all.

Files: .glb and .bvh for Blender and engines, .vrma for every VRM character, .npy (joints) and .features.npy for NumPy, .html a page that \
plays the motion, .gif, .svg and .png pictures, .csv the Laban series, .json everything.

Examples:
  lamogen generate \"a person jumps\" --weight strong --time sudden --seconds 4 --seed 7 --out jump.glb
  lamogen generate \"a person walks\" --weight \"0:light 2:strong\" --emphasis 10 --out walk.html
  lamogen generate \"a person walks\" --part arms:strong --part legs:light --out arms.html
  lamogen generate \"a person walks forward\" --seconds 3 --then \"a person jumps\" --seconds 2 --weight strong --out scene.glb
  lamogen generate \"a person dances\" --like dance.bvh --shape any --out alike.html
  lamogen generate \"a person walks\" --path \"0:0,0 2:1,0 4:1,2\" --seconds 4 --out way.html
  lamogen generate \"a person waves\" --shape far --samples 4 --out wave.gif";

/// The arguments of `lamogen generate`.
#[derive(Args)]
#[command(allow_negative_numbers = true)]
pub struct GenerateArguments {
    /// What the person does, such as "a person jumps".
    pub prompt: String,
    #[command(flatten)]
    pub goals: GoalArguments,
    #[command(flatten)]
    pub places: PlaceArguments,
    /// What the person does next, in the same motion. --seconds, --weight, --time, --flow, --shape, --scale, --like and --part after
    /// it are those of this sentence. May be given several times.
    #[arg(long, value_name = "SENTENCE")]
    pub then: Vec<String>,
    /// The sentences of --then, with their options.
    #[arg(skip)]
    pub sentences: Vec<SentenceArguments>,
    /// Length in seconds: at least 2 with the embedded model and most others. What is longer than the model's longest motion (9.8) is made of
    /// pieces that overlap.
    #[arg(long, default_value_t = 3.0)]
    pub seconds: f32,
    /// A motion file to go on from: the first frame follows its last one, where and as the body stands there.
    #[arg(long, value_name = "FILE")]
    pub after: Option<PathBuf>,
    /// A motion file to lead to: its first frame follows the last one of this motion. With --after, what lies between.
    #[arg(long, value_name = "FILE")]
    pub before: Option<PathBuf>,
    /// Seed of the start noise: the same seed gives the same motion.
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// How many motions, from as many seeds: this one and the next. Files are then named by their seed.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub samples: u32,
    /// File to write; its ending says which format. May be given several times.
    #[arg(long, short, value_name = "FILE", default_value = "motion.html")]
    pub out: Vec<OutputFile>,
    /// Only the motion of the text alone.
    #[arg(long, conflicts_with_all = ["weight", "time", "flow", "shape", "scale", "like", "part", "emphasis", "path", "reach", "pose"])]
    pub baseline_only: bool,
    #[command(flatten)]
    pub pass: PassArguments,
    #[command(flatten)]
    pub source: ModelArguments,
    #[command(flatten)]
    pub writing: WritingArguments,
}

/// The goals of the four components and of parts of the body.
#[derive(Args, Clone)]
pub struct GoalArguments {
    /// Weight (kinetic energy): light, strong, a factor, keys over time, peak=, mean=, or any.
    #[arg(long, value_name = "GOAL", value_parser = goal_parser(Component::Weight))]
    pub weight: Option<Goal>,
    /// Time (acceleration): sustained, sudden, a factor, keys over time, peak=, mean=, or any.
    #[arg(long, value_name = "GOAL", value_parser = goal_parser(Component::Time))]
    pub time: Option<Goal>,
    /// Flow (jerk): bound, free, a factor, keys over time, peak=, mean=, or any.
    #[arg(long, value_name = "GOAL", value_parser = goal_parser(Component::Flow))]
    pub flow: Option<Goal>,
    /// Shape (the room that the body takes): near, far, a factor, keys over time, peak=, mean=, or any.
    #[arg(long, value_name = "GOAL", value_parser = goal_parser(Component::Shape))]
    pub shape: Option<Goal>,
    /// Factors on Weight, Time, Flow and Shape at once, such as 1.5,1.2,1,1.
    #[arg(long, value_name = "W,T,F,S", value_parser = parse_scale, conflicts_with_all = ["weight", "time", "flow", "shape"])]
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
    /// Returns the goals that the arguments state.
    pub fn requested_goals(&self) -> RequestedGoals {
        RequestedGoals {
            goals: [&self.weight, &self.time, &self.flow, &self.shape].map(Clone::clone),
            scale: self.scale,
            like: self.like.clone(),
            parts: self.part.clone(),
        }
    }
}

/// The places at which the body shall be.
#[derive(Args, Clone)]
pub struct PlaceArguments {
    /// Places that the pelvis passes, such as "0:0,0 2:1,0 4:1,2": seconds:x,z in metres from the start of the motion, x to the left of
    /// how the body stands there and z forward.
    #[arg(long, value_name = "PLACES")]
    pub path: Option<GroundPath>,
    /// Where the body faces on its path: path (along it), free, or degrees to the left of how it stands at the start.
    #[arg(long, value_name = "DIRECTION", requires = "path", default_value_t = Facing::Path)]
    pub face: Facing,
    /// A position that left-hand, right-hand, left-foot, right-foot or head reaches at a moment, such as right-hand@1.5=-0.3,1.6,0.5:
    /// metres to the left of the start, up and forward. May be given several times.
    #[arg(long, value_name = "PART@SECONDS=X,Y,Z")]
    pub reach: Vec<Reach>,
    /// A pose that the body takes at a moment, of a motion file: its first frame, as in 1.5=sit.npy, or that of a time in it, as in
    /// 1.5=dance.bvh@3.2. May be given several times.
    #[arg(long, value_name = "SECONDS=FILE")]
    pub pose: Vec<PoseFile>,
}

impl PlaceArguments {
    /// Returns the places that the arguments state; the poses are in files.
    pub fn places(&self) -> Places {
        Places {
            path: self.path.clone(),
            facing: self.face,
            reaches: self.reach.clone(),
            poses: Vec::new(),
        }
    }
}

/// Makes a parser of goals for a component.
fn goal_parser(
    component: Component,
) -> impl Fn(&str) -> Result<Goal, GoalError> + Clone + Send + Sync + 'static {
    move |text| Goal::parse(component, text)
}

/// Parses four factors with commas.
fn parse_scale(text: &str) -> Result<Scale, String> {
    let numbers: Result<Vec<f32>, _> = text.split(',').map(|part| part.trim().parse()).collect();
    let factors = numbers.ok().and_then(|numbers| numbers.try_into().ok());
    let factors = factors.ok_or("expected four numbers with commas, such as 1.5,1.2,1,1")?;
    Scale::new(factors).map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    use crate::arguments::Command;

    #[test]
    fn goals_are_words_numbers_keys_or_values_of_their_own_component() {
        let parse = |arguments: &[&str]| {
            let all = [&["lamogen", "generate", "a person jumps"], arguments].concat();
            crate::arguments::parse(all.iter().map(Into::into).collect()).map(|arguments| {
                match arguments.command {
                    Command::Generate(options) => options
                        .goals
                        .requested_goals()
                        .resolve(&lamogen::Device::flex())
                        .ok()?,
                    _ => None,
                }
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
}
