//! Copies of motions that are faster or slower.

use std::collections::HashSet;

use lamogen_motion::{FRAMES_PER_SECOND, FeatureGroup, POSE_FEATURES, encode_every_frame};
use rayon::prelude::*;

use crate::dataset::Dataset;
use crate::derived::EntriesByRows;
use crate::entry::Entry;
use crate::options::LoadOptions;
use crate::split::Split;

/// The first letters of words that say how fast an action is.
const SPEED_WORD_STEMS: [&str; 22] = [
    "slow", "fast", "quick", "rapid", "swift", "brisk", "speed", "pace", "hurr", "hast", "rush",
    "leisure", "gradual", "sudden", "abrupt", "gentl", "careful", "lazi", "lazy", "dash", "sprint",
    "unhurr",
];

impl Dataset {
    /// Adds copies of the training motions at other speeds. At speed 0.8, for example, a motion takes a quarter longer.
    ///
    /// Every copy is an entry of its own with the captions of its original, and so is the copy's mirror image. Its name
    /// is that of the original with the speed appended, such as `000001@0.8`.
    ///
    /// There are no copies of motions that have a caption about their speed, nor of motions that leave the ground,
    /// because gravity sets their speed. Copies that would be shorter or longer than `limits` allow are not added.
    ///
    /// # Panics
    ///
    /// If a speed is not from 0.1 to 10.
    pub fn with_speeds(mut self, speeds: &[f32], limits: &LoadOptions) -> Self {
        assert!(
            speeds.iter().all(|speed| (0.1..=10.0).contains(speed)),
            "expected speeds from 0.1 to 10, found {speeds:?}"
        );
        // A part that is a whole clip has the rows of that clip, which are copied once for both.
        let mut copied = HashSet::new();
        let originals: Vec<usize> = { self.indices(Split::Train) }
            .filter(|&index| {
                let entry = &self.entries[index];
                let is_original = !entry.mirror && entry.variation_of.is_none();
                is_original
                    && !mentions_speed(entry)
                    && !self.leaves_the_ground(entry)
                    && copied.insert(entry.rows())
            })
            .collect();
        let pairs: Vec<(usize, f32)> = { originals.iter() }
            .flat_map(|&index| speeds.iter().map(move |&speed| (index, speed)))
            .collect();
        let copies: Vec<Vec<[f32; POSE_FEATURES]>> = { pairs.par_iter() }
            .map(|&(index, speed)| self.rows_at_speed(&self.entries[index], speed))
            .collect();
        let by_rows = EntriesByRows::of(&self.entries);
        for ((index, speed), rows) in pairs.into_iter().zip(copies) {
            if !(limits.min_frames..=limits.max_frames).contains(&rows.len()) {
                continue;
            }
            let suffix = format!("@{speed}");
            self.add_derived((index, &by_rows), &rows, &suffix, |entry| {
                (!mentions_speed(entry)).then(|| Entry {
                    note: Some(format!("{speed} times as fast")),
                    ..entry.clone()
                })
            });
        }
        self
    }

    /// Returns whether both feet are off the ground at once for two frames or more.
    fn leaves_the_ground(&self, entry: &Entry) -> bool {
        const FRAMES: usize = 2;
        let mut rows = Vec::new();
        self.features(entry, 0..entry.frames, &mut rows);
        let mut airborne = 0;
        rows.as_chunks::<POSE_FEATURES>().0.iter().any(|row| {
            let contacts = &row[FeatureGroup::FootContact.range()];
            airborne = match contacts.iter().all(|contact| *contact < 0.5) {
                true => airborne + 1,
                false => 0,
            };
            airborne >= FRAMES
        })
    }

    /// Returns the rows of a motion at another speed; no rows if the entry cannot be converted to a motion.
    fn rows_at_speed(&self, entry: &Entry, speed: f32) -> Vec<[f32; POSE_FEATURES]> {
        self.motion(entry).map_or_else(
            |_| Vec::new(),
            |motion| {
                let rotations = motion.rotations().resampled(FRAMES_PER_SECOND / speed);
                encode_every_frame(&rotations.joints())
            },
        )
    }
}

/// Returns whether a caption of an entry says how fast the motion is.
fn mentions_speed(entry: &Entry) -> bool {
    entry.captions.iter().any(|caption| {
        let text = caption.text.to_lowercase();
        let mut words = text.split(|c: char| !c.is_alphabetic());
        words.any(|word| SPEED_WORD_STEMS.iter().any(|stem| word.starts_with(stem)))
    })
}
