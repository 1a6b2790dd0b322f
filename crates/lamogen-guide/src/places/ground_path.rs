//! A path of the pelvis along the ground.

use std::fmt;
use std::str::FromStr;

use super::error::{PlaceError, check_metres, check_seconds, parse_numbers};

/// A place on the ground that the pelvis passes at a moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Waypoint {
    /// Seconds from the start of the motion.
    pub seconds: f32,
    /// Metres from the start: x to the left of how the body stands at the start, and z forward.
    pub place: [f32; 2],
}

/// A path of the pelvis along the ground: places at moments, in the order of time. Between them the body is free.
///
/// The text form is `seconds:x,z` for each place, with spaces between them:
///
/// ```
/// use lamogen_guide::{GroundPath, Waypoint};
///
/// let path: GroundPath = "0:0,0 2:1,0 4:1,2".parse()?;
/// assert_eq!(path.waypoints()[1], Waypoint { seconds: 2.0, place: [1.0, 0.0] });
/// assert_eq!(path.to_string(), "0:0,0 2:1,0 4:1,2");
/// # Ok::<(), lamogen_guide::PlaceError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(try_from = "String", into = "String"))]
pub struct GroundPath {
    waypoints: Vec<Waypoint>,
}

/// The largest distance in metres between the place of a path at 0 s and the start.
const START_TOLERANCE: f32 = 0.05;

impl GroundPath {
    /// The example in error messages.
    pub(super) const EXAMPLE: &str = "0:0,0 2:1,0 4:1,2";
    /// The largest coordinate in metres, far more than any motion can cover.
    pub const LARGEST_METRES: f32 = 1000.0;

    /// Creates a path.
    ///
    /// # Errors
    ///
    /// If there are no places, a number is not finite or out of range, moments are not in the order of time, or the place
    /// at 0 s is not the start.
    pub fn new(waypoints: impl IntoIterator<Item = Waypoint>) -> Result<GroundPath, PlaceError> {
        let waypoints: Vec<Waypoint> = waypoints.into_iter().collect();
        if waypoints.is_empty() {
            return Err(PlaceError::EmptyPath);
        }
        for (index, point) in waypoints.iter().enumerate() {
            check_seconds(point.seconds)?;
            check_metres(&point.place)?;
            if let Some(before) = index.checked_sub(1)
                && waypoints[before].seconds >= point.seconds
            {
                return Err(PlaceError::Order {
                    earlier: waypoints[before].seconds,
                    later: point.seconds,
                });
            }
        }
        let Waypoint { seconds, place } = waypoints[0];
        let [x, z] = place;
        match seconds == 0.0 && x.hypot(z) > START_TOLERANCE {
            true => Err(PlaceError::Start { x, z }),
            false => Ok(GroundPath { waypoints }),
        }
    }

    /// Makes a path of at least one place, in the order of time.
    pub(super) fn of_checked(waypoints: Vec<Waypoint>) -> GroundPath {
        GroundPath { waypoints }
    }

    /// Returns the places in the order of time.
    pub fn waypoints(&self) -> &[Waypoint] {
        &self.waypoints
    }
}

impl fmt::Display for GroundPath {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, Waypoint { seconds, place }) in self.waypoints.iter().enumerate() {
            let space = if index > 0 { " " } else { "" };
            write!(f, "{space}{seconds}:{},{}", place[0], place[1])?;
        }
        Ok(())
    }
}

impl From<GroundPath> for String {
    fn from(path: GroundPath) -> String {
        path.to_string()
    }
}

impl TryFrom<String> for GroundPath {
    type Error = PlaceError;

    fn try_from(text: String) -> Result<Self, PlaceError> {
        text.parse()
    }
}

impl FromStr for GroundPath {
    type Err = PlaceError;

    fn from_str(text: &str) -> Result<Self, PlaceError> {
        let waypoints = text.split_whitespace().map(|word| {
            let problem = || PlaceError::Waypoint { found: word.into() };
            let (seconds, place) = word.split_once(':').ok_or_else(problem)?;
            Ok(Waypoint {
                seconds: seconds.parse().map_err(|_| problem())?,
                place: parse_numbers(place).ok_or_else(problem)?,
            })
        });
        GroundPath::new(waypoints.collect::<Result<Vec<_>, PlaceError>>()?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_are_read_as_they_are_written() {
        for text in ["0:0,0 2:1,0 4:1,2", "1.5:-0.25,3"] {
            let path: GroundPath = text.parse().unwrap();
            assert_eq!(path.to_string(), text);
            assert_eq!(path.to_string().parse(), Ok(path));
        }
    }

    #[test]
    fn texts_that_are_no_path_are_refused() {
        for (text, part) in [
            ("", "found nothing"),
            ("   ", "found nothing"),
            ("1", "found \"1\""),
            ("0:0,0 2:1", "found \"2:1\""),
            ("0:0,0 2:1,0,3", "found \"2:1,0,3\""),
            ("0:0,0 x:1,0", "found \"x:1,0\""),
            ("0:0,0 2:a,0", "found \"2:a,0\""),
            ("0:0,0 NaN:1,0", "found NaN"),
            ("-1:0,0", "found -1"),
            ("1:inf,0", "found inf"),
            ("1:0,NaN", "found NaN"),
            ("1:0,1001", "found 1001"),
            ("0:0,0 2:1,0 2:1,1", "found 2 s after 2 s"),
            ("0:0,0 2:1,0 1:1,1", "found 1 s after 2 s"),
            ("0:1,0 2:1,0", "found 1,0"),
        ] {
            let message = text.parse::<GroundPath>().unwrap_err().to_string();
            assert!(
                message.contains(part) && message.contains("expected"),
                "{text:?}: {message}"
            );
        }
    }
}
