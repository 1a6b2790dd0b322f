//! The captions file: the list of motion files with their captions.

use std::collections::{BTreeMap, HashMap};
use std::path::{Component, Path};

use serde::Deserialize;

use crate::error::DataError;
use crate::split::Split;

/// A motion file, or a part of one, with its description.
#[derive(Debug, PartialEq)]
pub(crate) struct ListedMotion {
    /// The file, as a path within the folder, with slashes.
    pub file: String,
    /// The start of the part in seconds; `None` if the file's start is meant.
    pub start: Option<f64>,
    /// The end of the part in seconds; `None` if the file's end is meant.
    pub end: Option<f64>,
    pub description: MotionDescription,
}

/// The description of a listed motion: its captions and labels.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct MotionDescription {
    pub captions: Vec<String>,
    pub split: Option<Split>,
    pub content: Option<String>,
    pub style: Option<String>,
    pub source: Option<String>,
}

/// A line of the captions file in JSON.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ListingLine {
    file: String,
    captions: Vec<String>,
    split: Option<String>,
    content: Option<String>,
    style: Option<String>,
    source: Option<String>,
    start: Option<f64>,
    end: Option<f64>,
}

/// Reads a captions file. Every line is JSON, or a file, a tab and a caption.
///
/// Lines about the same part of the same file become one listed motion. A split applies to the whole file.
///
/// # Errors
///
/// If the file cannot be read, or a line is invalid or contradicts another.
pub(super) fn read(path: &Path) -> Result<Vec<ListedMotion>, DataError> {
    let text = std::fs::read_to_string(path).map_err(DataError::read(path))?;
    parse(&text).map_err(|(line, problem)| DataError::Captions {
        path: path.to_owned(),
        line,
        problem,
    })
}

pub(crate) fn parse(text: &str) -> Result<Vec<ListedMotion>, (usize, String)> {
    let mut motions: Vec<ListedMotion> = Vec::new();
    let mut indices: HashMap<(String, Option<u64>, Option<u64>), usize> = HashMap::new();
    let mut splits: BTreeMap<String, Split> = BTreeMap::new();
    for (index, line) in text.trim_start_matches('\u{feff}').lines().enumerate() {
        if line.trim().is_empty() {
            continue;
        }
        let error = |problem: String| (index + 1, problem);
        let motion = parse_line(line).map_err(error)?;
        if let Some(split) = motion.description.split {
            let first = *splits.entry(motion.file.clone()).or_insert(split);
            if first != split {
                let file = &motion.file;
                return Err(error(format!(
                    "{file} is {split} here, {first} in a line before"
                )));
            }
        }
        let key = (
            motion.file.clone(),
            motion.start.map(f64::to_bits),
            motion.end.map(f64::to_bits),
        );
        match indices.get(&key) {
            Some(&index) => motions[index]
                .description
                .merge(motion.description)
                .map_err(error)?,
            None => {
                indices.insert(key, motions.len());
                motions.push(motion);
            }
        }
    }
    for motion in &mut motions {
        motion.description.split = splits.get(&motion.file).copied();
    }
    Ok(motions)
}

fn parse_line(line: &str) -> Result<ListedMotion, String> {
    let line = match line.trim_start().starts_with('{') {
        true => serde_json::from_str::<ListingLine>(line).map_err(|error| error.to_string())?,
        false => {
            let (file, caption) = line
                .split_once('\t')
                .ok_or_else(|| format!("expected JSON, or file, tab, caption; found {line:?}"))?;
            ListingLine {
                file: file.trim().to_owned(),
                captions: vec![caption.to_owned()],
                split: None,
                content: None,
                style: None,
                source: None,
                start: None,
                end: None,
            }
        }
    };
    let captions: Vec<String> = { line.captions.iter() }
        .map(|caption| caption.trim().to_owned())
        .collect();
    if captions.is_empty() || captions.iter().any(String::is_empty) {
        return Err(format!("expected captions, found {:?}", line.captions));
    }
    let split = line.split.map(|split| split.parse::<Split>()).transpose();
    let times = [line.start.unwrap_or(0.0), line.end.unwrap_or(f64::MAX)];
    if !(times[0] >= 0.0 && times[0] < times[1]) {
        return Err(format!(
            "expected a start before the end, in seconds from 0, found {times:?}"
        ));
    }
    Ok(ListedMotion {
        file: path_within_folder(&line.file)?,
        start: line.start,
        end: line.end,
        description: MotionDescription {
            captions,
            split: split.map_err(|error| error.to_string())?,
            content: line.content,
            style: line.style,
            source: line.source,
        },
    })
}

