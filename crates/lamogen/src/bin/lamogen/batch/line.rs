//! One line of a file of requests.

use std::collections::HashMap;
use std::path::PathBuf;

use lamogen::laban::GoalError;
use lamogen::{
    COMPONENTS, Component, Device, Factor, Goal, Goals, PartScale, Preset, Request, Scale,
};
use lamogen_data::Checksum;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use crate::arguments::{BodyName, PassArguments, PresetName};
use crate::goals::Asked;
use crate::report::name;

/// A request as it stands in the file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Line {
    pub prompt: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    id: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    weight: Option<GoalText>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    time: Option<GoalText>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    flow: Option<GoalText>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    shape: Option<GoalText>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    scale: Option<[f32; 4]>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    like: Option<PathBuf>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    part: Vec<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    seconds: Option<f32>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    seed: Option<u64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    steps: Option<usize>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    preset: Option<PresetName>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    emphasis: Option<f32>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    body: Option<BodyName>,
}

/// A goal as the command line has it, or a plain number.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged, expecting = "a number, a word or keys such as \"0:1 1:1.5\"")]
enum GoalText {
    Number(f32),
    Text(String),
}

/// A request to work on.
#[derive(Clone, Debug)]
pub struct Item {
    /// Its line in the file, from 1.
    pub number: usize,
    /// What its files are called.
    pub id: String,
    pub line: Line,
    asked: Asked,
    /// Once it is prepared.
    goals: Option<Goals>,
    /// That of the file which the motion shall be like.
    like_checksum: Option<String>,
}

/// Longest id, in letters.
const LONGEST: usize = 100;

/// The requests of a file; and the numbers of the lines that are none, with the reasons. `endings` are those of the files that each request
/// gets.
pub fn items(text: &str, endings: &[&str]) -> (Vec<Item>, Vec<(usize, String)>) {
    let (mut items, mut wrong) = (Vec::new(), Vec::new());
    let mut ids: HashMap<String, usize> = HashMap::new();
    // Two ids may name one file: x with features.npy, and x.features with npy.
    let mut files: HashMap<String, usize> = HashMap::new();
    for (index, text) in text.lines().enumerate() {
        // A mark that some editors put before the first line.
        let text = text.trim_start_matches('\u{feff}').trim();
        if text.is_empty() {
            continue;
        }
        let number = index + 1;
        match item(number, text) {
            Ok(item) => {
                let id = item.id.to_lowercase();
                if let Some(first) = ids.insert(id.clone(), number) {
                    let reason = format!("the id {:?} is that of line {first}", item.id);
                    wrong.push((number, reason));
                    continue;
                }
                let names = endings.iter().map(|ending| format!("{id}.{ending}"));
                let taken = names.fold(None, |taken, name| {
                    let first = files.insert(name.clone(), number);
                    taken.or(first.map(|first| (name, first)))
                });
                match taken {
                    None => items.push(item),
                    Some((name, first)) => wrong.push((
                        number,
                        format!("the file {name} is one of line {first}, too: take another id"),
                    )),
                }
            }
            Err(reason) => wrong.push((number, reason)),
        }
    }
    (items, wrong)
}

/// The first field that cannot be read, which serde does not say.
fn wrong_field(text: &str) -> Option<String> {
    let fields: Map<String, Value> = serde_json::from_str(text).ok()?;
    let is_wrong = |(name, value): &(String, Value)| {
        let mut alone = Map::from_iter([("prompt".to_owned(), "a".into())]);
        alone.insert(name.clone(), value.clone());
        serde_json::from_value::<Line>(alone.into()).is_err()
    };
    let (name, _) = fields.into_iter().find(is_wrong)?;
    Some(name)
}

