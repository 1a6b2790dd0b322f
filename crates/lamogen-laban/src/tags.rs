//! The components and tags of Laban movement analysis, and the factors that the tags stand for.

use std::fmt;
use std::str::FromStr;

/// The number of Laban components.
pub const COMPONENTS: usize = 4;

/// A Laban component: one of the four quantities that are measured and guided.
///
/// `component as usize` is its index on the last axis of feature tensors.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Component {
    /// The kinetic energy of the end-effectors.
    Weight,
    /// The acceleration of the end-effectors.
    Time,
    /// The jerk of the end-effectors.
    Flow,
    /// The volume of the body's bounding box.
    Shape,
}

impl Component {
    /// All components, in the order of their indices.
    pub const ALL: [Component; COMPONENTS] = [
        Component::Weight,
        Component::Time,
        Component::Flow,
        Component::Shape,
    ];

    /// The components that are measured on end-effectors: all but Shape. They are the first of [`ALL`](Self::ALL).
    pub const EFFORTS: [Component; 3] = [Component::Weight, Component::Time, Component::Flow];

    /// Returns the first frame that has a value. The frames before it have no difference and hold 0.
    pub(crate) const fn first_frame(self) -> usize {
        match self {
            Component::Weight => 1,
            Component::Time => 2,
            Component::Flow => 3,
            Component::Shape => 0,
        }
    }

    /// Returns the component's index on the last axis of feature tensors.
    pub const fn index(self) -> usize {
        self as usize
    }

    /// Returns the component's unit as text; a frame is 1/20 s.
    pub const fn unit(self) -> &'static str {
        match self {
            Component::Weight => "m² per frame²",
            Component::Time => "m per frame²",
            Component::Flow => "m per frame³",
            Component::Shape => "m³",
        }
    }
}

impl fmt::Display for Component {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Component::Weight => "Weight",
            Component::Time => "Time",
            Component::Flow => "Flow",
            Component::Shape => "Shape",
        })
    }
}

/// A Laban tag: a word that asks for less or more of one component.
///
/// ```
/// use lamogen_laban::{Component, Tag};
///
/// let tag: Tag = "sudden".parse().unwrap();
/// assert_eq!(tag.component(), Component::Time);
/// assert_eq!(tag.scale(), 1.2);
/// assert!("wobbly".parse::<Tag>().is_err());
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Tag {
    /// Less Weight.
    Light,
    /// More Weight.
    Strong,
    /// Less Time.
    Sustained,
    /// More Time.
    Sudden,
    /// Less Flow.
    Bound,
    /// More Flow.
    Free,
    /// Less Shape.
    Near,
    /// More Shape.
    Far,
}

/// The error of a word that is no tag.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("unknown Laban tag {found:?}; known tags are {known}", known = all_tags())]
pub struct TagError {
    /// The word.
    pub found: String,
}

/// Returns all tags as a list for messages.
fn all_tags() -> String {
    let words: Vec<_> = Tag::ALL.iter().map(Tag::to_string).collect();
    words.join(", ")
}

impl Tag {
    /// All tags, the tag for less of each component before the tag for more.
    pub const ALL: [Tag; 2 * COMPONENTS] = [
        Tag::Light,
        Tag::Strong,
        Tag::Sustained,
        Tag::Sudden,
        Tag::Bound,
        Tag::Free,
        Tag::Near,
        Tag::Far,
    ];

    /// Returns the component that the tag belongs to.
    pub const fn component(self) -> Component {
        match self {
            Tag::Light | Tag::Strong => Component::Weight,
            Tag::Sustained | Tag::Sudden => Component::Time,
            Tag::Bound | Tag::Free => Component::Flow,
            Tag::Near | Tag::Far => Component::Shape,
        }
    }

    /// Returns the factor on the component's baseline (paper, appendix, table "Laban Tag to Scale
    /// Mappings").
    pub const fn scale(self) -> f32 {
        match self {
            Tag::Light | Tag::Near => 0.5,
            Tag::Strong | Tag::Far => 1.5,
            Tag::Sustained | Tag::Bound => 0.8,
            Tag::Sudden | Tag::Free => 1.2,
        }
    }

    /// Returns the phrase that prompt editing appends to a prompt in the place of guidance (paper, appendix, table
    /// "Descriptive phrases used for the Prompt Editing baseline").
    pub const fn phrase(self) -> &'static str {
        match self {
            Tag::Light => "with small energy",
            Tag::Strong => "with large energy",
            Tag::Sustained => "in a sustained time",
            Tag::Sudden => "in a quick time",
            Tag::Bound => "bounded",
            Tag::Free => "freely",
            Tag::Near => "with small volume",
            Tag::Far => "with large volume",
        }
    }
}

impl fmt::Display for Tag {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Tag::Light => "light",
            Tag::Strong => "strong",
            Tag::Sustained => "sustained",
            Tag::Sudden => "sudden",
            Tag::Bound => "bound",
            Tag::Free => "free",
            Tag::Near => "near",
            Tag::Far => "far",
        })
    }
}

impl FromStr for Tag {
    type Err = TagError;

