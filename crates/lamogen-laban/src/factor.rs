//! A factor on one Laban component, constant or over time.

use std::fmt;
use std::ops::Range;

use lamogen_motion::FRAMES_PER_SECOND;

use crate::tags::{Component, Tag};

/// A factor on a component's baseline, constant or over time. A factor of 1 asks for no change.
///
/// A factor over time has keys. Before the first key it is 1, and after the last key it keeps that key's factor.
/// Between two keys it keeps the factor of the earlier key, or slides: it changes linearly to the factor of the later
/// key.
///
/// The text form of a constant is a number or a tag of the component. The text form of keys is `seconds:factor`, in
/// order of time, with a space between two keys where the factor holds and `~` where it slides:
///
/// ```
/// use lamogen_laban::{Component, Factor};
///
/// // Strong from second 1 to second 2, then light.
/// let weight = Factor::parse(Component::Weight, "1:strong 2:light")?;
/// assert_eq!([0.0, 1.0, 1.9, 2.0, 9.0].map(|t| weight.at(t)), [1.0, 1.5, 1.5, 0.5, 0.5]);
///
/// let shape = Factor::parse(Component::Shape, "0:1 ~ 2:0.5")?;
/// assert_eq!([0.0, 1.0, 2.0, 9.0].map(|t| shape.at(t)), [1.0, 0.75, 0.5, 0.5]);
///
/// assert_eq!(Factor::parse(Component::Time, "sudden")?, Factor::constant(1.2)?);
/// # Ok::<(), lamogen_laban::FactorError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Factor {
    /// The factor before the first key.
    start: f32,
    keys: Vec<FactorKeyframe>,
}

/// A time at which a factor over time has a given value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FactorKeyframe {
    /// Seconds from the motion's start.
    pub seconds: f32,
    /// The factor at that time.
    pub factor: f32,
    /// The interpolation from this key to the next.
    pub interpolation: Interpolation,
}

/// The interpolation of a factor between two keys.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Interpolation {
    /// The factor stays constant and jumps at the next key.
    #[default]
    Hold,
    /// The factor changes linearly to that of the next key.
    Linear,
}

/// The reason why a factor is invalid or a text is no factor.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[allow(missing_docs)]
pub enum FactorError {
    /// There are no keys.
    #[error(
        "expected a factor such as 1.5, or keys such as \"0:1 1:1.5 2:0.5\" (seconds:factor), found nothing"
    )]
    Empty,
    /// The text is no key.
    #[error("expected a key seconds:factor such as 1:1.5, found {found:?}")]
    Key { found: String },
    /// The text is neither a number nor a tag.
    #[error("expected a number or one of {}, found {found:?}", words(.component))]
    Word { found: String, component: Component },
    /// The tag belongs to another component.
    #[error(
        "{tag} speaks of {}, not of {component}, whose words are {}",
        .tag.component(),
        words(.component)
    )]
    Tag { tag: Tag, component: Component },
    /// A factor is negative, infinite or not a number.
    #[error("a factor must be a finite number of at least 0, found {found}")]
    Value { found: f32 },
    /// A time is negative, infinite or not a number.
    #[error("the seconds of a key must be a finite number of at least 0, found {found}")]
    Seconds { found: f32 },
    /// A key is not later than the one before it.
    #[error("keys must be in the order of time, found {later} s after {earlier} s")]
    Order { earlier: f32, later: f32 },
    /// A slide has no key at its start or at its end.
    #[error("a slide (~) must lead from one key to another, as in \"0:1 ~ 2:0.5\"")]
    Slide,
}

/// Returns the tags of a component as a list for messages.
pub(crate) fn words(component: &Component) -> String {
    let tags = Tag::ALL.iter().filter(|tag| tag.component() == *component);
    tags.map(Tag::to_string).collect::<Vec<_>>().join(", ")
}

impl FactorKeyframe {
    /// Creates a key with a factor that stays constant until the next key.
    pub const fn hold(seconds: f32, factor: f32) -> FactorKeyframe {
        FactorKeyframe {
            seconds,
            factor,
            interpolation: Interpolation::Hold,
        }
    }

    /// Creates a key with a factor that changes linearly to that of the next key.
    pub const fn linear(seconds: f32, factor: f32) -> FactorKeyframe {
        FactorKeyframe {
            seconds,
            factor,
            interpolation: Interpolation::Linear,
        }
    }
}

