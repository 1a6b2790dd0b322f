//! Motions that differ from recorded ones in how they are moved.

use lamogen_motion::POSE_FEATURES;

use crate::dataset::Dataset;
use crate::derived::Siblings;
use crate::entry::Entry;

/// A variation of a motion.
#[derive(Clone, Debug, PartialEq)]
pub struct MotionVariation {
    /// Which entry it is a variation of.
    pub entry: usize,
    /// Its pose features, as many rows as that entry has.
    pub rows: Vec<[f32; POSE_FEATURES]>,
    /// What was changed.
    pub note: String,
}

impl Dataset {
    /// Adds variations of motions. Each becomes an entry of its own, named after its original with a number behind; the mirror image of the
    /// original gets the mirror image of the variation. Statistics are those of the originals alone. Variations with numbers beyond 16 bits
    /// are left out and listed in [`problems`](Self::problems).
    ///
    /// # Panics
    ///
    /// If there is no such entry, it is a mirror image or a variation itself, or has another number of rows.
    pub fn with_variations(
        mut self,
        variations: impl IntoIterator<Item = MotionVariation>,
    ) -> Self {
        let siblings = Siblings::of(&self.entries);
        let mut counts = vec![0; self.entries.len()];
        for MotionVariation { entry, rows, note } in variations {
            let original = &self.entries[entry];
            assert!(
                !original.mirror && original.variation_of.is_none(),
                "`{}` is an original",
                original.name
            );
            assert_eq!(
                rows.len(),
                original.frames,
                "rows of a variation of `{}`",
                original.name
            );
            counts[entry] += 1;
            let ending = format!("~{}", counts[entry]);
            self.add_derived((entry, &siblings), &rows, &ending, |entry| Entry {
                variation_of: Some(entry.name.clone()),
                note: Some(note.clone()),
                captions: entry.captions[..1].to_vec(),
                ..entry.clone()
            });
        }
        self
    }
}