    fn from_str(word: &str) -> Result<Self, Self::Err> {
        let wanted = word.trim().to_lowercase();
        Tag::ALL
            .into_iter()
            .find(|tag| tag.to_string() == wanted)
            .ok_or(TagError { found: word.into() })
    }
}

/// Factors on the baseline of `[Weight, Time, Flow, Shape]` that are constant over time. A factor of 1 asks for no
/// change. In a [`ScaleCurve`](crate::ScaleCurve) factors may change over time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale([f32; COMPONENTS]);

/// The reason why a scale is invalid.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum ScaleError {
    /// A factor is negative, infinite or not a number.
    #[error("the scale of {component} must be a finite number of at least 0, found {found}")]
    #[allow(missing_docs)]
    Value { component: Component, found: f32 },
    /// Two tags belong to the same component.
    #[error("the tags {first} and {second} both speak of {component}; give one of them")]
    #[allow(missing_docs)]
    Conflict {
        component: Component,
        first: Tag,
        second: Tag,
    },
    /// A key is past the motion's end.
    #[error("{component}: the key at {seconds} s can never act, the motion ends at {length} s")]
    #[allow(missing_docs)]
    Late {
        component: Component,
        seconds: f32,
        length: f32,
    },
}

impl Scale {
    /// The scale of factors 1, which asks for no change.
    pub const NEUTRAL: Scale = Scale([1.0; COMPONENTS]);

    /// Creates a scale from the factors on Weight, Time, Flow and Shape.
    ///
    /// # Errors
    ///
    /// If a factor is negative or not finite.
    pub fn new(factors: [f32; COMPONENTS]) -> Result<Scale, ScaleError> {
        for component in Component::ALL {
            let found = factors[component.index()];
            if !found.is_finite() || found < 0.0 {
                return Err(ScaleError::Value { component, found });
            }
        }
        Ok(Scale(factors))
    }

    /// Creates a scale from factors that are known to be finite and not negative.
    pub(crate) const fn unchecked(factors: [f32; COMPONENTS]) -> Scale {
        Scale(factors)
    }

    /// Creates the scale of some tags. Components without a tag have the factor 1.
    ///
    /// # Errors
    ///
    /// If two tags belong to the same component, even if they are the same tag.
    pub fn from_tags(tags: &[Tag]) -> Result<Scale, ScaleError> {
        let mut chosen: [Option<Tag>; COMPONENTS] = [None; COMPONENTS];
        let mut scale = Scale::NEUTRAL;
        for &tag in tags {
            let component = tag.component();
            if let Some(first) = chosen[component.index()].replace(tag) {
                return Err(ScaleError::Conflict {
                    component,
                    first,
                    second: tag,
                });
            }
            scale.0[component.index()] = tag.scale();
        }
        Ok(scale)
    }

    /// Returns the factors in the order of [`Component::ALL`].
    pub const fn factors(&self) -> [f32; COMPONENTS] {
        self.0
    }

    /// Returns the factor on a component.
    pub const fn of(&self, component: Component) -> f32 {
        self.0[component.index()]
    }

    /// Returns whether the factor on a component differs from 1.
    pub fn changes(&self, component: Component) -> bool {
        self.of(component) != 1.0
    }
}

impl Default for Scale {
    fn default() -> Self {
        Scale::NEUTRAL
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_tag_parses_from_its_word_in_any_case() {
        for tag in Tag::ALL {
            assert_eq!(tag.to_string().parse(), Ok(tag));
            assert_eq!(
                format!(" {} ", tag.to_string().to_uppercase()).parse(),
                Ok(tag)
            );
        }
    }

    #[test]
    fn an_unknown_tag_lists_the_known_ones() {
        let message = "heavy".parse::<Tag>().unwrap_err().to_string();
        assert!(message.contains("\"heavy\""), "{message}");
        for tag in Tag::ALL {
            assert!(message.contains(&tag.to_string()), "{message}");
        }
    }

    #[test]
    fn tags_have_the_values_of_the_paper() {
        let large = [Tag::Strong, Tag::Sudden, Tag::Free, Tag::Far];
        let small = [Tag::Light, Tag::Sustained, Tag::Bound, Tag::Near];
        assert_eq!(
            Scale::from_tags(&large).unwrap().factors(),
            [1.5, 1.2, 1.2, 1.5]
        );
        assert_eq!(
            Scale::from_tags(&small).unwrap().factors(),
            [0.5, 0.8, 0.8, 0.5]
        );
        assert_eq!(Scale::from_tags(&[]).unwrap(), Scale::NEUTRAL);
    }

    #[test]
    fn two_tags_for_one_component_are_refused() {
        for pair in [[Tag::Light, Tag::Strong], [Tag::Far, Tag::Far]] {
            let message = Scale::from_tags(&pair).unwrap_err().to_string();
            for tag in pair {
                assert!(message.contains(&tag.to_string()), "{message}");
            }
        }
    }

    #[test]
    fn a_scale_must_be_finite_and_not_negative() {
        for bad in [-0.1, f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let message = Scale::new([1.0, 1.0, bad, 1.0]).unwrap_err().to_string();
            assert!(
                message.contains("Flow") && message.contains(&bad.to_string()),
                "{message}"
            );
        }
        assert!(Scale::new([0.0, 3.0, 1.0, 1.0]).is_ok());
    }
}
