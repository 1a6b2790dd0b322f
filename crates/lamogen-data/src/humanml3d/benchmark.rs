//! The motions of a split as the public evaluation of HumanML3D counts them.

use std::path::Path;

use lamogen_motion::{FRAMES_PER_SECOND, FeatureGroup, POSE_FEATURES};
use rayon::prelude::*;

use super::{CLIPS_PER_BATCH, TEXTS, VECTORS, list_file, read_array};
use crate::entry::Caption;
use crate::error::DataError;
use crate::options::Progress;
use crate::problems::{Problem, ProblemKind, Problems};
use crate::split::Split;

/// The motions of a split of HumanML3D's folder, chosen by the rules of the public evaluation (Guo et al. 2022, public code
/// `EricGuo5513/text-to-motion`), in 32 bits.
///
/// A [`Dataset`](crate::Dataset) of the same folder has slightly other motions, since its rules are those of training here. The rules of the
/// public evaluation are:
///
/// - A recording of less than 40 frames, or of 200 and more, is left out with all its captions, also with those of a part.
/// - A caption from 0.0 to 0.0 (or `nan`) describes the whole recording. All such captions of a recording belong to one motion.
/// - Any other caption describes a part and is a motion of its own, if the part has 40 to 199 frames.
/// - A recording without a caption of the whole is only there with its parts.
/// - A mirror image (`M012345`) is a recording like any other.
/// - Lines are split at every `#`. From a line that cannot be read on, the rest of its recording is left out, with the captions of the whole.
///
/// One rule is stricter: a recording with numbers that are not finite is left out.
#[derive(Clone, Debug)]
pub struct BenchmarkSplit {
    clips: Vec<BenchmarkClip>,
    problems: Problems,
    listed: usize,
}

/// A motion of a [`BenchmarkSplit`]: a whole recording with its captions, or a part of one with its caption.
#[derive(Clone, Debug, PartialEq)]
pub struct BenchmarkClip {
    /// The name of the recording; that of a part begins with a letter, as in `A_012345`.
    pub name: String,
    /// The captions; at least one.
    pub captions: Vec<Caption>,
    /// The pose features, 263 per frame, not normalised.
    pub features: Vec<f32>,
}

impl BenchmarkClip {
    /// Returns the length in frames: 40 to 199.
    pub fn frames(&self) -> usize {
        self.features.len() / POSE_FEATURES
    }
}

impl BenchmarkSplit {
    /// The least number of frames of a motion.
    pub const MIN_FRAMES: usize = 40;
    /// The largest number of frames of a motion.
    pub const MAX_FRAMES: usize = 199;

    /// Reads a split of a folder of HumanML3D's form. `observer` gets the progress of reading.
    ///
    /// Recordings that are left out are listed in [`problems`](Self::problems).
    ///
    /// # Errors
    ///
    /// If the split's list of names cannot be read, or no motion is left.
    pub fn open(
        folder: impl AsRef<Path>,
        split: Split,
        observer: &mut dyn FnMut(Progress),
    ) -> Result<BenchmarkSplit, DataError> {
        let folder = folder.as_ref();
        let path = folder.join(list_file(split));
        let text = std::fs::read_to_string(&path).map_err(DataError::read(&path))?;
        let mut problems = Problems::default();
        let mut names: Vec<&str> = Vec::new();
        let mut seen = std::collections::HashSet::new();
        let lines = text.trim_start_matches('\u{feff}').lines().map(str::trim);
        for name in lines.filter(|name| !name.is_empty()) {
            match seen.insert(name) {
                true => names.push(name),
                false => {
                    let reason = format!("listed twice in {}", list_file(split));
                    problems.add(name, ProblemKind::Twice, reason);
                }
            }
        }
        let mut clips = Vec::new();
        for (index, batch) in names.chunks(CLIPS_PER_BATCH).enumerate() {
            let recordings: Vec<Recording> = { batch.par_iter() }
                .map(|name| Recording::read(folder, name))
                .collect();
            for recording in recordings {
                clips.extend(recording.clips);
                problems.extend(recording.problems);
            }
            observer(Progress {
                done: index * CLIPS_PER_BATCH + batch.len(),
                all: names.len(),
            });
        }
        if clips.is_empty() {
            return Err(DataError::Nothing {
                folder: folder.to_owned(),
                problems: problems.summary(),
            });
        }
        // The public code sorts by length, too; motions of one length keep their order.
        clips.sort_by_key(BenchmarkClip::frames);
        Ok(BenchmarkSplit {
            clips,
            problems,
            listed: names.len(),
        })
    }

