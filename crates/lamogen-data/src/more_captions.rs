//! Further captions for motions that already have some.

use std::collections::HashMap;
use std::path::Path;

use serde::Deserialize;

use crate::dataset::Dataset;
use crate::entry::Caption;
use crate::error::DataError;
use crate::sides::swap_sides;

/// A line of the file: a motion's name and its further captions.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct MotionCaptions {
    name: String,
    captions: Vec<String>,
}

impl Dataset {
    /// Adds the captions of a file to motions and returns the names in the file that no motion has.
    ///
    /// Every line of the file is JSON such as `{"name": "run_3", "captions": ["a kid dashes off"]}`, one motion per
    /// line. A mirror image gets the captions of its original with left and right exchanged.
    ///
    /// # Errors
    ///
    /// If the file cannot be read, a line is invalid or names a motion a second time, or the data set has none of the
    /// named motions.
    pub fn add_captions(&mut self, path: impl AsRef<Path>) -> Result<Vec<String>, DataError> {
        let path = path.as_ref();
        let text = std::fs::read_to_string(path).map_err(DataError::read(path))?;
        let lines = parse(&text).map_err(|(line, problem)| DataError::Captions {
            path: path.to_owned(),
            line,
            problem,
        })?;
        let mut known = vec![false; lines.len()];
        let line_of: HashMap<&str, usize> = { lines.iter().enumerate() }
            .map(|(index, line)| (&*line.name, index))
            .collect();
        for entry in &mut self.entries {
            // Mirror images are named like their originals, with an M in front.
            let original = entry.name.strip_prefix('M').filter(|_| entry.mirror);
            let Some(&index) = line_of.get(original.unwrap_or(&entry.name)) else {
                continue;
            };
            known[index] = true;
            let is_mirrored = original.is_some();
            entry
                .captions
                .extend(lines[index].captions.iter().map(|text| Caption {
                    text: if is_mirrored {
                        swap_sides(text)
                    } else {
                        text.clone()
                    },
                    tokens: None,
                }));
        }
        if !known.contains(&true) {
            return Err(DataError::NoneNamed {
                path: path.to_owned(),
                folder: self.folder.clone(),
            });
        }
        let unknown = lines.into_iter().zip(known).filter(|(_, known)| !known);
        Ok(unknown.map(|(line, _)| line.name).collect())
    }
}

/// Parses the lines. The error is the number of the first invalid line, counted from 1, and what is wrong with it.
pub(crate) fn parse(text: &str) -> Result<Vec<MotionCaptions>, (usize, String)> {
    let mut lines: Vec<MotionCaptions> = Vec::new();
    let mut first_lines: HashMap<String, usize> = HashMap::new();
    for (index, line) in text.trim_start_matches('\u{feff}').lines().enumerate() {
        if line.trim().is_empty() {
            continue;
        }
        let number = index + 1;
        let mut line: MotionCaptions =
            serde_json::from_str(line).map_err(|error| (number, error.to_string()))?;
        for caption in &mut line.captions {
            *caption = caption.trim().to_owned();
        }
        if line.captions.is_empty() || line.captions.iter().any(String::is_empty) {
            let problem = format!("expected captions, found {:?}", line.captions);
            return Err((number, problem));
        }
        if let Some(first) = first_lines.insert(line.name.clone(), number) {
            return Err((number, format!("{} has line {first} already", line.name)));
        }
        lines.push(line);
    }
    Ok(lines)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bad_line_is_named() {
        let good = r#"{"name": "a", "captions": ["x", " y "]}"#;
        let lines = parse(&format!("\u{feff}{good}\n\n")).unwrap();
        assert_eq!(lines[0].captions, ["x", "y"]);
        for (bad, part) in [
            (good, "a has line 1 already"),
            (r#"{"name": "b", "captions": []}"#, "expected captions"),
            (r#"{"name": "b", "captions": [" "]}"#, "expected captions"),
            (r#"{"name": "b", "caption": ["x"]}"#, "unknown field"),
            ("b\tx", "expected"),
        ] {
            let Err((line, problem)) = parse(&format!("{good}\n{bad}\n")) else {
                panic!("{bad} is taken");
            };
            assert_eq!(line, 2);
            assert!(problem.contains(part), "{problem}");
        }
    }
}
