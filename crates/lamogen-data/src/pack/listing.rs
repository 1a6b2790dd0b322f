//! The file that says what motion files show.

use std::collections::{BTreeMap, HashMap};
use std::path::{Component, Path};

use serde::Deserialize;

use crate::error::DataError;
use crate::split::Split;

/// A motion file, or a part of one, with what is said of it.
#[derive(Debug, PartialEq)]
pub(super) struct Take {
    /// The file, as a path within the folder, with slashes.
    pub file: String,
    /// From where to where, in seconds.
    pub start: Option<f64>,
    pub end: Option<f64>,
    pub said: Said,
}

/// What is said of a take.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Said {
    pub captions: Vec<String>,
    pub split: Option<Split>,
    pub content: Option<String>,
    pub style: Option<String>,
    pub source: Option<String>,
}

/// A line in JSON.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Line {
    file: String,
    captions: Vec<String>,
    split: Option<String>,
    content: Option<String>,
    style: Option<String>,
    source: Option<String>,
    start: Option<f64>,
    end: Option<f64>,
}

/// Reads the file: every line is JSON, or file, tab, caption. Lines of the same part of the same file are one take; a
/// split counts for the whole file.
///
/// # Errors
///
/// If it cannot be read, or a line makes no sense or contradicts another.
pub(super) fn read(path: &Path) -> Result<Vec<Take>, DataError> {
    let text = std::fs::read_to_string(path).map_err(DataError::read(path))?;
    parse(&text).map_err(|(line, problem)| DataError::Captions {
        path: path.to_owned(),
        line,
        problem,
    })
}

fn parse(text: &str) -> Result<Vec<Take>, (usize, String)> {
    let mut takes: Vec<Take> = Vec::new();
    let mut places: HashMap<(String, Option<u64>, Option<u64>), usize> = HashMap::new();
    let mut splits: BTreeMap<String, Split> = BTreeMap::new();
    for (number, line) in text.trim_start_matches('\u{feff}').lines().enumerate() {
        if line.trim().is_empty() {
            continue;
        }
        let wrong = |problem: String| (number + 1, problem);
        let take = take(line).map_err(wrong)?;
        if let Some(split) = take.said.split {
            let first = *splits.entry(take.file.clone()).or_insert(split);
            if first != split {
                let file = &take.file;
                return Err(wrong(format!(
                    "{file} is {split} here, {first} in a line before"
                )));
            }
        }
        let key = (
            take.file.clone(),
            take.start.map(f64::to_bits),
            take.end.map(f64::to_bits),
        );
        match places.get(&key) {
            Some(&place) => takes[place].said.join(take.said).map_err(wrong)?,
            None => {
                places.insert(key, takes.len());
                takes.push(take);
            }
        }
    }
    for take in &mut takes {
        take.said.split = splits.get(&take.file).copied();
    }
    Ok(takes)
}

fn take(line: &str) -> Result<Take, String> {
    let line = match line.trim_start().starts_with('{') {
        true => serde_json::from_str::<Line>(line).map_err(|error| error.to_string())?,
        false => {
            let (file, caption) = line
                .split_once('\t')
                .ok_or_else(|| format!("expected JSON, or file, tab, caption; found {line:?}"))?;
            Line {
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
    Ok(Take {
        file: within(&line.file)?,
        start: line.start,
        end: line.end,
        said: Said {
            captions,
            split: split.map_err(|error| error.to_string())?,
            content: line.content,
            style: line.style,
            source: line.source,
        },
    })
}

/// A path within the folder, with slashes and without `.`.
fn within(file: &str) -> Result<String, String> {
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

impl Said {
    /// Adds what another line says.
    fn join(&mut self, other: Said) -> Result<(), String> {
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
    fn lines_of_one_part_are_one_take() {
        let text = "walk.bvh\ta person walks\n\
                    ./walk.bvh\ta man goes\n\
                    {\"file\": \"a\\\\b.bvh\", \"captions\": [\"x\"], \"split\": \"val\", \"content\": \"jump\"}\n\
                    {\"file\": \"a/b.bvh\", \"captions\": [\"y\"], \"start\": 1, \"end\": 3.5}\n";
        let takes = parse(text).unwrap();
        assert_eq!(takes.len(), 3);
        assert_eq!(takes[0].said.captions, ["a person walks", "a man goes"]);
        assert_eq!((&*takes[1].file, &*takes[2].file), ("a/b.bvh", "a/b.bvh"));
        assert_eq!((takes[2].start, takes[2].end), (Some(1.0), Some(3.5)));
        // The split of a file counts for all its parts.
        assert_eq!(takes[2].said.split, Some(Split::Validation));
        assert_eq!(takes[0].said.split, None);
    }

    #[test]
    fn what_makes_no_sense_is_named_with_its_line() {
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
