//! The lines of a file of requests.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use lamogen::{Device, Goals, JsonRequest, NamedMotions, Preset, Request, RootMotion};
use lamogen_data::Checksum;
use serde_json::Value;

use crate::arguments::{BodyName, PassArguments, PresetName};
use crate::output::OutputFile;

/// A request of a batch.
#[derive(Clone, Debug)]
pub struct BatchItem {
    /// The number of the line in the file, from 1.
    pub number: usize,
    /// The name of the output files.
    pub id: String,
    pub line: JsonRequest,
    /// The goals of each sentence, after [`BatchItem::read_files`].
    goals: Vec<Option<Goals>>,
    /// The motions before and after, once they are read with the goals.
    named_motions: NamedMotions,
    /// The checksums of the motion files before and after.
    named_checksums: Vec<Option<String>>,
    /// The checksum of the motion file that has the Laban features to reach, for each sentence.
    like_checksums: Vec<Option<String>>,
}

/// Parses the requests of a file. Returns them, and the number of each wrong line with the reason. `endings` are the
/// file name extensions of the files that are written for each request.
pub fn parse_items(text: &str, endings: &[&str]) -> (Vec<BatchItem>, Vec<(usize, String)>) {
    let (mut items, mut wrong) = (Vec::new(), Vec::new());
    let mut ids: HashMap<String, usize> = HashMap::new();
    // Two ids may name one file: x with features.npy, and x.features with npy.
    let mut files: HashMap<String, usize> = HashMap::new();
    for (index, text) in text.lines().enumerate() {
        // Some editors put a byte order mark before the first line.
        let text = text.trim_start_matches('\u{feff}').trim();
        if text.is_empty() {
            continue;
        }
        let number = index + 1;
        match parse_item(number, text) {
            Ok(item) => {
                let id = item.id.to_lowercase();
                if let Some(first) = ids.insert(id.clone(), number) {
                    let reason = format!("the id {:?} is that of line {first}", item.id);
                    wrong.push((number, reason));
                    continue;
                }
                let names = endings.iter().map(|ending| format!("{id}.{ending}"));
                let duplicate = names.fold(None, |duplicate, name| {
                    let first = files.insert(name.clone(), number);
                    duplicate.or(first.map(|first| (name, first)))
                });
                match duplicate {
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

/// Parses one line.
fn parse_item(number: usize, text: &str) -> Result<BatchItem, String> {
    let line = JsonRequest::parse(text).map_err(|error| error.to_string())?;
    let ending = format!("-{}", OutputFile::UNFINISHED);
    if let Some(id) = &line.id
        && id.to_lowercase().ends_with(&ending)
    {
        return Err(format!(
            "expected an id that does not end in {ending}, as files of stopped motions do, found {id:?}"
        ));
    }
    Ok(BatchItem {
        number,
        id: { line.id.clone() }.unwrap_or_else(|| format!("line-{number:05}")),
        line,
        goals: Vec::new(),
        named_motions: NamedMotions::default(),
        named_checksums: Vec::new(),
        like_checksums: Vec::new(),
    })
}

/// Computes the checksum of a file; `None` if it cannot be read.
pub fn file_checksum(path: &Path) -> Option<String> {
    let mut sum = Checksum::new(0);
    sum.add(&std::fs::read(path).ok()?);
    Some(format!("{:016x}", sum.value()))
}

impl BatchItem {
    /// Combines the goals of the sentences, and reads the motion files that the request names: with features to reach, to go on
    /// from, to lead to, and with poses.
    pub fn read_files(&mut self, device: &Device) -> Result<(), String> {
        let goals = self.line.goals(device);
        self.goals = goals.map_err(|error| error.to_string())?;
        let named_motions = self.line.named_motions();
        self.named_motions = named_motions.map_err(|error| error.to_string())?;
        Ok(())
    }

    /// Computes the checksums of the motion files that the request names, as far as they can be read. A
    /// motion counts as finished only while they stay the same. `checksums` has those of the files that were read before.
    pub fn compute_checksums(&mut self, checksums: &mut HashMap<PathBuf, Option<String>>) {
        let mut checksum = |path: &Option<PathBuf>| {
            let path = path.as_ref()?;
            let checksum = { checksums.entry(path.clone()) }.or_insert_with(|| file_checksum(path));
            checksum.clone()
        };
        let sentences = self.line.sentences();
        self.like_checksums = sentences.map(|sentence| checksum(&sentence.like)).collect();
        let neighbours = [&self.line.after, &self.line.before].map(&mut checksum);
        let poses = self
            .line
            .pose
            .iter()
            .map(|pose| checksum(&Some(pose.path.clone())));
        self.named_checksums = neighbours.into_iter().chain(poses).collect();
    }

    /// Returns the checksums of the motion files to go on from and to lead to, and of those with poses; `None` if the request names
    /// none.
    pub fn named_checksums(&self) -> Option<&[Option<String>]> {
        let line = &self.line;
        let has_any = line.after.is_some() || line.before.is_some() || !line.pose.is_empty();
        has_any.then_some(&self.named_checksums)
    }

    /// Returns the checksum of the motion file with the features to reach, or null if there is no such file; for several
    /// sentences a list of them.
    pub fn like_checksums(&self) -> Value {
        match &self.like_checksums[..] {
            [] => Value::Null,
            [checksum] => checksum.clone().into(),
            checksums => checksums.to_vec().into(),
        }
    }

    /// Whether the request has goals or places; known after [`BatchItem::read_files`].
    pub fn is_guided(&self) -> bool {
        self.goals.iter().any(Option::is_some)
            || !self.line.places().is_empty()
            || !self.line.pose.is_empty()
    }

    /// Returns the length of the motion in seconds.
    pub fn seconds(&self) -> f32 {
        self.line.total_seconds()
    }

    /// Returns the seed of the start noise.
    pub fn seed(&self) -> u64 {
        self.line.seed.unwrap_or(0)
    }

    /// Returns the options of the passes: those of the line, and those of the command line where the line has none.
    pub fn pass(&self, defaults: &PassArguments) -> PassArguments {
        PassArguments {
            steps: self.line.steps.or(defaults.steps),
            preset: self.line.preset.map(PresetName::of).or(defaults.preset),
            emphasis: self.line.emphasis.or(defaults.emphasis),
            body: self.line.body.map(BodyName::of).or(defaults.body),
            is_looped: self.line.is_looped.unwrap_or(defaults.is_looped),
        }
    }

    /// Returns where files of the motion keep its travel: the place that the line states, or else `default`.
    pub fn root_motion(&self, default: RootMotion) -> RootMotion {
        self.line.root_motion().unwrap_or(default)
    }

    /// Makes the request. `defaults` are the options of the command line, and `preset` is that of the model.
    pub fn request(&self, defaults: &PassArguments, preset: Preset) -> Request {
        let pass = self.pass(defaults);
        let mut line = self.line.clone();
        line.steps = pass.steps;
        line.preset = pass.preset.map(PresetName::preset);
        line.emphasis = pass.emphasis;
        line.body = pass.body.map(BodyName::body);
        line.is_looped = Some(pass.is_looped);
        self.named_motions
            .apply(line.request_with(&self.goals, preset))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_prompt_is_required_and_all_fields_are_read() {
        let text = "\u{feff}{\"prompt\": \"a person jumps\"}\n\n{\"prompt\": \"walk\", \"id\": \"w.1\", \"weight\": \
                    \"0:1 1:strong\", \"time\": 1.2, \"seconds\": 4, \"seed\": 7, \"shape\": \"peak=2\", \"part\": [\"arms:bound\"], \"steps\": 20, \"preset\": \"paper\", \
                    \"emphasis\": 3}\r\n";
        let (mut items, wrong) = parse_items(text, &["glb", "json"]);
        assert_eq!(wrong, []);
        items[1].read_files(&Device::flex()).unwrap();
        assert_eq!([&items[0].id[..], &items[1].id], ["line-00001", "w.1"]);
        assert_eq!(
            items[1].goals[0].as_ref().unwrap().to_string(),
            "Weight 0:1 1:1.5, Time 1.2, Shape peak=2, arms Flow 0.8"
        );
        assert_eq!((items[1].number, items[1].seed()), (3, 7));
    }

    #[test]
    fn wrong_lines_are_reported_with_their_numbers() {
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
            (
                "{\"prompt\": \"a\", \"id\": \"a-unfinished\"}",
                "does not end in -unfinished",
            ),
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
            let (good, wrong) = parse_items(&text, &["npy", "features.npy", "json"]);
            assert_eq!(good.len(), 1);
            assert_eq!(wrong[0].0, 2);
            assert!(wrong[0].1.contains(part), "{line}: {}", wrong[0].1);
        }
    }
}