/// Returns the path of a file within the folder, with slashes and without `.`.
///
/// # Errors
///
/// If the path is empty or leaves the folder.
fn path_within_folder(file: &str) -> Result<String, String> {
    let slashed = file.replace('\\', "/");
    let parts: Option<Vec<&str>> = Path::new(&slashed)
        .components()
        .filter(|part| *part != Component::CurDir)
        .map(|part| match part {
            Component::Normal(part) => part.to_str(),
            _ => None,
        })
        .collect();
    match parts {
        Some(parts) if !parts.is_empty() => Ok(parts.join("/")),
        _ => Err(format!("expected a file within the folder, found {file:?}")),
    }
}

impl MotionDescription {
    /// Adds the captions and labels of another line about the same motion.
    ///
    /// # Errors
    ///
    /// If both lines have a label and the labels differ.
    fn merge(&mut self, other: MotionDescription) -> Result<(), String> {
        for (name, ours, theirs) in [
            ("content", &mut self.content, other.content),
            ("style", &mut self.style, other.style),
            ("source", &mut self.source, other.source),
        ] {
            match (&ours, theirs) {
                (Some(ours), Some(theirs)) if *ours != theirs => {
                    return Err(format!(
                        "{name} is {theirs:?} here, {ours:?} in a line before"
                    ));
                }
                (None, theirs) => *ours = theirs,
                _ => {}
            }
        }
        self.captions.extend(other.captions);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_of_one_part_are_one_motion() {
        let text = "walk.bvh\ta person walks\n\
                    ./walk.bvh\ta man goes\n\
                    {\"file\": \"a\\\\b.bvh\", \"captions\": [\"x\"], \"split\": \"val\", \"content\": \"jump\"}\n\
                    {\"file\": \"a/b.bvh\", \"captions\": [\"y\"], \"start\": 1, \"end\": 3.5}\n";
        let motions = parse(text).unwrap();
        assert_eq!(motions.len(), 3);
        assert_eq!(
            motions[0].description.captions,
            ["a person walks", "a man goes"]
        );
        assert_eq!(
            (&*motions[1].file, &*motions[2].file),
            ("a/b.bvh", "a/b.bvh")
        );
        assert_eq!((motions[2].start, motions[2].end), (Some(1.0), Some(3.5)));
        // The split of a file applies to all its parts.
        assert_eq!(motions[2].description.split, Some(Split::Validation));
        assert_eq!(motions[0].description.split, None);
    }

    #[test]
    fn an_invalid_line_is_named_by_its_number() {
        for (line, part) in [
            ("walk.bvh a person walks", "tab"),
            ("walk.bvh\t ", "captions"),
            ("{\"file\": \"a.bvh\"}", "captions"),
            ("{\"file\": \"a.bvh\", \"captions\": []}", "captions"),
            (
                "{\"file\": \"a.bvh\", \"captions\": [\"x\"], \"spilt\": \"val\"}",
                "spilt",
            ),
            (
                "{\"file\": \"a.bvh\", \"captions\": [\"x\"], \"split\": \"dev\"}",
                "dev",
            ),
            (
                "{\"file\": \"a.bvh\", \"captions\": [\"x\"], \"split\": \"val\"}",
                "train in a line",
            ),
            (
                "{\"file\": \"a.bvh\", \"captions\": [\"x\"], \"content\": \"y\"}",
                "\"x\" in a line",
            ),
            (
                "{\"file\": \"a.bvh\", \"captions\": [\"x\"], \"start\": 3, \"end\": 2}",
                "start before",
            ),
            ("../a.bvh\tx", "within the folder"),
            ("/a.bvh\tx", "within the folder"),
        ] {
            let first = r#"{"file": "a.bvh", "captions": ["x"], "split": "train", "content": "x"}"#;
            let (number, message) = parse(&format!("{first}\n\n{line}\n")).unwrap_err();
            assert_eq!(number, 3, "{line}");
            assert!(message.contains(part), "{line}: {message}");
        }
    }
}
