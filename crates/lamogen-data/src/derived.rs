//! Motions that are computed from others of a data set.

use std::collections::HashMap;
use std::ops::Range;

use lamogen_motion::POSE_FEATURES;

use crate::dataset::Dataset;
use crate::entry::Entry;
use crate::problems::ProblemKind;
use crate::rows::to_half;

/// Which entries lie on the same rows: a motion and its mirror image.
pub(crate) struct Siblings(HashMap<Range<usize>, Vec<usize>>);

impl Siblings {
    pub(crate) fn of(entries: &[Entry]) -> Siblings {
        let mut siblings: HashMap<_, Vec<usize>> = HashMap::new();
        for (place, entry) in entries.iter().enumerate() {
            if entry.variation_of.is_none() {
                siblings.entry(entry.rows()).or_default().push(place);
            }
        }
        Siblings(siblings)
    }
}

impl Dataset {
    /// Adds a motion that was computed from an entry, as an entry of its own for that one and for each that lies on the same rows. They are
    /// named with `ending` behind, and are otherwise what `change` makes of their originals. A motion with numbers beyond 16 bits is left
    /// out and listed.
    pub(crate) fn add_derived(
        &mut self,
        (original, siblings): (usize, &Siblings),
        rows: &[[f32; POSE_FEATURES]],
        ending: &str,
        change: impl Fn(&Entry) -> Entry,
    ) {
        let halves = match to_half(rows.as_flattened()) {
            Ok(halves) => halves,
            Err(place) => {
                let name = format!("{}{ending}", self.entries[original].name);
                let reason = format!("row {} is beyond 16 bits", place / POSE_FEATURES);
                self.problems.add(name, ProblemKind::NotFinite, reason);
                return;
            }
        };
        let (clip, start) = (self.rows.clips(), self.rows.len());
        self.rows.push(&halves);
        for &place in &siblings.0[&self.entries[original].rows()] {
            let entry = &self.entries[place];
            let derived = Entry {
                name: format!("{}{ending}", entry.name),
                frames: rows.len(),
                clip,
                start,
                ..change(entry)
            };
            self.entries.push(derived);
        }
    }
}