fn item(number: usize, text: &str) -> Result<Item, String> {
    if !text.starts_with('{') {
        let start: String = text.chars().take(20).collect();
        return Err(format!(
            "expected a JSON object {{\"prompt\": …}}, found {start}"
        ));
    }
    let line: Line = serde_json::from_str(text).map_err(|error| {
        // The line is known; serde counts it as the first.
        let reason = error.to_string().replace("at line 1 column", "at column");
        match wrong_field(text) {
            Some(field) if !reason.contains(&format!("`{field}`")) => format!("{field}: {reason}"),
            _ => reason,
        }
    })?;
    let id = match &line.id {
        Some(id) => {
            let fits = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
            if id.is_empty() || id.len() > LONGEST || id.starts_with('.') || !id.chars().all(fits) {
                return Err(format!(
                    "expected an id of up to {LONGEST} letters A to Z and a to z, digits, - _ and . (not first), found {id:?}"
                ));
            }
            id.clone()
        }
        None => format!("line-{number:05}"),
    };
    let asked = line.asked()?;
    Ok(Item {
        number,
        id,
        line,
        asked,
        goals: None,
        like_checksum: None,
    })
}

impl Line {
    fn asked(&self) -> Result<Asked, String> {
        let goals = [&self.weight, &self.time, &self.flow, &self.shape];
        if self.scale.is_some() && goals.iter().any(|goal| goal.is_some()) {
            return Err("expected a scale or factors of components, found both".into());
        }
        if self.scale.is_some() && self.like.is_some() {
            return Err("expected a scale or a motion to be like, found both".into());
        }
        let mut parsed = [const { None }; COMPONENTS];
        for (component, text) in Component::ALL.into_iter().zip(goals) {
            let goal = text.as_ref().map(|text| match text {
                GoalText::Number(number) => Ok(Factor::constant(*number)?.into()),
                GoalText::Text(text) => Goal::parse(component, text),
            });
            parsed[component.index()] = goal
                .transpose()
                .map_err(|error| format!("{}: {error}", name(component)))?;
        }
        let parts = self.part.iter().map(|part| part.parse());
        let parts: Result<Vec<PartScale>, GoalError> = parts.collect();
        let scale = self.scale.map(Scale::new).transpose();
        Ok(Asked {
            goals: parsed,
            scale: scale.map_err(|error| error.to_string())?,
            like: self.like.clone(),
            parts: parts.map_err(|error| format!("part: {error}"))?,
        })
    }
}

impl Item {
    /// Reads the motion that this one shall be like, if there is one.
    pub fn prepare(&mut self, device: &Device) -> Result<(), String> {
        let goals = self.asked.goals(device);
        self.goals = goals.map_err(|failure| failure.message)?;
        Ok(())
    }

    /// Notes what is in the file that the motion shall be like, if there is one that can be read: the motion is only finished while it stays
    /// the same. `known` are checksums of files that were read before.
    pub fn note_like(&mut self, known: &mut HashMap<PathBuf, Option<String>>) {
        let Some(path) = &self.line.like else {
            return;
        };
        let checksum = known.entry(path.clone()).or_insert_with(|| {
            let mut sum = Checksum::new(0);
            sum.add(&std::fs::read(path).ok()?);
            Some(format!("{:016x}", sum.value()))
        });
        self.like_checksum = checksum.clone();
    }

    /// What is in the file that the motion shall be like, as a number; none if there is no such file.
    pub fn like_checksum(&self) -> Option<&str> {
        self.like_checksum.as_deref()
    }

    /// Whether anything is asked of the motion beside the sentence, once the item is prepared.
    pub fn is_guided(&self) -> bool {
        self.goals.is_some()
    }

    /// Length of the motion in seconds.
    pub fn seconds(&self) -> f32 {
        // As Request::new has it.
        self.line.seconds.unwrap_or(3.0)
    }

    pub fn seed(&self) -> u64 {
        self.line.seed.unwrap_or(0)
    }

    /// How its passes run: what the line says, else what the command line does.
    pub fn pass(&self, general: &PassArguments) -> PassArguments {
        PassArguments {
            steps: self.line.steps.or(general.steps),
            preset: self.line.preset.or(general.preset),
            emphasis: self.line.emphasis.or(general.emphasis),
            body: self.line.body.or(general.body),
        }
    }

