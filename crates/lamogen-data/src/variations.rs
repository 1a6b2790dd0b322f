//! Variations: computed motions that do the same as a recorded motion in another manner.

use std::collections::HashMap;
use std::ops::Range;

use lamogen_motion::POSE_FEATURES;

use crate::dataset::Dataset;
use crate::derived::EntriesByRows;
use crate::entry::Entry;

/// A variation of a motion.
#[derive(Clone, Debug, PartialEq)]
pub struct MotionVariation {
    /// The index of the entry that it is a variation of.
    pub entry: usize,
    /// The pose features, as many rows as the entry has.
    pub rows: Vec<[f32; POSE_FEATURES]>,
    /// A note on what was changed.
    pub note: String,
}

impl Dataset {
    /// Adds variations of motions.
    ///
    /// Every variation becomes an entry of its own; its name is that of the original with a number appended, such as
    /// `000001~1`. If the original has a mirror image, the mirror image of the variation is added, too. The statistics
    /// remain those of the originals. Variations with numbers that 16 bits cannot hold are left out and listed in
    /// [`problems`](Self::problems).
    ///
    /// # Panics
    ///
    /// If an entry does not exist, is itself a mirror image or a variation, or has another number of rows than its
    /// variation.
    pub fn with_variations(
        mut self,
        variations: impl IntoIterator<Item = MotionVariation>,
    ) -> Self {
        let by_rows = EntriesByRows::of(&self.entries);
        // Entries with the same rows get the variations of each other.
        let mut counts: HashMap<Range<usize>, usize> = HashMap::new();
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
            let count = counts.entry(original.rows()).or_default();
            *count += 1;
            let suffix = format!("~{count}");
            self.add_derived((entry, &by_rows), &rows, &suffix, |entry| {
                Some(Entry {
                    variation_of: Some(entry.name.clone()),
                    note: Some(note.clone()),
                    captions: entry.captions[..1].to_vec(),
                    ..entry.clone()
                })
            });
        }
        self
    }
}
