//! The factors on all four components over time.

use std::fmt;
use std::ops::Range;

use lamogen_motion::FRAMES_PER_SECOND;

use crate::factor::{Factor, Interpolation};
use crate::tags::{COMPONENTS, Component, Scale, ScaleError};

/// A factor on each component, constant or over time. The default asks for no change.
///
/// ```
/// use lamogen_laban::{Component, Factor, Scale, ScaleCurve, Tag};
///
/// let near = Scale::from_tags(&[Tag::Near])?;
/// let scale = ScaleCurve::from(near)
///     .with(Component::Weight, Factor::parse(Component::Weight, "1:strong 2:light")?);
/// assert_eq!(scale.at(1.5), [1.5, 1.0, 1.0, 0.5]);
/// assert_eq!(scale.to_string(), "Weight 1:1.5 2:0.5, Shape 0.5");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ScaleCurve([Factor; COMPONENTS]);

impl ScaleCurve {
    /// Sets the factor on a component.
    pub fn with(mut self, component: Component, factor: Factor) -> Self {
        self.0[component.index()] = factor;
        self
    }

    /// Returns the factor on a component.
    pub const fn of(&self, component: Component) -> &Factor {
        &self.0[component as usize]
    }

    /// Returns the factors at a time in seconds, in the order of [`Component::ALL`].
    pub fn at(&self, seconds: f32) -> [f32; COMPONENTS] {
        Component::ALL.map(|component| self.of(component).at(seconds))
    }

    /// Returns the factors at each of a motion's frames. There are 20 frames a second, the first at 0 s.
    pub fn frames(&self, frames: usize) -> impl ExactSizeIterator<Item = [f32; COMPONENTS]> {
        (0..frames).map(|frame| self.at(frame as f32 / FRAMES_PER_SECOND))
    }

    /// Returns whether the factor on a component differs from 1 at any time.
    pub fn changes(&self, component: Component) -> bool {
        self.of(component).changes()
    }

    /// Returns the factors, if none of them has keys.
    pub fn constant(&self) -> Option<Scale> {
        let is_constant = self.0.iter().all(|factor| factor.keys().is_empty());
        is_constant.then(|| Scale::unchecked(self.at(0.0)))
    }

    /// Splits the frames of a motion at the keys of all components. The ranges are not empty and follow each other from
    /// the first frame to the last.
    pub fn segments(&self, frames: usize) -> Vec<Range<usize>> {
        let keys = self.0.iter().flat_map(Factor::keys);
        // A range starts at the first frame at which the key has been reached.
        let starts = keys.map(|key| {
            let is_before = |frame: &usize| (*frame as f32 / FRAMES_PER_SECOND) < key.seconds;
            (0..frames).take_while(is_before).count()
        });
        let mut cuts: Vec<usize> = starts.chain([0, frames]).collect();
        cuts.sort_unstable();
        cuts.dedup();
        cuts.windows(2).map(|pair| pair[0]..pair[1]).collect()
    }

    /// Checks that every key can act within a motion of `frames` frames. A key acts if it is reached by the last frame,
    /// or if a slide leads to it that ends no later than the motion.
    ///
    /// # Errors
    ///
    /// If a key cannot act; the message names the key and the motion's length.
    pub fn check(&self, frames: usize) -> Result<(), ScaleError> {
        let length = frames as f32 / FRAMES_PER_SECOND;
        let last = frames.saturating_sub(1) as f32 / FRAMES_PER_SECOND;
        for component in Component::ALL {
            let mut end = last;
            for key in self.of(component).keys() {
                if key.seconds > end {
                    return Err(ScaleError::Late {
                        component,
                        seconds: key.seconds,
                        length,
                    });
                }
                end = match key.interpolation {
                    Interpolation::Hold => last,
                    Interpolation::Linear => length,
                };
            }
        }
        Ok(())
    }
}

impl From<Scale> for ScaleCurve {
    fn from(scale: Scale) -> Self {
        ScaleCurve(scale.factors().map(Factor::unchecked))
    }
}

/// Writes the components that shall change, with their factors as [`Factor::parse`] reads them.
impl fmt::Display for ScaleCurve {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let changes = Component::ALL
            .into_iter()
            .filter(|component| self.changes(*component));
        let texts: Vec<String> = changes
            .map(|component| format!("{component} {}", self.of(component)))
            .collect();
        match texts.is_empty() {
            true => f.pad("no change"),
            false => f.pad(&texts.join(", ")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tags::Tag;

    fn weight(text: &str) -> ScaleCurve {
        let factor = Factor::parse(Component::Weight, text).unwrap();
        ScaleCurve::default().with(Component::Weight, factor)
    }

    #[test]
    fn a_constant_scale_is_the_same_at_every_frame() {
        let scale = Scale::from_tags(&[Tag::Strong, Tag::Near]).unwrap();
        let curve = ScaleCurve::from(scale);
        assert_eq!(curve.constant(), Some(scale));
        assert!(curve.frames(50).all(|row| row == scale.factors()));
        for component in Component::ALL {
            assert_eq!(curve.changes(component), scale.changes(component));
        }
        assert_eq!(ScaleCurve::default(), Scale::NEUTRAL.into());
    }

    #[test]
    fn a_key_acts_from_its_frame_on() {
        // The time 1.15 s is that of frame 23.
        let curve = weight("1.15:1.5");
        let rows: Vec<_> = curve.frames(40).collect();
        assert!(rows[..23].iter().all(|row| *row == [1.0; COMPONENTS]));
        assert!(rows[23..].iter().all(|row| *row == [1.5, 1.0, 1.0, 1.0]));
        assert_eq!(curve.constant(), None);
    }

    #[test]
    fn segments_run_from_key_to_key_of_any_component() {
        let time = Factor::parse(Component::Time, "0.51:0.8 1:1").unwrap();
        let curve = weight("0:1.5 1:0.5 9:1").with(Component::Time, time);
        assert_eq!(curve.segments(40), [0..11, 11..20, 20..40]);
        assert_eq!(ScaleCurve::default().segments(40), vec![0..40]);
        assert!(ScaleCurve::default().segments(0).is_empty());
    }

    #[test]
    fn a_key_that_cannot_act_is_refused_with_the_length() {
        for text in ["0:1 1.95:1.5", "0:1 ~ 2:1.5", "1.5", "0:1 ~ 1.5:1 1.95:2"] {
            assert_eq!(weight(text).check(40), Ok(()), "{text}");
        }
        for (text, seconds) in [
            ("0:1 2:1.5", "2 s"),
            ("0:1 ~ 2.05:1.5", "2.05 s"),
            ("7:1.5", "7 s"),
            ("1:2 1.96:1", "1.96 s"),
            ("0:1 ~ 2:1 3:2", "3 s"),
        ] {
            let message = weight(text).check(40).unwrap_err().to_string();
            for part in ["Weight", &format!("at {seconds}"), "ends at 2 s"] {
                assert!(message.contains(part), "{text}: {message}");
            }
        }
    }

    #[test]
    fn the_text_names_the_components_that_change() {
        assert_eq!(weight("0:1 ~ 2:1.5").to_string(), "Weight 0:1 ~ 2:1.5");
        assert_eq!(ScaleCurve::default().to_string(), "no change");
    }
}