    /// Returns the motions, from the shortest to the longest.
    pub fn clips(&self) -> &[BenchmarkClip] {
        &self.clips
    }

    /// Returns the recordings and parts that were left out, with the reasons.
    pub fn problems(&self) -> &Problems {
        &self.problems
    }

    /// Returns the number of recordings that the split lists, whether they were left out or not.
    pub fn listed(&self) -> usize {
        self.listed
    }

    /// Computes the deviation of each [`FeatureGroup`] over all frames, as HumanML3D's `Std.npy` has it: the mean of the standard deviations
    /// of the group's features.
    pub fn deviations(&self) -> [f64; FeatureGroup::ALL.len()] {
        let mut sums = vec![[0.0f64; 2]; POSE_FEATURES];
        let mut count = 0.0;
        let rows = self
            .clips
            .iter()
            .flat_map(|clip| clip.features.chunks_exact(POSE_FEATURES));
        for row in rows {
            count += 1.0;
            for (sum, &value) in sums.iter_mut().zip(row) {
                let value = f64::from(value);
                *sum = [sum[0] + value, sum[1] + value * value];
            }
        }
        FeatureGroup::ALL.map(|group| {
            let deviations = sums[group.range()].iter().map(|[sum, squares]| {
                let mean = sum / count;
                (squares / count - mean * mean).max(0.0).sqrt()
            });
            deviations.sum::<f64>() / group.width() as f64
        })
    }
}

/// What a recording contributes.
#[derive(Default)]
struct Recording {
    clips: Vec<BenchmarkClip>,
    problems: Vec<Problem>,
}

impl Recording {
    /// Reads a recording with its captions.
    fn read(folder: &Path, name: &str) -> Recording {
        let mut recording = Recording::default();
        if let Err((kind, reason)) = recording.add(folder, name) {
            recording.problem(name, kind, reason);
        }
        recording
    }

    fn problem(&mut self, name: &str, kind: ProblemKind, reason: String) {
        self.problems.push(Problem {
            name: name.to_owned(),
            kind,
            reason,
        });
    }

    /// Adds the motions of a recording. Those that were added before an error remain.
    fn add(&mut self, folder: &Path, name: &str) -> Result<(), (ProblemKind, String)> {
        let path = folder.join(VECTORS).join(format!("{name}.npy"));
        let array = read_array(&path)?;
        let [frames, POSE_FEATURES] = array.shape[..] else {
            let found = array.shape;
            let reason = format!("expected the shape [frames, {POSE_FEATURES}], found {found:?}");
            return Err((ProblemKind::Shape, reason));
        };
        check_frames(frames)?;
        if let Some(place) = array.values.iter().position(|value| !value.is_finite()) {
            let (frame, feature) = (place / POSE_FEATURES, place % POSE_FEATURES);
            let reason = format!("frame {frame}, feature {feature}: expected a finite number");
            return Err((ProblemKind::NotFinite, reason));
        }
        let path = folder.join(TEXTS).join(format!("{name}.txt"));
        let text = std::fs::read_to_string(&path).map_err(|error| {
            let kind = match error.kind() {
                std::io::ErrorKind::NotFound => ProblemKind::NoCaption,
                _ => ProblemKind::Unreadable,
            };
            (kind, format!("{}: {error}", path.display()))
        })?;
        let mut whole = Vec::new();
        for (index, line) in text.trim_start_matches('\u{feff}').lines().enumerate() {
            let line = BenchmarkLine::parse(line).map_err(|reason| {
                let reason = format!("{}, line {}: {reason}", path.display(), index + 1);
                (ProblemKind::Line, reason)
            })?;
            let Some(seconds) = line.part else {
                whole.push(line.caption);
                continue;
            };
            let [start, end] = seconds.map(|seconds| slice_end(seconds, frames));
            let part = start..end.max(start);
            match check_frames(part.len()) {
                Ok(()) => {
                    let letter = char::from(b'A' + (self.clips.len() % 26) as u8);
                    let rows = part.start * POSE_FEATURES..part.end * POSE_FEATURES;
                    self.clips.push(BenchmarkClip {
                        name: format!("{letter}_{name}"),
                        captions: vec![line.caption],
                        features: array.values[rows].to_vec(),
                    });
                }
                Err((kind, reason)) => {
                    let reason = format!("the part {part:?} of {:?}: {reason}", line.caption.text);
                    self.problem(name, kind, reason);
                }
            }
        }
        if !whole.is_empty() {
            self.clips.push(BenchmarkClip {
                name: name.to_owned(),
                captions: whole,
                features: array.values,
            });
        } else if self.clips.is_empty() && self.problems.is_empty() {
            let reason = format!("{}: expected a caption, found none", path.display());
            return Err((ProblemKind::NoCaption, reason));
        }
        Ok(())
    }
}

