//! Further captions for motions that already have some.

use std::collections::HashMap;
use std::path::Path;

use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha12Rng;
use serde::Deserialize;

use crate::dataset::Dataset;
use crate::entry::{Caption, Entry};
use crate::error::DataError;
use crate::kind::Kind;
use crate::sides::swap_sides;
use crate::split::Split;

/// How many captions of its kind each motion gets, unless every caption is needed more often to be used at all.
const OF_KIND: usize = 20;

/// A line of the file: further captions, of one motion or of a kind of motion.
pub(crate) enum FurtherCaptions {
    Named(MotionCaptions),
    OfKind(KindCaptions),
}

/// A motion's name and its further captions.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct MotionCaptions {
    name: String,
    captions: Vec<String>,
}

/// A kind of motion and captions that are true of all its motions.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct KindCaptions {
    of: Kind,
    captions: Vec<String>,
}

impl Dataset {
    /// Adds the captions of a file to motions and returns the names in the file that no motion has, and the contents of
    /// kinds without a motion.
    ///
    /// Every line of the file is JSON: the captions of one motion, such as
    /// `{"name": "run_3", "captions": ["a kid dashes off"]}`, or of a kind of motion, such as
    /// `{"of": {"content": ["kick-left"]}, "captions": ["his left boot strikes the ball"]}`. A mirror image gets the
    /// captions of its original with left and right exchanged. Captions of a kind are dealt out to its motions for
    /// training, some twenty to each, and to those with the other side in their content with left and right exchanged.
    /// The same seed deals them out alike.
    ///
    /// # Errors
    ///
    /// If the file cannot be read, a line is invalid or names a motion a second time, or the data set has none of the
    /// motions.
    pub fn add_captions(
        &mut self,
        path: impl AsRef<Path>,
        seed: u64,
    ) -> Result<Vec<String>, DataError> {
        let path = path.as_ref();
        let text = std::fs::read_to_string(path).map_err(DataError::read(path))?;
        let lines = parse(&text).map_err(|(line, problem)| DataError::Captions {
            path: path.to_owned(),
            line,
            problem,
        })?;
        let count = lines.len();
        let (mut named, mut kinds) = (Vec::new(), Vec::new());
        for line in lines {
            match line {
                FurtherCaptions::Named(line) => named.push(line),
                FurtherCaptions::OfKind(line) => kinds.push(line),
            }
        }
        // What a motion is, is told by the captions that it had.
        let of_kinds: Vec<Vec<(usize, bool)>> = { kinds.iter() }
            .map(|line| self.motions_of(&line.of))
            .collect();
        let mut unknown = self.add_named(named);
        for (number, (line, motions)) in kinds.iter().zip(of_kinds).enumerate() {
            if motions.is_empty() {
                unknown.push(line.of.content.join(", "));
                continue;
            }
            let seed = seed.wrapping_add(number as u64);
            self.deal_out(&line.captions, &motions, seed);
        }
        match unknown.len() == count {
            true => Err(DataError::NoneNamed {
                path: path.to_owned(),
                folder: self.folder.clone(),
            }),
            false => Ok(unknown),
        }
    }

    /// Adds captions to motions by their names. Returns the names that no motion has.
    fn add_named(&mut self, lines: Vec<MotionCaptions>) -> Vec<String> {
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
            for text in &lines[index].captions {
                entry.add_caption(text, is_mirrored);
            }
        }
        let unknown = lines.into_iter().zip(known).filter(|(_, known)| !known);
        unknown.map(|(line, _)| line.name).collect()
    }

    /// Returns the motions for training of a kind, and for each whether the other side is meant in it.
    fn motions_of(&self, kind: &Kind) -> Vec<(usize, bool)> {
        let other_side = kind.other_side();
        let training = self.indices(Split::Train);
        let fitting = training.filter_map(|index| {
            let entry = &self.entries[index];
            match kind.fits(entry) {
                true => Some((index, false)),
                false => other_side.fits(entry).then_some((index, true)),
            }
        });
        fitting.collect()
    }

    /// Deals captions out to motions, so that all are used and motions have different ones as far as they go.
    fn deal_out(&mut self, captions: &[String], motions: &[(usize, bool)], seed: u64) {
        let each = OF_KIND.max(captions.len().div_ceil(motions.len()));
        let each = each.min(captions.len());
        let mut order: Vec<&String> = captions.iter().collect();
        order.shuffle(&mut ChaCha12Rng::seed_from_u64(seed));
        let mut next = order.into_iter().cycle();
        for &(index, is_mirrored) in motions {
            for text in next.by_ref().take(each) {
                self.entries[index].add_caption(text, is_mirrored);
            }
        }
    }
}

