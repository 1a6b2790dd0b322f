//! The recipe of compositions: which motions are put together, and what is said of the result.

use std::collections::HashSet;

use serde::Deserialize;

use crate::kind::Kind;

/// The most motions of a composition.
const MOST: usize = 100_000;

/// The contents of a recipe file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Recipe {
    pub compositions: Vec<Composition>,
}

/// A kind of motion that is put together from parts.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Composition {
    /// The content of the composed motions, unique in the recipe.
    pub content: String,
    /// The greatest number of motions to compose, without mirror images.
    pub count: usize,
    /// The parts, in their order in time.
    pub parts: Vec<Part>,
    /// The captions. `{0}` stands for what a caption of the first part says, without its subject, `{1}` for the second,
    /// and so on.
    pub captions: Vec<String>,
}

/// A part of a composed motion: a recorded motion, and what is changed about it.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Part {
    /// Which motions it may be.
    pub of: Kind,
    /// Which motions the arms are taken from, if not from the same.
    pub arms: Option<Kind>,
    /// Whether the mirror image is used.
    #[serde(default)]
    pub mirrored: bool,
    /// The share of the motion's time at which the part begins and ends.
    #[serde(default = "whole")]
    pub span: [f32; 2],
    /// Whether time runs backward.
    #[serde(default)]
    pub reversed: bool,
    /// How often the motion is shown.
    #[serde(default = "one")]
    pub times: usize,
    /// The least and the greatest speed, relative to the recording.
    #[serde(default = "unchanged")]
    pub speed: [f32; 2],
    /// The least and the greatest angle by which the part turns in all, in degrees, positive to the left; without, it
    /// turns as it was recorded. The path is bent evenly along its length.
    pub turn: Option<[f32; 2]>,
    /// Whether the part stays in its place.
    #[serde(default)]
    pub in_place: bool,
}

fn whole() -> [f32; 2] {
    [0.0, 1.0]
}

fn one() -> usize {
    1
}

fn unchanged() -> [f32; 2] {
    [1.0, 1.0]
}

impl Recipe {
    /// Parses a recipe and checks its values. The error says what is wrong and where.
    pub fn parse(text: &str) -> Result<Recipe, String> {
        let recipe: Recipe = serde_json::from_str(text.trim_start_matches('\u{feff}'))
            .map_err(|error| error.to_string())?;
        if recipe.compositions.is_empty() {
            return Err("expected compositions, found none".into());
        }
        let mut contents = HashSet::new();
        for composition in &recipe.compositions {
            let Composition { content, .. } = composition;
            if content.is_empty() || !contents.insert(content) {
                return Err(format!(
                    "expected contents that differ, found {content:?} twice or empty"
                ));
            }
            composition
                .check()
                .map_err(|problem| format!("{content}: {problem}"))?;
        }
        Ok(recipe)
    }
}

impl Composition {
    fn check(&self) -> Result<(), String> {
        if self.parts.is_empty() {
            return Err("expected parts, found none".into());
        }
        if !(1..=MOST).contains(&self.count) {
            return Err(format!("count: expected 1 to {MOST}, found {}", self.count));
        }
        if self.captions.is_empty() {
            return Err("expected captions, found none".into());
        }
        for caption in &self.captions {
            let mut rest = caption.as_str();
            while let Some((_, after)) = rest.split_once('{') {
                let (number, after) = after.split_once('}').unwrap_or((after, ""));
                let is_part = { number.parse::<usize>() }.is_ok_and(|part| part < self.parts.len());
                if !is_part {
                    let parts = self.parts.len();
                    return Err(format!(
                        "captions: expected the number of one of {parts} parts, counted from 0, in braces, found {caption:?}"
                    ));
                }
                rest = after;
            }
            if caption.trim().is_empty() {
                return Err("captions: found an empty one".into());
            }
        }
        for (number, part) in self.parts.iter().enumerate() {
            part.check()
                .map_err(|problem| format!("part {number}: {problem}"))?;
        }
        Ok(())
    }
}

impl Part {
    fn check(&self) -> Result<(), String> {
        let Part {
            span, speed, times, ..
        } = self;
        let sources = [Some(&self.of), self.arms.as_ref()];
        if sources
            .into_iter()
            .flatten()
            .any(|source| source.content.is_empty())
        {
            return Err("content: expected contents, found none".into());
        }
        if !(0.0 <= span[0] && span[0] < span[1] && span[1] <= 1.0) {
            return Err(format!(
                "span: expected two numbers from 0 to 1, the smaller one first, found {span:?}"
            ));
        }
        if !(0.1 <= speed[0] && speed[0] <= speed[1] && speed[1] <= 10.0) {
            return Err(format!(
                "speed: expected two numbers from 0.1 to 10, the smaller one first, found {speed:?}"
            ));
        }
        if !(1..=20).contains(times) {
            return Err(format!("times: expected 1 to 20, found {times}"));
        }
        match self.turn {
            Some([least, most]) if !(least <= most && least.abs().max(most.abs()) <= 3600.0) => {
                Err(format!(
                    "turn: expected two angles in degrees, the smaller one first, found [{least}, {most}]"
                ))
            }
            _ => Ok(()),
        }
    }
}
