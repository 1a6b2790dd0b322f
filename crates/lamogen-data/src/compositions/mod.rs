//! Compositions: motions that are put together from recorded ones, for what recordings show too rarely.

mod captions;
mod join;
mod part;
mod recipe;

use std::collections::HashSet;
use std::path::Path;

use lamogen_motion::{Motion, POSE_FEATURES, RestPose, Rotations, encode_every_frame};
use rand::{RngExt, SeedableRng, seq::IndexedRandom};
use rand_chacha::ChaCha12Rng;
use rayon::prelude::*;

use self::captions::{fill, phrases};
use self::join::join;
use self::recipe::{Composition, Part, Recipe};
use crate::dataset::Dataset;
use crate::entry::{Caption, Entry};
use crate::error::DataError;
use crate::kind::Kind;
use crate::options::LoadOptions;
use crate::split::Split;

/// The most captions of a composed motion.
const CAPTIONS: usize = 8;
/// How many choices of parts are tried for every motion that is wanted.
const TRIES: usize = 12;

/// Checks the text of a recipe. The error says what is wrong with it.
pub(crate) fn check(text: &str) -> Result<(), String> {
    Recipe::parse(text).map(drop)
}

/// What was drawn for a part.
#[derive(Clone, Copy)]
struct PartChoice {
    /// The index of the entry.
    entry: usize,
    /// The index of the entry from which the arms are taken.
    arms: Option<usize>,
    /// The speed, relative to the recording.
    speed: f32,
    /// The turn in all, in degrees.
    turn: Option<f32>,
}

/// A choice of recordings for the parts of a composition.
struct Choice {
    parts: Vec<PartChoice>,
    captions: Vec<String>,
}

impl Dataset {
    /// Adds motions that are put together from motions for training, as the recipe in a file says, and their mirror
    /// images. Returns the contents for which there are fewer motions than the recipe asks for, with the number found.
    ///
    /// A part may be cut, reversed in time, repeated, slowed or hastened, bent along its path or kept in its place. Parts
    /// are joined where their poses are most alike; parts that are nowhere alike are not joined. The file is described in
    /// the documentation on data (docs/data.md). The same seed gives the same motions.
    ///
    /// # Errors
    ///
    /// If the file cannot be read or is no recipe, or names a content that no motion for training has.
    pub fn add_compositions(
        &mut self,
        path: impl AsRef<Path>,
        seed: u64,
        limits: &LoadOptions,
    ) -> Result<Vec<(String, usize)>, DataError> {
        let path = path.as_ref();
        let text = std::fs::read_to_string(path).map_err(DataError::read(path))?;
        let invalid = |problem: String| DataError::Recipe {
            path: path.to_owned(),
            problem,
        };
        let recipe = Recipe::parse(&text).map_err(invalid)?;
        let originals: Vec<usize> = { self.indices(Split::Train) }
            .filter(|&index| {
                !self.entries[index].mirror && self.entries[index].variation_of.is_none()
            })
            .collect();
        let mut few = Vec::new();
        for (number, composition) in recipe.compositions.iter().enumerate() {
            let candidates = self
                .candidates(composition, &originals)
                .map_err(|problem| invalid(format!("{}: {problem}", composition.content)))?;
            let mut rng = ChaCha12Rng::seed_from_u64(seed.wrapping_add(number as u64));
            let mut choices = self.choices(composition, &candidates, &mut rng);
            let mut made = Vec::new();
            while made.len() < composition.count && !choices.is_empty() {
                let next = choices.split_off(choices.len().saturating_sub(composition.count));
                let composed = next.into_par_iter().filter_map(|choice| {
                    let rows = self.compose(composition, &choice, limits)?;
                    Some((choice, rows))
                });
                made.extend(composed.collect::<Vec<_>>());
            }
            made.truncate(composition.count);
            if made.len() < composition.count {
                few.push((composition.content.clone(), made.len()));
            }
            for (number, (choice, rows)) in made.into_iter().enumerate() {
                self.add_composed(composition, number, choice, &rows);
            }
        }
        Ok(few)
    }

    /// Returns for every part the entries that it, and its arms, may be.
    fn candidates(
        &self,
        composition: &Composition,
        originals: &[usize],
    ) -> Result<Vec<[Vec<usize>; 2]>, String> {
        let of_part = |(number, part): (usize, &Part)| {
            let arms = part.arms.as_ref();
            let arms = arms.map(|arms| self.entries_of(arms, originals));
            let found = self.entries_of(&part.of, originals);
            let both = found.and_then(|found| Ok([found, arms.transpose()?.unwrap_or_default()]));
            both.map_err(|problem| format!("part {number}: {problem}"))
        };
        composition.parts.iter().enumerate().map(of_part).collect()
    }

