//! Motions that are computed from other motions of a data set.

use std::collections::HashMap;
use std::ops::Range;

use lamogen_motion::POSE_FEATURES;

use crate::dataset::Dataset;
use crate::entry::Entry;
use crate::problems::ProblemKind;
use crate::rows::to_half;

/// The indices of the entries that use the same rows, by these rows: a motion and its mirror image share them.
///
/// Variations are not among them.
pub(crate) struct EntriesByRows(HashMap<Range<usize>, Vec<usize>>);

impl EntriesByRows {
    pub(crate) fn of(entries: &[Entry]) -> EntriesByRows {
        let mut by_rows: HashMap<_, Vec<usize>> = HashMap::new();
        for (index, entry) in entries.iter().enumerate() {
            if entry.variation_of.is_none() {
                by_rows.entry(entry.rows()).or_default().push(index);
            }
        }
        EntriesByRows(by_rows)
    }
}

impl Dataset {
    /// Adds the rows of a computed motion. Returns the index of their clip and of the first row. Rows with a number that 16 bits
    /// cannot hold are not added; the motion is listed as a problem by its name.
    pub(crate) fn add_rows(
        &mut self,
        name: &str,
        rows: &[[f32; POSE_FEATURES]],
    ) -> Option<(usize, usize)> {
        match to_half(rows.as_flattened()) {
            Ok(halves) => {
                let place = (self.rows.clips(), self.rows.len());
                self.rows.push(&halves);
                Some(place)
            }
            Err(place) => {
                let reason = format!("row {} is beyond 16 bits", place / POSE_FEATURES);
                self.problems
                    .add(name.to_owned(), ProblemKind::NotFinite, reason);
                None
            }
        }
    }

    /// Adds a motion that was computed from the entry with the index `original`.
    ///
    /// It adds one entry for the original and one for every other entry with the same rows. The new entry's name is the
    /// old one with `suffix`; its other fields are those that `change` returns, and entries for which it returns none are left out. A motion with a number that 16 bits
    /// cannot hold is left out and listed as a problem.
    pub(crate) fn add_derived(
        &mut self,
        (original, by_rows): (usize, &EntriesByRows),
        rows: &[[f32; POSE_FEATURES]],
        suffix: &str,
        change: impl Fn(&Entry) -> Option<Entry>,
    ) {
        let name = format!("{}{suffix}", self.entries[original].name);
        let Some((clip, start)) = self.add_rows(&name, rows) else {
            return;
        };
        for &index in &by_rows.0[&self.entries[original].rows()] {
            let entry = &self.entries[index];
            let Some(changed) = change(entry) else {
                continue;
            };
            let derived = Entry {
                name: format!("{}{suffix}", entry.name),
                frames: rows.len(),
                clip,
                start,
                ..changed
            };
            self.entries.push(derived);
        }
    }
}
