//! The clips of the study and the answers about them.

use std::collections::{BTreeMap, HashMap};
use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};

/// The four Efforts that a clip was made with: Space (indirect, direct), Weight (light, strong), Time (sustained, sudden) and Flow (free, bound), from -1 to 1.
pub type Effort = [i8; 4];

/// The Efforts of the clip that all others are compared with.
const NEUTRAL: Effort = [0; 4];

/// The actions of the study, with the folder of their clips, and the beginning of the clips' names.
const ACTIONS: [(&str, &str, &str); 3] = [
    ("walking", "walking_perform_user_study_1", "walking"),
    ("pointing", "pointing_perform_user_study_1", "Pointing"),
    ("picking", "picking_perform_user_study_1", "Picking"),
];

/// A clip of the study.
#[derive(Clone, Debug, PartialEq)]
pub struct Clip {
    /// The index of its action in [`Study::ACTIONS`].
    pub action: usize,
    /// What it was made with.
    pub effort: Effort,
    /// Its file.
    pub path: PathBuf,
}

/// Three clips that people compared, and how many found which two most alike.
#[derive(Clone, Debug, PartialEq)]
pub struct Triple {
    pub action: usize,
    /// The indices of the clips: left, neutral, right.
    pub clips: [usize; 3],
    /// The numbers of answers for each of [`PAIRS`].
    pub answers: [u32; 3],
}

/// The pairs of a triple, as places in [`Triple::clips`].
pub const PAIRS: [(usize, usize); 3] = [(0, 1), (0, 2), (1, 2)];

/// The study.
pub struct Study {
    pub clips: Vec<Clip>,
    pub triples: Vec<Triple>,
}

