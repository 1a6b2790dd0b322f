//! The content of output files: motions with their Laban series, and facts about them.

use std::cell::OnceCell;
use std::collections::BTreeMap;
use std::path::Path;

use lamogen::files::ImportedMotion;
use lamogen::motion::{JointTurning, Rotations, TimedCaption};
use lamogen::{
    COMPONENTS, Component, Device, FRAMES_PER_SECOND, FinishedStretches, GeneratedSentence,
    Generation, LabanOptions, LabanSeries, Motion, PartLaban, PlaceOutcome, RootMotion,
};
use lamogen_view::{LabanCurve, LabelledMotion, Page, PageFigure};
use serde_json::{Map, Value, json};

/// A motion with its name and measurements.
pub struct SceneMotion {
    pub label: String,
    pub motion: Motion,
    pub laban: LabanSeries,
    /// What is said when, if there are several sentences.
    pub captions: Vec<TimedCaption>,
    /// How fast joints turn, by the rotations of the file that the motion comes from, if the file has rotations.
    file_turning: Option<JointTurning>,
    /// The value of [`SceneMotion::rotations`], once it is computed.
    rotations: OnceCell<Rotations>,
    /// How fast joints turn, by [`SceneMotion::rotations`], once it is computed.
    solved_turning: OnceCell<JointTurning>,
}

impl SceneMotion {
    fn new(label: String, motion: Motion, laban: LabanSeries) -> SceneMotion {
        SceneMotion {
            label,
            motion,
            laban,
            captions: Vec::new(),
            file_turning: None,
            rotations: OnceCell::new(),
            solved_turning: OnceCell::new(),
        }
    }

    fn with_captions(self, captions: Vec<TimedCaption>) -> SceneMotion {
        SceneMotion { captions, ..self }
    }

    /// Returns the rotations that files of the motion contain. They are computed by the first call.
    pub fn rotations(&self) -> &Rotations {
        self.rotations
            .get_or_init(|| self.motion.rotations().into_owned())
    }

    /// Returns how fast joints turn: in the file that the motion comes from or, if that has no rotations, in the
    /// rotations that would be written.
    pub fn turning(&self) -> &JointTurning {
        let solved = || JointTurning::of(self.rotations());
        match &self.file_turning {
            Some(turning) => turning,
            None => self.solved_turning.get_or_init(solved),
        }
    }

    /// Whether [`turning`](Self::turning) comes from the rotations of a file.
    pub fn has_file_turning(&self) -> bool {
        self.file_turning.is_some()
    }
}

/// Returns a target in which the components that may become anything are not a number, so that no table and no picture shows
/// what was not asked for.
fn without_free(target: &LabanSeries, free: [bool; COMPONENTS]) -> LabanSeries {
    let frames = target.frames().iter().map(|features| {
        std::array::from_fn(|at| match free[at] {
            true => f32::NAN,
            false => features[at],
        })
    });
    LabanSeries::from_frames(frames.collect())
}

/// One motion, or several motions that belong together.
pub struct Scene {
    pub title: String,
    /// A line below the title.
    pub notes: String,
    /// The motions. The last one is the main motion, which motion files contain.
    pub motions: Vec<SceneMotion>,
    /// The Laban features to reach, if the main motion was guided. Those that may become anything are not a number.
    pub target: Option<LabanSeries>,
    /// For each component, whether it may become anything.
    pub free: [bool; COMPONENTS],
    /// Laban features of the parts of the body that have goals of their own, and of the rest.
    pub parts: Vec<PartLaban>,
    /// How near the main motion comes to the places that were asked for.
    pub places: Vec<PlaceOutcome>,
    /// The sentences of the motions, if they were generated.
    pub sentences: Vec<GeneratedSentence>,
    /// Facts that the JSON contains beside the motions.
    pub facts: Map<String, Value>,
}

/// Returns what several sentences say when, with their goals or without. A single sentence stands in the title, and nowhere
/// else.
fn captions(sentences: &[GeneratedSentence], with_goals: bool) -> Vec<TimedCaption> {
    if sentences.len() == 1 {
        return Vec::new();
    }
    let caption = |sentence: &GeneratedSentence| {
        let GeneratedSentence { prompt, goals, .. } = sentence;
        let text = match with_goals && goals.change() {
            true => format!("{prompt} ({goals})"),
            false => prompt.clone(),
        };
        TimedCaption::new(text, sentence.frames.clone())
    };
    sentences.iter().map(caption).collect()
}

/// Returns sentences in a row as one text.
fn joined_prompts(sentences: &[GeneratedSentence]) -> String {
    let prompts: Vec<&str> = { sentences.iter() }
        .map(|sentence| &sentence.prompt[..])
        .collect();
    prompts.join(", then ")
}

