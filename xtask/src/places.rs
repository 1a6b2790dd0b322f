//! Measures how near motions come to the places that are asked of them, and what that does to the motions.

use std::error::Error;
use std::fmt::Write;

use burn::tensor::Device;
use lamogen::files::{ReadOptions, WriteOptions, read, write};
use lamogen::motion::{FootSliding, Jitter};
use lamogen::{Facing, Generation, Motion, Places, Request, Tag, TimeSummary};
use lamogen_raster::png;
use lamogen_view::{LabelledMotion, save, strip};

use crate::subject::Subject;

/// The options of the measurement.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    #[command(flatten)]
    #[allow(missing_docs)]
    pub subject: Subject,
    /// Seeds of each case: 1, 2 and so on.
    #[arg(long, default_value_t = 2)]
    pub seeds: u64,
    /// Only cases whose name contains this text.
    #[arg(long, value_name = "TEXT")]
    pub only: Option<String>,
    /// A PNG of every motion, the text alone above the one with places.
    #[arg(long)]
    pub strips: Option<std::path::PathBuf>,
}

/// A sentence with places.
struct Case {
    sentence: &'static str,
    seconds: f32,
    path: &'static str,
    facing: &'static str,
    reaches: &'static [&'static str],
    tags: &'static [Tag],
}

/// A sentence with a path.
const fn path(sentence: &'static str, seconds: f32, path: &'static str) -> Case {
    Case {
        sentence,
        seconds,
        path,
        facing: "path",
        reaches: &[],
        tags: &[],
    }
}