impl Entry {
    /// Adds a caption, with left and right exchanged if it `is_mirrored`.
    fn add_caption(&mut self, text: &str, is_mirrored: bool) {
        let text = match is_mirrored {
            true => swap_sides(text),
            false => text.to_owned(),
        };
        self.captions.push(Caption { text, tokens: None });
    }
}

/// Parses the lines. The error is the number of the first invalid line, counted from 1, and what is wrong with it.
pub(crate) fn parse(text: &str) -> Result<Vec<FurtherCaptions>, (usize, String)> {
    let mut lines = Vec::new();
    let mut first_lines: HashMap<String, usize> = HashMap::new();
    for (index, line) in text.trim_start_matches('\u{feff}').lines().enumerate() {
        if line.trim().is_empty() {
            continue;
        }
        let number = index + 1;
        let mut line = FurtherCaptions::parse(line).map_err(|problem| (number, problem))?;
        let captions = match &mut line {
            FurtherCaptions::Named(line) => &mut line.captions,
            FurtherCaptions::OfKind(line) => &mut line.captions,
        };
        for caption in captions.iter_mut() {
            *caption = caption.trim().to_owned();
        }
        if captions.is_empty() || captions.iter().any(String::is_empty) {
            let problem = format!("expected captions, found {captions:?}");
            return Err((number, problem));
        }
        if let FurtherCaptions::Named(MotionCaptions { name, .. }) = &line
            && let Some(first) = first_lines.insert(name.clone(), number)
        {
            return Err((number, format!("{name} has line {first} already")));
        }
        lines.push(line);
    }
    Ok(lines)
}

impl FurtherCaptions {
    fn parse(line: &str) -> Result<Self, String> {
        let value: serde_json::Value =
            serde_json::from_str(line).map_err(|error| error.to_string())?;
        let parsed = match value.get("of") {
            None => serde_json::from_value(value).map(Self::Named),
            Some(_) => serde_json::from_value(value).map(Self::OfKind),
        };
        let line = parsed.map_err(|error| error.to_string())?;
        match &line {
            Self::OfKind(KindCaptions { of, .. }) if of.content.is_empty() => {
                Err("content: expected contents, found none".into())
            }
            _ => Ok(line),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bad_line_is_named() {
        let good = r#"{"name": "a", "captions": ["x", " y "]}"#;
        let lines = parse(&format!("\u{feff}{good}\n\n")).unwrap();
        let FurtherCaptions::Named(line) = &lines[0] else {
            panic!("{good} is of a kind");
        };
        assert_eq!(line.captions, ["x", "y"]);
        for (bad, part) in [
            (good, "a has line 1 already"),
            (r#"{"name": "b", "captions": []}"#, "expected captions"),
            (r#"{"name": "b", "captions": [" "]}"#, "expected captions"),
            (r#"{"name": "b", "caption": ["x"]}"#, "unknown field"),
            (
                r#"{"of": {"content": []}, "captions": ["x"]}"#,
                "expected contents",
            ),
            (
                r#"{"of": {"contents": ["walk"]}, "captions": ["x"]}"#,
                "unknown field",
            ),
            (
                r#"{"name": "b", "of": {"content": ["walk"]}, "captions": ["x"]}"#,
                "unknown field",
            ),
            (r#"["b"]"#, "expected"),
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