/// Returns the label of a guided motion: its goals, and whether it has places. Goals that leave everything free are left out
/// beside places; those of several sentences stand beside the sentences.
fn goals_label(generation: &Generation) -> String {
    if generation.sentences.len() > 1 {
        return match generation.places.is_empty() {
            true => "guided".to_owned(),
            false => "guided, with places".to_owned(),
        };
    }
    let is_free = Component::ALL.map(|component| generation.goals.is_free(component));
    let goals = generation.goals.to_string();
    match (&generation.places[..], is_free == [true; COMPONENTS]) {
        ([], _) => goals,
        (_, true) => "with places".to_owned(),
        (_, false) => format!("{goals}, with places"),
    }
}

/// Returns a note of how near a motion comes to its places.
fn places_note(places: &[PlaceOutcome]) -> Option<String> {
    let distances = places.iter().map(PlaceOutcome::distance);
    let largest = distances.fold(0.0, f32::max);
    (!places.is_empty()).then(|| format!("at most {:.1} cm off", 100.0 * largest))
}

/// Colours of motions that are neither baseline nor guided, as red, green and blue.
const COLOURS: [[u8; 3]; 4] = [[194, 65, 12], [107, 114, 128], [3, 105, 161], [22, 101, 52]];

impl Scene {
    /// Makes a scene of a generated motion. If it was guided, the baseline comes before it.
    pub fn from_generation(generation: Generation, facts: Map<String, Value>) -> Scene {
        let title = joined_prompts(&generation.sentences);
        let scale = goals_label(&generation);
        let is_guided = !generation.loss.is_empty();
        let text_alone = "text alone".to_owned();
        let guided = SceneMotion::new(
            match is_guided {
                true => scale.clone(),
                false => text_alone.clone(),
            },
            generation.guided,
            generation.guided_laban,
        )
        .with_captions(captions(&generation.sentences, is_guided));
        let baseline = SceneMotion::new(text_alone, generation.baseline, generation.baseline_laban)
            .with_captions(captions(&generation.sentences, false));
        let seed = facts.get("seed").map(|seed| format!("seed {seed}"));
        let notes = [
            is_guided.then_some(scale),
            places_note(&generation.places),
            seed,
        ];
        let notes: Vec<String> = notes.into_iter().flatten().collect();
        let free = Component::ALL.map(|component| generation.goals.is_free(component));
        Scene {
            title,
            notes: notes.join(", "),
            sentences: generation.sentences,
            motions: if is_guided {
                vec![baseline, guided]
            } else {
                vec![guided]
            },
            target: is_guided.then(|| without_free(&generation.target, free)),
            free,
            parts: generation.parts,
            places: generation.places,
            facts,
        }
    }

    /// Makes a scene of the finished stretches of a motion.
    pub fn from_stretches(
        label: &str,
        stretches: FinishedStretches,
        facts: Map<String, Value>,
        device: &Device,
    ) -> Scene {
        let laban = LabanSeries::of(&stretches.motion, &LabanOptions::default(), device);
        // Nothing was done for the goals of a motion of the text alone yet.
        let captions = captions(&stretches.sentences, stretches.is_guided);
        let scene_motion =
            SceneMotion::new(label.to_owned(), stretches.motion, laban).with_captions(captions);
        Scene {
            notes: "unfinished".to_owned(),
            ..Scene::of_motions(
                joined_prompts(&stretches.sentences),
                vec![scene_motion],
                facts,
            )
        }
    }

    /// Makes a scene of motions that were not generated as a whole.
    pub fn of_motions(
        title: String,
        motions: Vec<SceneMotion>,
        facts: Map<String, Value>,
    ) -> Scene {
        Scene {
            title,
            notes: String::new(),
            motions,
            target: None,
            free: [false; COMPONENTS],
            parts: Vec::new(),
            places: Vec::new(),
            sentences: Vec::new(),
            facts,
        }
    }

    /// Makes a scene of a motion from a file.
    pub fn from_file(path: &Path, imported: ImportedMotion, device: &Device) -> Scene {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let laban = LabanSeries::of(&imported.motion, &LabanOptions::default(), device);
        let facts = json!({
            "file": path.to_string_lossy(),
            "scheme": imported.scheme,
            "unit": imported.unit.to_string(),
            "up": imported.up.to_string(),
            "source_frames_per_second": imported.source_frames_per_second,
            "source_frames": imported.source_frames,
            "other_animations": imported.other_animations,
            "placed_joints": imported.placed.iter().map(|joint| joint.name()).collect::<Vec<_>>(),
        });
        let scene_motion = SceneMotion {
            file_turning: imported.turning,
            ..SceneMotion::new(name.to_string(), imported.motion, laban)
        };
        let facts = facts.as_object().cloned().unwrap_or_default();
        Scene::of_motions(name.into_owned(), vec![scene_motion], facts)
    }

