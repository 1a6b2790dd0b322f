//! What files are made of: motions with their Laban series, and what is known of them.

use std::cell::OnceCell;
use std::collections::BTreeMap;
use std::path::Path;

use lamogen::files::ImportedMotion;
use lamogen::motion::{JointTurning, Rotations};
use lamogen::{
    COMPONENTS, Component, Device, FRAMES_PER_SECOND, Generation, LabanOptions, LabanSeries,
    Licence, Motion, PartLaban,
};
use lamogen_view::{Curve, Figure, Page, Row};
use serde_json::{Map, Value, json};

/// A motion with its name.
pub struct Shown {
    pub label: String,
    pub motion: Motion,
    pub laban: LabanSeries,
    /// How fast joints turn by the rotations of the file that the motion is from, if it has some.
    turning_of_file: Option<JointTurning>,
    rotations: OnceCell<Rotations>,
    turning_solved: OnceCell<JointTurning>,
}

impl Shown {
    fn new(label: String, motion: Motion, laban: LabanSeries) -> Shown {
        Shown {
            label,
            motion,
            laban,
            turning_of_file: None,
            rotations: OnceCell::new(),
            turning_solved: OnceCell::new(),
        }
    }

    /// What files of the motion hold; solved when first asked for.
    pub fn rotations(&self) -> &Rotations {
        self.rotations
            .get_or_init(|| self.motion.rotations().into_owned())
    }

    /// How fast joints turn: in the file that the motion is from, else in those that would be written.
    pub fn turning(&self) -> &JointTurning {
        let solved = || JointTurning::of(self.rotations());
        match &self.turning_of_file {
            Some(turning) => turning,
            None => self.turning_solved.get_or_init(solved),
        }
    }

    /// Whether [`turning`](Self::turning) is that of a file's own rotations.
    pub fn turns_as_its_file(&self) -> bool {
        self.turning_of_file.is_some()
    }
}

/// One motion or several that belong together.
pub struct Scene {
    pub title: String,
    /// A line below the title.
    pub notes: String,
    /// The last one is what motion files get.
    pub motions: Vec<Shown>,
    pub target: Option<LabanSeries>,
    /// Components that may become anything, whatever the target holds.
    pub free: [bool; COMPONENTS],
    /// Parts of the body that have goals of their own, and the rest.
    pub parts: Vec<PartLaban>,
    /// What the JSON says beside the motions.
    pub facts: Map<String, Value>,
    /// Under which terms the motion may be used.
    pub copyright: Option<String>,
}

/// Of several motions that are neither baseline nor guided.
const COLOURS: [[u8; 3]; 4] = [[194, 65, 12], [107, 114, 128], [3, 105, 161], [22, 101, 52]];

impl Scene {
    /// A generated motion and, where it was guided, the baseline before it.
    pub fn generated(
        title: &str,
        generation: Generation,
        facts: Map<String, Value>,
        licence: Option<&Licence>,
    ) -> Scene {
        let scale = generation.goals.to_string();
        let is_guided = !generation.loss.is_empty();
        let text_alone = "text alone".to_owned();
        let guided = Shown::new(
            match is_guided {
                true => scale.clone(),
                false => text_alone.clone(),
            },
            generation.guided,
            generation.guided_laban,
        );
        let baseline = Shown::new(text_alone, generation.baseline, generation.baseline_laban);
        let seed = facts.get("seed").map(|seed| format!("seed {seed}"));
        let notes = [is_guided.then_some(scale), seed];
        let notes: Vec<String> = notes.into_iter().flatten().collect();
        Scene {
            title: title.to_owned(),
            notes: notes.join(", "),
            motions: if is_guided {
                vec![baseline, guided]
            } else {
                vec![guided]
            },
            target: is_guided.then_some(generation.target),
            free: Component::ALL.map(|component| generation.goals.is_free(component)),
            parts: generation.parts,
            facts,
            copyright: licence.map(|licence| format!("Made with a model under {licence}")),
        }
    }

    /// A motion from a file.
    pub fn file(path: &Path, imported: ImportedMotion, device: &Device) -> Scene {
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
        Scene {
            title: name.to_string(),
            notes: String::new(),
            motions: vec![Shown {
                turning_of_file: imported.turning,
                ..Shown::new(name.into_owned(), imported.motion, laban)
            }],
            target: None,
            free: [false; COMPONENTS],
            parts: Vec::new(),
            facts: facts.as_object().cloned().unwrap_or_default(),
            copyright: None,
        }
    }

    /// Puts another motion in the place of the main one; it is measured anew.
    pub fn replace_main(&mut self, motion: Motion, device: &Device) {
        let label = self
            .motions
            .pop()
            .map_or(String::new(), |shown| shown.label);
        let laban = LabanSeries::of(&motion, &LabanOptions::default(), device);
        self.motions.push(Shown::new(label, motion, laban));
    }

    /// The motion that it is all about.
    pub fn main(&self) -> &Shown {
        self.motions.last().expect("a scene has a motion")
    }

    fn is_guided(&self) -> bool {
        self.target.is_some()
    }

    /// Title and notes in one line.
    pub fn heading(&self) -> String {
        match self.notes.is_empty() {
            true => self.title.clone(),
            false => format!("{}: {}", self.title, self.notes),
        }
    }

    pub fn rows(&self) -> Vec<Row<'_>> {
        let shown = self.motions.iter();
        shown
            .map(|shown| Row {
                label: &shown.label,
                motion: &shown.motion,
            })
            .collect()
    }

    pub fn curves(&self) -> Vec<Curve<'_>> {
        match (&self.motions[..], &self.target) {
            ([baseline, guided], Some(target)) => vec![
                Curve::baseline(&baseline.laban),
                Curve::target(target),
                Curve::guided(&guided.laban),
            ],
            (motions, _) => {
                let all = motions.iter().zip(COLOURS);
                all.map(|(shown, colour)| Curve {
                    label: &shown.label,
                    series: &shown.laban,
                    colour,
                    dashed: false,
                })
                .collect()
            }
        }
    }

    fn figures(&self) -> Vec<Figure<'_>> {
        let mut figures: Vec<Figure<'_>> = self
            .motions
            .iter()
            .zip(COLOURS)
            .map(|(shown, colour)| Figure {
                label: &shown.label,
                motion: &shown.motion,
                colour,
            })
            .collect();
        if let (true, [baseline, guided]) = (self.is_guided(), &mut figures[..]) {
            baseline.colour = Figure::baseline(baseline.motion).colour;
            guided.colour = Figure::guided(guided.motion).colour;
        }
        figures
    }

    /// The series for a table, each with its name.
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
                .map(|shown| (shown.label.as_str(), &shown.laban))
                .collect(),
        }
    }

    /// The page that plays it.
    pub fn page(&self) -> String {
        let (figures, curves) = (self.figures(), self.curves());
        lamogen_view::page(&Page {
            title: &self.title,
            notes: &self.notes,
            figures: &figures,
            curves: &curves,
        })
    }

    /// What a GLB's custom properties say: the facts that are a word or a number.
    pub fn glb_notes(&self) -> BTreeMap<String, String> {
        let text = |value: &Value| match value {
            Value::String(text) => Some(text.clone()),
            Value::Number(number) => Some(number.to_string()),
            _ => None,
        };
        let facts = self.facts.iter();
        facts
            .filter_map(|(name, value)| Some((name.clone(), text(value)?)))
            .collect()
    }
}

/// Seconds of a frame.
pub fn seconds(frame: usize) -> f32 {
    frame as f32 / FRAMES_PER_SECOND
}