impl Study {
    /// The names of the actions.
    pub const ACTIONS: [&'static str; 3] = [ACTIONS[0].0, ACTIONS[1].0, ACTIONS[2].0];

    /// Reads the answers from the repository's tables, and finds the clips.
    ///
    /// # Errors
    ///
    /// If a table or a clip is missing, or a line of a table is not as expected.
    pub fn read(folder: &Path) -> Result<Study, Box<dyn Error>> {
        let mut study = Study {
            clips: Vec::new(),
            triples: Vec::new(),
        };
        for (action, (name, clips, prefix)) in ACTIONS.into_iter().enumerate() {
            let path = folder.join(format!("aux/{name}_similarity_comparisons_ratios.csv"));
            let text = fs::read_to_string(&path)
                .map_err(|error| format!("{}: {error}", path.display()))?;
            let table = parse(&text).map_err(|error| format!("{}, {error}", path.display()))?;
            let mut place_of: HashMap<Effort, usize> = HashMap::new();
            let mut place = |effort: Effort| -> Result<usize, String> {
                if let Some(&place) = place_of.get(&effort) {
                    return Ok(place);
                }
                let labels = effort.map(|label| label.to_string()).join("_");
                let path = folder.join(format!("{clips}/{prefix}_{labels}.bvh"));
                if !path.exists() {
                    return Err(format!(
                        "{}: expected a clip of the study, found none",
                        path.display()
                    ));
                }
                study.clips.push(Clip {
                    action,
                    effort,
                    path,
                });
                place_of.insert(effort, study.clips.len() - 1);
                Ok(study.clips.len() - 1)
            };
            for ((left, right), answers) in table {
                study.triples.push(Triple {
                    action,
                    clips: [place(left)?, place(NEUTRAL)?, place(right)?],
                    answers,
                });
            }
        }
        Ok(study)
    }

    /// Returns the number of answers.
    pub fn answers(&self) -> u32 {
        self.triples.iter().map(Triple::count).sum()
    }
}

impl Triple {
    /// Returns the number of answers.
    pub fn count(&self) -> u32 {
        self.answers.iter().sum()
    }
}

/// The number of answers for each pair of clips left and right.
type Answers = BTreeMap<(Effort, Effort), [u32; 3]>;

/// Parses a table with the columns `efforts_tuples`, `selected0`, `selected1` and `count`; further ones are ignored.
fn parse(text: &str) -> Result<Answers, String> {
    let mut answers = Answers::new();
    for (number, line) in text.lines().enumerate().skip(1) {
        let line_error = |problem: String| format!("line {}: {problem}", number + 1);
        // The Efforts have commas in quotes.
        let parsed = line
            .strip_prefix('"')
            .and_then(|rest| rest.split_once("\","));
        let (efforts, rest) = parsed
            .ok_or_else(|| line_error(format!("expected Efforts in quotes, found {line:?}")))?;
        let pair = efforts
            .split_once('_')
            .and_then(|(left, right)| Some((parse_effort(left)?, parse_effort(right)?)));
        let pair = pair.ok_or_else(|| {
            line_error(format!(
                "expected Efforts such as [-1,0,1,0]_[0,0,1,1], found {efforts:?}"
            ))
        })?;
        let numbers: Vec<Option<usize>> = rest
            .split(',')
            .take(3)
            .map(|field| field.parse().ok())
            .collect();
        let &[Some(first), Some(second), Some(count)] = numbers.as_slice() else {
            return Err(line_error(format!(
                "expected two places and a number of answers, found {rest:?}"
            )));
        };
        let place = PAIRS.iter().position(|&pair| pair == (first, second));
        let place = place.ok_or_else(|| {
            line_error(format!(
                "expected the places 0 and 1, 0 and 2, or 1 and 2, found {first} and {second}"
            ))
        })?;
        answers.entry(pair).or_default()[place] += count as u32;
    }
    match answers.is_empty() {
        true => Err("line 2: expected answers, found none".into()),
        false => Ok(answers),
    }
}

/// Parses Efforts such as `[-1,0,1,0]`.
fn parse_effort(text: &str) -> Option<Effort> {
    let labels = text.strip_prefix('[')?.strip_suffix(']')?.split(',');
    let labels: Option<Vec<i8>> = labels.map(|label| label.trim().parse().ok()).collect();
    labels?.try_into().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEAD: &str = "\"efforts_tuples\",\"selected0\",\"selected1\",\"count\",\"more\"\n";

    #[test]
    fn answers_are_those_of_the_table() {
        let lines = "\"[-1,0,1,0]_[0,0,1,1]\",0,1,7,0.7\n\"[-1,0,1,0]_[0,0,1,1]\",1,2,3,0.3\n";
        let answers = parse(&format!("{HEAD}{lines}")).unwrap();
        let pair = ([-1, 0, 1, 0], [0, 0, 1, 1]);
        assert_eq!(answers.into_iter().collect::<Vec<_>>(), [(pair, [7, 0, 3])]);
    }

    #[test]
    fn a_line_that_cannot_be_read_is_named() {
        for (line, part) in [
            ("[0,0,0,0]", "quotes"),
            ("\"[0,0,0]_[0,0,0,1]\",0,1,7", "Efforts such as"),
            ("\"[0,0,0,1]_[1,0,0,1]\",0,1,seven", "number of answers"),
            ("\"[0,0,0,1]_[1,0,0,1]\",1,0,7", "found 1 and 0"),
        ] {
            let error = parse(&format!("{HEAD}{line}\n")).unwrap_err();
            assert!(
                error.starts_with("line 2") && error.contains(part),
                "{error}"
            );
        }
        assert!(parse(HEAD).unwrap_err().contains("found none"));
    }

    #[test]
    fn a_folder_without_the_study_is_an_error_that_names_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let error = Study::read(folder.path()).err().unwrap().to_string();
        assert!(
            error.contains("walking_similarity_comparisons_ratios.csv"),
            "{error}"
        );
        fs::create_dir(folder.path().join("aux")).unwrap();
        let table = format!("{HEAD}\"[0,0,0,1]_[1,0,0,1]\",0,1,7\n");
        let path = folder
            .path()
            .join("aux/walking_similarity_comparisons_ratios.csv");
        fs::write(path, table).unwrap();
        let error = Study::read(folder.path()).err().unwrap().to_string();
        assert!(error.contains("walking_0_0_0_1.bvh"), "{error}");
    }
}