/// Returns the tag's factor as a constant.
impl From<Tag> for Factor {
    fn from(tag: Tag) -> Self {
        Factor::unchecked(tag.scale())
    }
}

impl Factor {
    /// The constant factor 1, which asks for no change.
    pub const NEUTRAL: Factor = Factor::unchecked(1.0);

    /// Creates a constant factor.
    ///
    /// # Errors
    ///
    /// If the factor is negative or not finite.
    pub fn constant(factor: f32) -> Result<Factor, FactorError> {
        check_value(factor)?;
        Ok(Factor::unchecked(factor))
    }

    /// Creates a constant factor that is known to be finite and not negative.
    pub(crate) const fn unchecked(factor: f32) -> Factor {
        Factor {
            start: factor,
            keys: Vec::new(),
        }
    }

    /// Creates a factor over time from its keys.
    ///
    /// # Errors
    ///
    /// If there are no keys, their times do not ascend, a time or factor is negative or not finite, or
    /// the last key slides.
    pub fn keyed(keys: impl Into<Vec<FactorKeyframe>>) -> Result<Factor, FactorError> {
        let keys = keys.into();
        for key in &keys {
            if !key.seconds.is_finite() || key.seconds < 0.0 {
                return Err(FactorError::Seconds { found: key.seconds });
            }
            check_value(key.factor)?;
        }
        for pair in keys.windows(2) {
            let [earlier, later] = [pair[0].seconds, pair[1].seconds];
            if later <= earlier {
                return Err(FactorError::Order { earlier, later });
            }
        }
        match keys.last().ok_or(FactorError::Empty)?.interpolation {
            Interpolation::Linear => Err(FactorError::Slide),
            Interpolation::Hold => Ok(Factor { start: 1.0, keys }),
        }
    }

    /// Parses a factor from its text form (see [`Factor`]). Words are tags of `component`.
    ///
    /// # Errors
    ///
    /// If the text is of another form, and in the cases of [`keyed`](Factor::keyed).
    pub fn parse(component: Component, text: &str) -> Result<Factor, FactorError> {
        let spaced = text.replace('~', " ~ ");
        let parts: Vec<&str> = spaced.split_whitespace().collect();
        if let [constant] = parts[..]
            && !constant.contains([':', '~'])
        {
            return Factor::constant(parse_value(component, constant)?);
        }
        let mut keys: Vec<FactorKeyframe> = Vec::new();
        let mut is_after_slide = false;
        for part in parts {
            if part == "~" {
                let last = keys.last_mut().filter(|_| !is_after_slide);
                last.ok_or(FactorError::Slide)?.interpolation = Interpolation::Linear;
                is_after_slide = true;
            } else {
                keys.push(parse_key(component, part)?);
                is_after_slide = false;
            }
        }
        Factor::keyed(keys)
    }

    /// Returns the factor at a time in seconds.
    pub fn at(&self, seconds: f32) -> f32 {
        let next = self.keys.partition_point(|key| key.seconds <= seconds);
        let Some(key) = next.checked_sub(1).map(|last| self.keys[last]) else {
            return self.start;
        };
        match (key.interpolation, self.keys.get(next)) {
            (Interpolation::Linear, Some(next)) => {
                let fraction = (seconds - key.seconds) / (next.seconds - key.seconds);
                key.factor + fraction * (next.factor - key.factor)
            }
            _ => key.factor,
        }
    }

