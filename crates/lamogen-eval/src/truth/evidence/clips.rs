//! Real motions, and choices of them by their labels and captions.

use crate::truth::measurements::Measurements;
use crate::truth::side::Side;

/// A real motion with its labels, captions and measurements.
#[derive(Clone, Debug)]
pub struct Clip {
    /// The name.
    pub name: String,
    /// The action in a word such as `walk-turn-left`.
    pub content: String,
    /// The length, s.
    pub seconds: f32,
    /// Whether the action is done in a style, such as that of a chicken.
    pub styled: bool,
    /// The captions.
    pub captions: Vec<String>,
    /// The measurements.
    pub measured: Measurements,
}

/// A choice of real motions by content, captions and style.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Clips {
    /// The contents; one that ends with `*` stands for all contents that begin so.
    contents: Vec<String>,
    /// The words of which at least one is in a caption; empty if any caption will do.
    words: Vec<String>,
    /// The words that are in no caption.
    excluded_words: Vec<String>,
    /// Whether motions in a style are left out.
    excludes_styled: bool,
}

/// Returns the choice of motions with these contents. A content such as `kick-*` stands for all that begin so.
pub(super) fn clips<const N: usize>(contents: [&str; N]) -> Clips {
    Clips {
        contents: contents.map(str::to_owned).into(),
        ..Clips::default()
    }
}

impl Clips {
    /// Restricts the choice to motions with one of these words in a caption.
    pub(super) fn with_words<const N: usize>(self, words: [&str; N]) -> Clips {
        let words = words.map(str::to_owned).into();
        Clips { words, ..self }
    }

    /// Restricts the choice to motions with none of these words in any caption.
    pub(super) fn without_words<const N: usize>(self, words: [&str; N]) -> Clips {
        let excluded_words = words.map(str::to_owned).into();
        Clips {
            excluded_words,
            ..self
        }
    }

    /// Restricts the choice to motions without a style.
    pub(super) fn without_style(self) -> Clips {
        Clips {
            excludes_styled: true,
            ..self
        }
    }

    /// Returns whether the choice includes a motion.
    pub fn include(&self, clip: &Clip) -> bool {
        let matches = |content: &String| match content.strip_suffix('*') {
            Some(start) => clip.content.starts_with(start),
            None => clip.content == *content,
        };
        let is_said = |words: &String| clip.captions.iter().any(|caption| caption.contains(words));
        self.contents.iter().any(matches)
            && !(self.excludes_styled && clip.styled)
            && (self.words.is_empty() || self.words.iter().any(is_said))
            && !self.excluded_words.iter().any(is_said)
    }
}

/// Returns the choice of motions in place, on both feet or one, with an upright trunk.
pub(super) fn clips_in_place() -> Clips {
    clips([
        "stand",
        "look-around",
        "arm-raise-*",
        "arm-extend-back-*",
        "referee-signal",
        "drink",
        "squat",
        "sit-to-stand",
        "leg-raise-*",
        "knee-raise-*",
    ])
}

/// Returns the choice of motions with a content that ends with the side.
pub(super) fn clips_of_side(content: &str, side: Side) -> Clips {
    clips([&format!("{content}-{}", side.name())])
}

/// Returns the name of a side and that of the other side.
pub(super) fn side_names(side: Side) -> [&'static str; 2] {
    [side.name(), side.other().name()]
}