    /// Returns the entries of a kind.
    fn entries_of(&self, kind: &Kind, originals: &[usize]) -> Result<Vec<usize>, String> {
        let entries = || originals.iter().map(|&index| (index, &self.entries[index]));
        for content in &kind.content {
            if !entries().any(|(_, entry)| entry.content.as_ref() == Some(content)) {
                return Err(format!(
                    "no motion for training has the content {content:?}"
                ));
            }
        }
        let fitting = entries().filter(|(_, entry)| kind.fits(entry));
        let fitting: Vec<usize> = fitting.map(|(index, _)| index).collect();
        match fitting.is_empty() {
            true => {
                Err("no motion for training has captions with the words that are asked for".into())
            }
            false => Ok(fitting),
        }
    }

    /// Draws choices of parts and captions, no two alike.
    fn choices(
        &self,
        composition: &Composition,
        candidates: &[[Vec<usize>; 2]],
        rng: &mut ChaCha12Rng,
    ) -> Vec<Choice> {
        let mut seen = HashSet::new();
        let mut choices = Vec::new();
        for _ in 0..composition.count * TRIES {
            let parts: Vec<PartChoice> = { composition.parts.iter().zip(candidates) }
                .map(|(part, [entries, arms])| {
                    let entry = *entries.choose(rng).expect("a part has candidates");
                    let arms = arms.choose(rng).copied();
                    let mut draw = |[least, most]: [f32; 2]| match least < most {
                        true => rng.random_range(least..=most),
                        false => least,
                    };
                    PartChoice {
                        entry,
                        arms,
                        speed: draw(part.speed),
                        turn: part.turn.map(&mut draw),
                    }
                })
                .collect();
            let key = { parts.iter() }.map(|part| {
                let turn = part.turn.map(f32::to_bits);
                (part.entry, part.arms, part.speed.to_bits(), turn)
            });
            if !seen.insert(key.collect::<Vec<_>>()) {
                continue;
            }
            let said: Vec<Vec<String>> = { parts.iter().zip(&composition.parts) }
                .map(|(choice, part)| phrases(&self.entries[choice.entry], part.mirrored))
                .collect();
            let captions = fill(&composition.captions, &said, CAPTIONS, rng);
            if !captions.is_empty() {
                choices.push(Choice { parts, captions });
            }
        }
        choices
    }

    /// Puts a motion together. Returns none if its parts do not fit together, or it is too short or too long.
    fn compose(
        &self,
        composition: &Composition,
        choice: &Choice,
        limits: &LoadOptions,
    ) -> Option<Vec<[f32; POSE_FEATURES]>> {
        let mut whole: Option<Rotations> = None;
        for (part, choice) in composition.parts.iter().zip(&choice.parts) {
            let recorded = self.recorded(choice.entry, part.mirrored)?;
            let arms = match choice.arms {
                Some(arms) => Some(self.recorded(arms, part.mirrored)?),
                None => None,
            };
            let shaped = part.shape(&recorded, arms.as_ref(), choice.speed, choice.turn)?;
            for _ in 0..part.times {
                let longer = match whole {
                    None => shaped.clone(),
                    Some(before) => join(&before, &shaped)?,
                };
                if longer.frames() > limits.max_frames {
                    return None;
                }
                whole = Some(longer);
            }
        }
        let whole = whole.filter(|whole| whole.frames() >= limits.min_frames)?;
        Some(encode_every_frame(&whole.joints()))
    }

    /// Returns a recorded motion or its mirror image on HumanML3D's body.
    fn recorded(&self, entry: usize, mirrored: bool) -> Option<Rotations> {
        let entry = &self.entries[entry];
        let mut values = Vec::new();
        self.features(entry, 0..entry.frames, &mut values);
        let mut rows = values.as_chunks::<POSE_FEATURES>().0.to_vec();
        if mirrored {
            for row in &mut rows {
                *row = self.mirror.apply(row);
            }
        }
        let motion = Motion::from_pose_features(rows).ok()?;
        Some(Rotations::on_body(&motion, &RestPose::humanml3d()))
    }

    /// Adds a composed motion and its mirror image.
    fn add_composed(
        &mut self,
        composition: &Composition,
        number: usize,
        choice: Choice,
        rows: &[[f32; POSE_FEATURES]],
    ) {
        let name = format!("{}+{}", composition.content, number + 1);
        let Some((clip, start)) = self.add_rows(&name, rows) else {
            return;
        };
        let parts: Vec<&str> = { choice.parts.iter() }
            .map(|part| self.entries[part.entry].name.as_str())
            .collect();
        let note = format!("composed of {}", parts.join(", "));
        let captions = choice.captions.into_iter();
        let composed = Entry {
            name,
            split: Split::Train,
            frames: rows.len(),
            mirror: false,
            content: Some(composition.content.clone()),
            style: None,
            source: Some("composed".into()),
            trial: None,
            variation_of: None,
            note: Some(note),
            captions: captions
                .map(|text| Caption { text, tokens: None })
                .collect(),
            clip,
            start,
        };
        let image = crate::pack::mirror_image(&composed);
        self.entries.extend([composed, image]);
    }
}