    /// Returns the factor at each of a motion's frames. There are 20 frames a second, the first at 0 s.
    pub fn frames(&self, frames: usize) -> impl ExactSizeIterator<Item = f32> + '_ {
        (0..frames).map(|frame| self.at(frame as f32 / FRAMES_PER_SECOND))
    }

    /// Returns the factor of some of a motion's frames, as if these were a motion of their own.
    pub(crate) fn section(&self, frames: &Range<usize>) -> Factor {
        let [start, last] = [frames.start, frames.end.saturating_sub(1)]
            .map(|frame| frame as f32 / FRAMES_PER_SECOND);
        let mut keys: Vec<FactorKeyframe> = Vec::new();
        let next = self.keys.partition_point(|key| key.seconds <= start);
        if let Some(key) = next.checked_sub(1).map(|last| self.keys[last]) {
            keys.push(FactorKeyframe {
                seconds: start,
                factor: self.at(start),
                ..key
            });
        }
        let within = self.keys[next..].iter();
        keys.extend(within.take_while(|key| key.seconds <= last));
        // A slide to a key after these frames ends with the last one.
        if let Some(key) = keys.last_mut()
            && key.interpolation == Interpolation::Linear
        {
            match key.seconds < last {
                true => keys.push(FactorKeyframe::hold(last, self.at(last))),
                false => key.interpolation = Interpolation::Hold,
            }
        }
        for key in &mut keys {
            key.seconds -= start;
        }
        match keys[..] {
            [only] if only.seconds == 0.0 => Factor::unchecked(only.factor),
            _ => Factor {
                start: self.start,
                keys,
            },
        }
    }

    /// Returns the keys in order of time; there are none if the factor is constant.
    pub fn keys(&self) -> &[FactorKeyframe] {
        &self.keys
    }

    /// Returns whether the factor differs from 1 at any time.
    pub fn changes(&self) -> bool {
        self.start != 1.0 || self.keys.iter().any(|key| key.factor != 1.0)
    }
}

impl Default for Factor {
    fn default() -> Self {
        Factor::NEUTRAL
    }
}

/// Writes the text that [`Factor::parse`] reads, with numbers in the place of tags.
impl fmt::Display for Factor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Some((last, before)) = self.keys.split_last() else {
            return write!(f, "{}", self.start);
        };
        for key in before {
            let gap = match key.interpolation {
                Interpolation::Hold => " ",
                Interpolation::Linear => " ~ ",
            };
            write!(f, "{}:{}{gap}", key.seconds, key.factor)?;
        }
        write!(f, "{}:{}", last.seconds, last.factor)
    }
}

fn check_value(found: f32) -> Result<(), FactorError> {
    match found.is_finite() && found >= 0.0 {
        true => Ok(()),
        false => Err(FactorError::Value { found }),
    }
}

fn parse_key(component: Component, text: &str) -> Result<FactorKeyframe, FactorError> {
    let key_error = || FactorError::Key { found: text.into() };
    let (seconds, factor) = text.split_once(':').ok_or_else(key_error)?;
    let seconds = seconds.parse().map_err(|_| key_error())?;
    Ok(FactorKeyframe::hold(
        seconds,
        parse_value(component, factor)?,
    ))
}