/// Checks that a recording or a part has a length that the evaluation takes.
fn check_frames(frames: usize) -> Result<(), (ProblemKind, String)> {
    let [least, most] = [BenchmarkSplit::MIN_FRAMES, BenchmarkSplit::MAX_FRAMES];
    let kind = match frames {
        _ if frames < least => ProblemKind::TooShort,
        _ if frames > most => ProblemKind::TooLong,
        _ => return Ok(()),
    };
    Err((
        kind,
        format!("expected {least} to {most} frames, found {frames}"),
    ))
}

/// Returns the frame at a time, as the end of a slice in Python: negative frames count from the end, and frames past an end are that end.
fn slice_end(seconds: f64, frames: usize) -> usize {
    let frame = (seconds * f64::from(FRAMES_PER_SECOND)) as i64;
    let length = frames as i64;
    let frame = match frame {
        ..0 => frame.saturating_add(length),
        _ => frame,
    };
    frame.clamp(0, length) as usize
}

/// Parses lines of a caption file and counts those that can be read, for the fuzz targets.
pub(crate) fn count_lines(text: &str) -> usize {
    let lines = text.lines().map(BenchmarkLine::parse);
    let frames = lines.filter_map(|line| {
        Some(
            line.ok()?
                .part
                .map(|part| part.map(|end| slice_end(end, 100))),
        )
    });
    frames.count()
}

/// A line of a caption file, as the public evaluation reads it.
struct BenchmarkLine {
    caption: Caption,
    /// Start and end in seconds; `None` for the whole recording.
    part: Option<[f64; 2]>,
}

impl BenchmarkLine {
    fn parse(line: &str) -> Result<BenchmarkLine, String> {
        let fields: Vec<&str> = line.trim().split('#').collect();
        let [text, tokens, start, end, ..] = fields[..] else {
            return Err(format!("expected caption#tokens#start#end, found {line:?}"));
        };
        let seconds = |text: &str| match text.trim().parse::<f64>() {
            Ok(seconds) if seconds.is_nan() => Ok(0.0),
            Ok(seconds) if seconds.is_finite() => Ok(seconds),
            _ => Err(format!("expected seconds, or nan, found {text:?}")),
        };
        let part = [seconds(start)?, seconds(end)?];
        let tokens = tokens.trim();
        Ok(BenchmarkLine {
            caption: Caption {
                text: text.to_owned(),
                tokens: (!tokens.is_empty()).then(|| tokens.to_owned()),
            },
            part: (part != [0.0, 0.0]).then_some(part),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slices_end_as_in_python() {
        assert_eq!(
            [1.99, 2.0, 0.04].map(|seconds| slice_end(seconds, 100)),
            [39, 40, 0]
        );
        assert_eq!(
            [1e9, -1.0, -1e9].map(|seconds| slice_end(seconds, 100)),
            [100, 80, 0]
        );
    }

    #[test]
    fn lines_are_split_at_every_number_sign() {
        let line = BenchmarkLine::parse("he walks#he/PRON walk/VERB#nan#0.0#more").unwrap();
        assert_eq!((line.part, &*line.caption.text), (None, "he walks"));
        let part = BenchmarkLine::parse("he walks##0.0#2.5").unwrap();
        assert_eq!((part.part, part.caption.tokens), (Some([0.0, 2.5]), None));
        for line in [
            "",
            "he # walks#he/PRON walk/VERB#0.0#0.0",
            "he walks#he/PRON#0.0",
            "a#b#inf#1",
        ] {
            assert!(BenchmarkLine::parse(line).is_err(), "{line}");
        }
    }
}