/// A sentence with positions to reach.
const fn reach(sentence: &'static str, reaches: &'static [&'static str]) -> Case {
    Case {
        reaches,
        ..path(sentence, 3.0, "")
    }
}

/// A path of more than fifteen seconds, with a place where a stretch ends.
const LONG_PATH: &str = "6:0,5 12:4,8 18:8,5 24:8,0";

/// The cases: paths, reaches, both, and places beside tags.
const CASES: [Case; 22] = [
    path("a person walks forward", 4.0, "0:0,0 2:0.5,1.5 4:2,2"),
    path("a person walks forward", 4.0, "0:0,0 2:1,0 4:1,2"),
    path("a person walks and turns left", 4.0, "2:0,1.5 4:1.5,2.5"),
    path("a person runs", 4.0, "1:0,2 2:1,4.5 4:4,6"),
    path(
        "a person walks in a circle",
        6.0,
        "1.5:1,1 3:2,0 4.5:1,-1 6:0,0",
    ),
    Case {
        facing: "0",
        ..path("a person walks backward", 4.0, "2:0,-1 4:0.5,-2")
    },
    Case {
        facing: "0",
        ..path("a person steps to the left", 3.0, "1.5:0.5,0 3:1,0")
    },
    path("a person jumps forward", 3.0, "3:0.2,1.2"),
    path("a person sneaks forward", 4.0, "2:0,0.8 4:-0.8,1.4"),
    path("a person waves with the right hand", 4.0, "2:0,1 4:0,2"),
    reach(
        "a person waves with the right hand",
        &["right-hand@1.5=-0.3,1.6,0.4"],
    ),
    reach(
        "a person raises both hands",
        &["left-hand@1.5=0.3,1.8,0.2", "right-hand@1.5=-0.3,1.8,0.2"],
    ),
    reach(
        "a person kicks with the right foot",
        &["right-foot@1.2=-0.1,0.6,0.7"],
    ),
    reach(
        "someone picks something up",
        &["right-hand@1.5=-0.2,0.2,0.5"],
    ),
    reach(
        "a person throws a punch",
        &["left-hand@1=0.1,1.4,0.7", "head@2=0.1,1.4,0.2"],
    ),
    Case {
        reaches: &["left-hand@2=0.8,1.5,1.6"],
        ..path("a person walks forward and waves", 4.0, "2:0.5,1.5 4:1,3")
    },
    Case {
        tags: &[Tag::Strong],
        ..path("a person walks forward", 4.0, "2:0.5,2 4:2,4")
    },
    // The path of this one is slower than the walk of the text alone.
    Case {
        tags: &[Tag::Strong],
        ..path("a person walks forward", 4.0, "2:0.5,1.5 4:2,2.5")
    },
    // Made in two stretches.
    path("a person walks forward", 24.0, LONG_PATH),
    path("a person jogs", 20.0, "5:0,10 10:8,16 15:16,10 20:16,0"),
    Case {
        tags: &[Tag::Light],
        ..path("a person walks forward", 24.0, LONG_PATH)
    },
    Case {
        tags: &[Tag::Light, Tag::Sustained],
        ..reach(
            "a person waves with the right hand",
            &["right-hand@1.5=-0.3,1.6,0.4"],
        )
    },
];

impl Case {
    fn name(&self) -> String {
        let tags = self.tags.iter().map(|tag| format!(", {tag}"));
        format!("{}{}", self.sentence, tags.collect::<String>())
    }

    fn request(&self, seed: u64) -> Result<Request, Box<dyn Error>> {
        let mut request = Request::new(self.sentence)
            .seconds(self.seconds)
            .seed(seed)
            .tags(self.tags.iter().copied());
        if !self.path.is_empty() {
            request = request
                .path(self.path.parse()?)
                .facing(self.facing.parse()?);
        }
        for reach in self.reaches {
            request = request.reach(reach.parse()?);
        }
        Ok(request)
    }

    fn places(&self) -> Result<Places, Box<dyn Error>> {
        let reaches: Result<_, _> = self.reaches.iter().map(|reach| reach.parse()).collect();
        Ok(Places {
            path: (!self.path.is_empty())
                .then(|| self.path.parse())
                .transpose()?,
            facing: self.facing.parse::<Facing>()?,
            reaches: reaches?,
            ..Places::default()
        })
    }
}

/// A quantity of the motion of the text alone and of the motion with places.
type Pair = [f32; 2];

/// The figures of one motion.
struct Figures {
    /// Distances in cm: of the path, then of reaches.
    path: Vec<f32>,
    reaches: Vec<f32>,
    /// Metres a second that standing feet slide.
    sliding: Pair,
    /// Metres a second cubed.
    jerk: Pair,
    /// The factor reached, divided by the factor asked, of each component with a tag.
    factors: Vec<f32>,
}

/// Writes a motion to a file and reads it back.
pub(crate) fn through_file(
    motion: &Motion,
    folder: &std::path::Path,
) -> Result<Motion, Box<dyn Error>> {
    let path = folder.join("motion.bvh");
    write(&path, motion, &WriteOptions::default())?;
    Ok(read(&path, &ReadOptions::default())?.motion)
}

fn measure(
    case: &Case,
    generation: &Generation,
    folder: &std::path::Path,
) -> Result<Figures, Box<dyn Error>> {
    let guided = through_file(&generation.guided, folder)?;
    let baseline = through_file(&generation.baseline, folder)?;
    let outcomes = case.places()?.outcomes(&guided);
    let (path, reaches): (Vec<_>, Vec<_>) = { outcomes.into_iter() }
        .filter(|outcome| outcome.seconds > 0.0)
        .partition(|outcome| outcome.name == "pelvis");
    let centimetres = |outcomes: Vec<lamogen::PlaceOutcome>| {
        outcomes.iter().map(|o| 100.0 * o.distance()).collect()
    };
    let [before, after, target] = [
        &generation.baseline_laban,
        &generation.guided_laban,
        &generation.target,
    ]
    .map(|series| series.summary(TimeSummary::Mean));
    let factors = case.tags.iter().map(|tag| {
        let at = tag.component().index();
        (after[at] / before[at]) / (target[at] / before[at])
    });
    Ok(Figures {
        path: centimetres(path),
        reaches: centimetres(reaches),
        sliding: [&baseline, &guided].map(|motion| FootSliding::of(motion).speed),
        jerk: [&baseline, &guided].map(|motion| Jitter::of(motion).jerk),
        factors: factors.collect(),
    })
}

/// Generates the cases and returns a table in Markdown.
///
/// # Errors
///
/// If the model cannot be read, a motion cannot be generated, or a file cannot be written.
pub fn run(
    options: &Options,
    device: &Device,
    report: &mut dyn FnMut(&str),
) -> Result<String, Box<dyn Error>> {
    let model = options.subject.open(device)?;
    let folder = tempfile::tempdir()?;
    let only = options.only.as_deref().unwrap_or("");
    let mut table = String::from(
        "| sentence | seed | path cm: mean, worst | reach cm: mean, worst | sliding m/s: text, places | jerk: text, places | times | factors / asked |\n|---|--:|--:|--:|--:|--:|--:|--:|\n",
    );
    let mut all: Vec<Figures> = Vec::new();
    let mut kept = Vec::new();
    for case in CASES.iter().filter(|case| case.name().contains(only)) {
        for seed in 1..=options.seeds {
            let request = options.subject.with_steps(case.request(seed)?);
            let generation = model.generate(&request)?;
            let figures = measure(case, &generation, folder.path())?;
            let row = format!(
                "| {} | {seed} | {} | {} | {:.2}, {:.2} | {:.0}, {:.0} | {:.2} | {} |",
                case.name(),
                distances(&figures.path),
                distances(&figures.reaches),
                figures.sliding[0],
                figures.sliding[1],
                figures.jerk[0],
                figures.jerk[1],
                figures.jerk[1] / figures.jerk[0],
                figures
                    .factors
                    .iter()
                    .map(|f| format!("{f:.2}"))
                    .collect::<Vec<_>>()
                    .join(", "),
            );
            report(&row);
            writeln!(table, "{row}")?;
            all.push(figures);
            if seed == 1 && options.strips.is_some() {
                kept.push((case.name(), generation));
            }
        }
    }
    let collect = |of: fn(&Figures) -> Vec<f32>| all.iter().flat_map(of).collect::<Vec<f32>>();
    let mean = |of: fn(&Figures) -> f32| all.iter().map(of).sum::<f32>() / all.len() as f32;
    writeln!(
        table,
        "\nAll: path {} cm, reach {} cm, sliding {:.3} to {:.3} m/s, jerk times {:.2}, factors {:?}",
        distances(&collect(|f| f.path.clone())),
        distances(&collect(|f| f.reaches.clone())),
        mean(|f| f.sliding[0]),
        mean(|f| f.sliding[1]),
        mean(|f| f.jerk[1] / f.jerk[0]),
        collect(|f| f.factors.clone()),
    )?;
    if let Some(out) = &options.strips {
        let rows: Vec<LabelledMotion<'_>> = { kept.iter() }
            .flat_map(|(name, generation)| {
                [
                    ("text alone", &generation.baseline),
                    (name.as_str(), &generation.guided),
                ]
            })
            .map(|(label, motion)| LabelledMotion::new(label, motion))
            .collect();
        save(out, &png(&strip(&rows, 9), 1.0)?)?;
    }
    Ok(table)
}

/// Formats the mean and the largest of distances.
fn distances(values: &[f32]) -> String {
    match values.is_empty() {
        true => "–".into(),
        false => format!(
            "{:.1}, {:.1}",
            values.iter().sum::<f32>() / values.len() as f32,
            values.iter().copied().fold(0.0, f32::max)
        ),
    }
}