    pub fn request(&self, general: &PassArguments, default: Preset) -> Request {
        let mut request = Request::new(&self.line.prompt).seed(self.seed());
        if let Some(seconds) = self.line.seconds {
            request = request.seconds(seconds);
        }
        if let Some(goals) = &self.goals {
            request = request.scale(goals.clone());
        }
        self.pass(general).apply(request, default)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_prompt_is_enough_and_everything_may_be_said() {
        let text = "\u{feff}{\"prompt\": \"a person jumps\"}\n\n{\"prompt\": \"walk\", \"id\": \"w.1\", \"weight\": \
                    \"0:1 1:strong\", \"time\": 1.2, \"seconds\": 4, \"seed\": 7, \"shape\": \"peak=2\", \"part\": [\"arms:bound\"], \"steps\": 20, \"preset\": \"paper\", \
                    \"emphasis\": 3}\r\n";
        let (mut items, wrong) = items(text, &["glb", "json"]);
        assert_eq!(wrong, []);
        items[1].prepare(&Device::flex()).unwrap();
        assert_eq!([&items[0].id[..], &items[1].id], ["line-00001", "w.1"]);
        assert_eq!(
            items[1].goals.as_ref().unwrap().to_string(),
            "Weight 0:1 1:1.5, Time 1.2, Shape peak=2, arms Flow 0.8"
        );
        assert_eq!((items[1].number, items[1].seed()), (3, 7));
    }

    #[test]
    fn wrong_lines_are_told_with_their_numbers() {
        for (line, part) in [
            ("{\"prompt\": 3}", "prompt: invalid type"),
            (
                "{\"prompt\": \"a\", \"seconds\": \"long\"}",
                "seconds: invalid type: string \"long\", expected f32 at column",
            ),
            (
                "{\"prompt\": \"a\", \"scale\": [1, 2]}",
                "scale: invalid length 2, expected an array of length 4 at column",
            ),
            ("{\"weight\": 1}", "missing field `prompt`"),
            (
                "{\"prompt\": \"a\", \"wieght\": 1}",
                "unknown field `wieght`",
            ),
            (
                "{\"prompt\": \"a\", \"weight\": \"sudden\"}",
                "weight: sudden speaks of Time",
            ),
            (
                "{\"prompt\": \"a\", \"weight\": []}",
                "a number, a word or keys",
            ),
            (
                "{\"prompt\": \"a\", \"weight\": 2, \"scale\": [1,1,1,1]}",
                "found both",
            ),
            ("{\"prompt\": \"a\", \"scale\": [1,1,1,-1]}", "Shape"),
            (
                "{\"prompt\": \"a\", \"part\": [\"wings:strong\"]}",
                "part: expected one of arms",
            ),
            (
                "{\"prompt\": \"a\", \"flow\": \"peak=-1\"}",
                "flow: a peak must be",
            ),
            ("{\"prompt\": \"a\", \"id\": \"../a\"}", "expected an id"),
            ("{\"prompt\": \"a\", \"id\": \".a\"}", "expected an id"),
            ("{\"prompt\": \"a\", \"id\": \"A\"}", "that of line 1"),
            (
                "{\"prompt\": \"a\", \"id\": \"A.Features\"}",
                "the file a.features.npy is one of line 1",
            ),
            ("not json", "expected a JSON object"),
            ("[\"a\"]", "expected a JSON object"),
            ("{\"prompt\"", "at column"),
        ] {
            let text = format!("{{\"prompt\": \"a\", \"id\": \"a\"}}\n{line}");
            let (good, wrong) = items(&text, &["npy", "features.npy", "json"]);
            assert_eq!(good.len(), 1);
            assert_eq!(wrong[0].0, 2);
            assert!(wrong[0].1.contains(part), "{line}: {}", wrong[0].1);
        }
    }
}