    /// Replaces the main motion by another one, and measures that.
    pub fn replace_main(&mut self, motion: Motion, device: &Device) {
        let copyright = self.main().motion.copyright().map(str::to_owned);
        let label = self
            .motions
            .pop()
            .map_or(String::new(), |scene_motion| scene_motion.label);
        let laban = LabanSeries::of(&motion, &LabanOptions::default(), device);
        let motion = motion.with_copyright(copyright);
        self.motions.push(SceneMotion::new(label, motion, laban));
    }

    /// Sets where files keep the travel of the main motion.
    pub fn set_root_motion(&mut self, root_motion: RootMotion) {
        if let Some(scene_motion) = self.motions.last_mut() {
            scene_motion.motion = scene_motion.motion.clone().with_root_motion(root_motion);
        }
        if root_motion != RootMotion::default() {
            let name = root_motion.name().into();
            self.facts.insert("root_motion".into(), name);
        }
    }

    /// Returns the main motion.
    pub fn main(&self) -> &SceneMotion {
        self.motions.last().expect("a scene has a motion")
    }

    fn is_guided(&self) -> bool {
        self.target.is_some()
    }

    /// Returns the target. Returns `None` if nothing is asked of any component.
    pub fn asked_target(&self) -> Option<&LabanSeries> {
        self.target.as_ref().filter(|_| self.free.contains(&false))
    }

    /// Returns title and notes in one line.
    pub fn heading(&self) -> String {
        match self.notes.is_empty() {
            true => self.title.clone(),
            false => format!("{}: {}", self.title, self.notes),
        }
    }

    /// Returns the rows of a picture, one for each motion.
    pub fn rows(&self) -> Vec<LabelledMotion<'_>> {
        let scene_motions = self.motions.iter();
        scene_motions
            .map(|scene_motion| LabelledMotion {
                label: &scene_motion.label,
                motion: &scene_motion.motion,
                captions: &scene_motion.captions,
            })
            .collect()
    }

    /// Returns the curves of the Laban features.
    pub fn curves(&self) -> Vec<LabanCurve<'_>> {
        match (&self.motions[..], &self.target) {
            ([baseline, guided], Some(_)) => {
                let target = self.asked_target().map(LabanCurve::target);
                let guided = LabanCurve::guided(&guided.laban);
                let curves = [Some(LabanCurve::baseline(&baseline.laban)), target];
                curves.into_iter().flatten().chain([guided]).collect()
            }
            (motions, _) => {
                let all = motions.iter().zip(COLOURS);
                all.map(|(scene_motion, colour)| LabanCurve {
                    label: &scene_motion.label,
                    series: &scene_motion.laban,
                    colour,
                    dashed: false,
                })
                .collect()
            }
        }
    }

    /// Returns the figures that move on the page.
    fn figures(&self) -> Vec<PageFigure<'_>> {
        let mut figures: Vec<PageFigure<'_>> = self
            .motions
            .iter()
            .zip(COLOURS)
            .map(|(scene_motion, colour)| PageFigure {
                label: &scene_motion.label,
                motion: &scene_motion.motion,
                colour,
            })
            .collect();
        if let (true, [baseline, guided]) = (self.is_guided(), &mut figures[..]) {
            baseline.colour = PageFigure::baseline(baseline.motion).colour;
            guided.colour = PageFigure::guided(guided.motion).colour;
        }
        figures
    }

    /// Returns the Laban series for a CSV table, each with its name.
    pub fn series(&self) -> Vec<(&str, &LabanSeries)> {
        match (&self.motions[..], &self.target) {
            ([baseline, guided], Some(target)) => vec![
                ("baseline", &baseline.laban),
                ("target", target),
                ("guided", &guided.laban),
            ],
            ([alone], _) => vec![("", &alone.laban)],
            (motions, _) => motions
                .iter()
                .map(|scene_motion| (scene_motion.label.as_str(), &scene_motion.laban))
                .collect(),
        }
    }

    /// Returns the HTML page that plays the motions.
    pub fn page(&self) -> String {
        let (figures, curves) = (self.figures(), self.curves());
        lamogen_view::page(&Page {
            title: &self.title,
            notes: &self.notes,
            figures: &figures,
            curves: &curves,
            captions: &self.main().captions,
        })
    }

    /// Returns the custom properties of a GLB file: the facts that are a text or a number, and the sentences.
    pub fn glb_notes(&self) -> BTreeMap<String, String> {
        let text = |value: &Value| match value {
            Value::String(text) => Some(text.clone()),
            Value::Number(number) => Some(number.to_string()),
            _ => None,
        };
        let facts = self.facts.iter();
        let mut notes: BTreeMap<String, String> = facts
            .filter_map(|(name, value)| Some((name.clone(), text(value)?)))
            .collect();
        let captions = &self.main().captions;
        if !captions.is_empty() {
            let lines: Vec<String> = captions.iter().map(TimedCaption::to_string).collect();
            notes.insert("sentences".into(), lines.join("\n"));
        }
        notes
    }
}

/// Returns the time of a frame in seconds.
pub fn seconds(frame: usize) -> f32 {
    frame as f32 / FRAMES_PER_SECOND
}