fn parse_value(component: Component, text: &str) -> Result<f32, FactorError> {
    if let Ok(tag) = text.parse::<Tag>() {
        return match tag.component() == component {
            true => Ok(tag.scale()),
            false => Err(FactorError::Tag { tag, component }),
        };
    }
    text.parse().map_err(|_| FactorError::Word {
        found: text.into(),
        component,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn weight(text: &str) -> Result<Factor, FactorError> {
        Factor::parse(Component::Weight, text)
    }

    #[test]
    fn a_factor_holds_until_the_next_key_and_after_the_last() {
        let factor = weight("0:1 1:1.5 2:0.5").unwrap();
        for (seconds, expected) in [(0.0, 1.0), (0.95, 1.0), (1.0, 1.5), (1.95, 1.5), (2.0, 0.5)] {
            assert_eq!(factor.at(seconds), expected, "{seconds} s");
        }
        assert_eq!(factor.at(100.0), 0.5);
    }

    #[test]
    fn before_the_first_key_the_factor_is_one() {
        for text in ["1:0.5", "1:0.5 ~ 2:1.5"] {
            assert_eq!(weight(text).unwrap().at(0.95), 1.0);
        }
    }

    #[test]
    fn a_slide_is_linear_and_ends_at_its_key() {
        let factor = weight("0:1~1:1.5~3:0.5 4:2").unwrap();
        for (seconds, expected) in [(0.5, 1.25), (1.0, 1.5), (2.0, 1.0), (3.0, 0.5), (3.9, 0.5)] {
            assert_eq!(factor.at(seconds), expected, "{seconds} s");
        }
    }

    #[test]
    fn text_round_trips_whatever_the_spaces() {
        for (text, expected) in [
            ("1.5", "1.5"),
            (" Strong ", "1.5"),
            ("1:LIGHT", "1:0.5"),
            ("0:1  1:strong\t2:light", "0:1 1:1.5 2:0.5"),
            ("0:1~1:1.5 2:0.5", "0:1 ~ 1:1.5 2:0.5"),
            ("0.05:1e-3 ~ 0.3:0", "0.05:0.001 ~ 0.3:0"),
        ] {
            let factor = weight(text).unwrap();
            assert_eq!(factor.to_string(), expected);
            assert_eq!(weight(expected).unwrap(), factor);
        }
    }

    #[test]
    fn words_are_those_of_the_component_alone() {
        for tag in Tag::ALL {
            for component in Component::ALL {
                let parsed = Factor::parse(component, &format!("1:{tag}"));
                match component == tag.component() {
                    true => assert_eq!(parsed.unwrap().at(1.0), tag.scale()),
                    false => assert_eq!(parsed, Err(FactorError::Tag { tag, component })),
                }
            }
        }
        let message = weight("0:1 1:sudden").unwrap_err().to_string();
        for part in ["sudden", "Time", "Weight", "light, strong"] {
            assert!(message.contains(part), "{message}");
        }
    }

    #[test]
    fn errors_of_invalid_texts_quote_the_text() {
        for (text, parts) in [
            ("", &["0:1 1:1.5 2:0.5", "nothing"][..]),
            ("heavy", &["light, strong", "\"heavy\""]),
            ("1:heavy", &["light, strong", "\"heavy\""]),
            ("1:", &["light, strong", "\"\""]),
            ("1:2:3", &["\"2:3\""]),
            (":1", &["seconds:factor", "\":1\""]),
            ("1 2", &["seconds:factor", "\"1\""]),
            ("0:1, 1:2", &["\"1,\""]),
            ("one:1", &["seconds:factor", "\"one:1\""]),
            ("-1", &["factor", "at least 0", "-1"]),
            ("nan", &["factor", "NaN"]),
            ("0:inf", &["factor", "finite", "inf"]),
            ("0:1e39", &["factor", "inf"]),
            ("-1:1", &["seconds", "at least 0", "-1"]),
            ("inf:1", &["seconds", "finite", "inf"]),
            ("0:1 2:1 1:1", &["1 s after 2 s"]),
            ("1:1 1:2", &["1 s after 1 s"]),
            ("~", &["slide"]),
            ("~0:1", &["slide"]),
            ("0:1~", &["slide"]),
            ("0:1~~1:2", &["slide"]),
            ("1~2", &["\"1\""]),
        ] {
            let message = weight(text).expect_err(text).to_string();
            for part in parts {
                assert!(message.contains(part), "{text:?}: {message}");
            }
        }
    }

    #[test]
    fn keys_can_be_given_without_text() {
        let keys = [
            FactorKeyframe::linear(0.0, 1.0),
            FactorKeyframe::hold(1.0, 1.5),
        ];
        assert_eq!(Factor::keyed(keys), weight("0:1 ~ 1:1.5"));
        assert_eq!(Factor::keyed([]), Err(FactorError::Empty));
        let open_slide = [
            FactorKeyframe::hold(0.0, 1.0),
            FactorKeyframe::linear(1.0, 1.5),
        ];
        assert_eq!(Factor::keyed(open_slide), Err(FactorError::Slide));
    }

    #[test]
    fn a_factor_with_a_change_at_any_time_changes() {
        for (text, changes) in [("1", false), ("0:1 2:1", false), ("0.9", true)] {
            assert_eq!(weight(text).unwrap().changes(), changes, "{text}");
        }
        assert!(weight("0:1 2:1.5 3:1").unwrap().changes());
    }

    #[test]
    fn a_section_has_the_factors_of_its_frames() {
        for text in [
            "1.5",
            "1:strong ~ 3:light 4:2",
            "0.5:0.5 ~ 4.5:2",
            "0:2 2:0.5",
        ] {
            let factor = Factor::parse(Component::Weight, text).unwrap();
            let whole: Vec<f32> = factor.frames(100).collect();
            for section in [0..100, 0..30, 15..41, 40..100, 60..61, 99..100] {
                let own = factor.section(&section);
                let found: Vec<f32> = own.frames(section.len()).collect();
                let pairs = found.iter().zip(&whole[section.clone()]);
                let largest = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
                assert!(largest < 1e-5, "{text} at {section:?}: {found:?}");
                let last = own.keys().last().map_or(0.0, |key| key.seconds);
                assert!(last * FRAMES_PER_SECOND <= section.len() as f32 - 0.99);
            }
        }
    }
}
