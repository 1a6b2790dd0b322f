//! The same movement faster or slower.

use lamogen_motion::{FRAMES_PER_SECOND, FeatureGroup, POSE_FEATURES, encode_every_frame};
use rayon::prelude::*;

use crate::dataset::Dataset;
use crate::derived::Siblings;
use crate::entry::Entry;
use crate::options::LoadOptions;
use crate::split::Split;

/// Beginnings of words that say how fast something is done.
const HASTE: [&str; 22] = [
    "slow", "fast", "quick", "rapid", "swift", "brisk", "speed", "pace", "hurr", "hast", "rush",
    "leisure", "gradual", "sudden", "abrupt", "gentl", "careful", "lazi", "lazy", "dash", "sprint",
    "unhurr",
];

impl Dataset {
    /// Adds motions for training at other speeds: 0.8 takes a quarter longer. Each becomes an entry of its own with the captions of its
    /// original, named after it with the speed behind, as does its mirror image.
    ///
    /// Left alone are motions whose captions say how fast they are, and those that leave the ground, because gravity sets their speed; and what
    /// would become shorter or longer than `limits` allow.
    ///
    /// # Panics
    ///
    /// If a speed is not from 0.1 to 10.
    pub fn with_speeds(mut self, speeds: &[f32], limits: &LoadOptions) -> Self {
        assert!(
            speeds.iter().all(|speed| (0.1..=10.0).contains(speed)),
            "expected speeds from 0.1 to 10, found {speeds:?}"
        );
        let originals: Vec<usize> = { self.indices(Split::Train) }
            .filter(|&place| {
                let entry = &self.entries[place];
                let is_original = !entry.mirror && entry.variation_of.is_none();
                is_original && !says_how_fast(entry) && !self.leaves_the_ground(entry)
            })
            .collect();
        let work: Vec<(usize, f32)> = { originals.iter() }
            .flat_map(|&place| speeds.iter().map(move |&speed| (place, speed)))
            .collect();
        let made: Vec<Vec<[f32; POSE_FEATURES]>> = { work.par_iter() }
            .map(|&(place, speed)| self.at_speed(&self.entries[place], speed))
            .collect();
        let siblings = Siblings::of(&self.entries);
        for ((place, speed), rows) in work.into_iter().zip(made) {
            if !(limits.min_frames..=limits.max_frames).contains(&rows.len()) {
                continue;
            }
            let ending = format!("@{speed}");
            self.add_derived((place, &siblings), &rows, &ending, |entry| Entry {
                note: Some(format!("{speed} times as fast")),
                ..entry.clone()
            });
        }
        self
    }

    /// Whether both feet are off the ground at once, for two frames or more.
    fn leaves_the_ground(&self, entry: &Entry) -> bool {
        const FRAMES: usize = 2;
        let mut rows = Vec::new();
        self.features(entry, 0..entry.frames, &mut rows);
        let mut flying = 0;
        rows.as_chunks::<POSE_FEATURES>().0.iter().any(|row| {
            let contacts = &row[FeatureGroup::FootContact.range()];
            flying = match contacts.iter().all(|contact| *contact < 0.5) {
                true => flying + 1,
                false => 0,
            };
            flying >= FRAMES
        })
    }

    /// The rows of a motion at another speed; none where it is no motion.
    fn at_speed(&self, entry: &Entry, speed: f32) -> Vec<[f32; POSE_FEATURES]> {
        self.motion(entry).map_or_else(
            |_| Vec::new(),
            |motion| {
                let rotations = motion.rotations().resampled(FRAMES_PER_SECOND / speed);
                encode_every_frame(&rotations.joints())
            },
        )
    }
}

/// Whether a caption says how fast a motion is.
fn says_how_fast(entry: &Entry) -> bool {
    entry.captions.iter().any(|caption| {
        let text = caption.text.to_lowercase();
        let mut words = text.split(|c: char| !c.is_alphabetic());
        words.any(|word| HASTE.iter().any(|start| word.starts_with(start)))
    })
}
