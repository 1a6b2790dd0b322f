//! Motions that differ from recorded ones in how they are moved.

use lamogen_motion::POSE_FEATURES;

use crate::dataset::Dataset;
use crate::entry::Entry;
use crate::problems::ProblemKind;
use crate::rows::to_half;

/// A variation of a motion.
#[derive(Clone, Debug, PartialEq)]
pub struct Variation {
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
    pub fn with_variations(mut self, variations: impl IntoIterator<Item = Variation>) -> Self {
        let mut counts = vec![0; self.entries.len()];
        for variation in variations {
            let original = &self.entries[variation.entry];
            assert!(
                !original.mirror && original.variation_of.is_none(),
                "`{}` is an original",
                original.name
            );
            assert_eq!(
                variation.rows.len(),
                original.frames,
                "rows of a variation of `{}`",
                original.name
            );
            counts[variation.entry] += 1;
            let count = counts[variation.entry];
            let rows = match to_half(variation.rows.as_flattened()) {
                Ok(rows) => rows,
                Err(place) => {
                    let name = format!("{}~{count}", original.name);
                    let row = place / POSE_FEATURES;
                    let reason = format!("row {row} of a variation is beyond 16 bits");
                    self.problems.add(name, ProblemKind::NotFinite, reason);
                    continue;
                }
            };
            let (clip, start) = (self.rows.clips(), self.rows.len());
            self.rows.push(&rows);
            let of = |entry: &Entry| Entry {
                name: format!("{}~{count}", entry.name),
                variation_of: Some(entry.name.clone()),
                note: Some(variation.note.clone()),
                captions: entry.captions[..1].to_vec(),
                clip,
                start,
                ..entry.clone()
            };
            let is_of_the_same =
                |entry: &&Entry| entry.variation_of.is_none() && entry.rows() == original.rows();
            let added: Vec<Entry> = { self.entries.iter() }
                .filter(is_of_the_same)
                .map(of)
                .collect();
            self.entries.extend(added);
        }
        self
    }
}
