//! Positions that parts of the body reach.

use std::fmt;
use std::str::FromStr;

use lamogen_motion::Joint;

use super::error::{PlaceError, check_metres, check_seconds, parse_numbers};

/// A part of the body that can reach a position.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ReachPart {
    /// The wrist of the left hand, which is the last joint of the arm.
    LeftHand,
    /// The wrist of the right hand, which is the last joint of the arm.
    RightHand,
    /// The ball of the left foot.
    LeftFoot,
    /// The ball of the right foot.
    RightFoot,
    /// The joint of the head, between the ears.
    Head,
}

impl ReachPart {
    /// All parts.
    pub const ALL: [ReachPart; 5] = [
        ReachPart::LeftHand,
        ReachPart::RightHand,
        ReachPart::LeftFoot,
        ReachPart::RightFoot,
        ReachPart::Head,
    ];

    /// Returns the name of the part, such as `right-hand`.
    pub const fn name(self) -> &'static str {
        match self {
            ReachPart::LeftHand => "left-hand",
            ReachPart::RightHand => "right-hand",
            ReachPart::LeftFoot => "left-foot",
            ReachPart::RightFoot => "right-foot",
            ReachPart::Head => "head",
        }
    }

    /// Returns the joint of the part.
    pub const fn joint(self) -> Joint {
        match self {
            ReachPart::LeftHand => Joint::LeftWrist,
            ReachPart::RightHand => Joint::RightWrist,
            ReachPart::LeftFoot => Joint::LeftFoot,
            ReachPart::RightFoot => Joint::RightFoot,
            ReachPart::Head => Joint::Head,
        }
    }

    /// Returns the names of all parts with commas between them.
    pub(super) fn names() -> String {
        ReachPart::ALL.map(ReachPart::name).join(", ")
    }
}

impl FromStr for ReachPart {
    type Err = PlaceError;

    fn from_str(name: &str) -> Result<Self, PlaceError> {
        let mut parts = ReachPart::ALL.into_iter();
        let part = parts.find(|part| part.name() == name);
        part.ok_or_else(|| PlaceError::Part { found: name.into() })
    }
}

/// A position that a part of the body reaches at a moment.
///
/// The text form is `part@seconds=x,y,z`:
///
/// ```
/// use lamogen_guide::{Reach, ReachPart};
///
/// let reach: Reach = "right-hand@1.5=-0.3,1.6,0.5".parse()?;
/// assert_eq!(reach, Reach::new(ReachPart::RightHand, 1.5, [-0.3, 1.6, 0.5])?);
/// assert_eq!(reach.to_string(), "right-hand@1.5=-0.3,1.6,0.5");
/// # Ok::<(), lamogen_guide::PlaceError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(try_from = "String", into = "String"))]
pub struct Reach {
    part: ReachPart,
    seconds: f32,
    position: [f32; 3],
}

impl Reach {
    /// The example in error messages.
    pub(super) const EXAMPLE: &str = "right-hand@1.5=-0.3,1.6,0.5";

    /// Creates a position to reach: `seconds` from the start of the motion, and metres from its start, x to the left of
    /// how the body stands at the start, y up from the floor, z forward.
    ///
    /// # Errors
    ///
    /// If a number is not finite or out of range.
    pub fn new(part: ReachPart, seconds: f32, position: [f32; 3]) -> Result<Reach, PlaceError> {
        check_seconds(seconds)?;
        check_metres(&position)?;
        Ok(Reach {
            part,
            seconds,
            position,
        })
    }

    /// Returns the same part at another moment and position.
    pub(super) fn moved(&self, seconds: f32, position: [f32; 3]) -> Reach {
        Reach {
            part: self.part,
            seconds,
            position,
        }
    }

    /// Returns the part of the body.
    pub fn part(&self) -> ReachPart {
        self.part
    }

    /// Returns the moment in seconds.
    pub fn seconds(&self) -> f32 {
        self.seconds
    }

    /// Returns the position in metres.
    pub fn position(&self) -> [f32; 3] {
        self.position
    }
}

impl fmt::Display for Reach {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y, z] = self.position;
        write!(f, "{}@{}={x},{y},{z}", self.part.name(), self.seconds)
    }
}

impl From<Reach> for String {
    fn from(reach: Reach) -> String {
        reach.to_string()
    }
}

impl TryFrom<String> for Reach {
    type Error = PlaceError;

    fn try_from(text: String) -> Result<Self, PlaceError> {
        text.parse()
    }
}

impl FromStr for Reach {
    type Err = PlaceError;

    fn from_str(text: &str) -> Result<Self, PlaceError> {
        let problem = || PlaceError::Reach { found: text.into() };
        let (part, rest) = text.split_once('@').ok_or_else(problem)?;
        let (seconds, position) = rest.split_once('=').ok_or_else(problem)?;
        let part = part.trim().parse()?;
        let seconds = seconds.trim().parse().map_err(|_| problem())?;
        let position = parse_numbers(position).ok_or_else(problem)?;
        Reach::new(part, seconds, position)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_that_are_no_place_to_reach_are_refused() {
        for (text, part) in [
            ("", "found \"\""),
            ("right-hand", "found \"right-hand\""),
            ("right-hand@1", "found \"right-hand@1\""),
            ("right-hand@1=1,2", "found \"right-hand@1=1,2\""),
            ("right-hand@x=1,2,3", "found \"right-hand@x=1,2,3\""),
            ("tail@1=1,2,3", "found \"tail\""),
            ("right-hand@-1=1,2,3", "found -1"),
            ("right-hand@inf=1,2,3", "found inf"),
            ("right-hand@1=1,NaN,3", "found NaN"),
            ("right-hand@1=1,2,1e9", "found 1000000000"),
        ] {
            let message = text.parse::<Reach>().unwrap_err().to_string();
            assert!(
                message.contains(part) && message.contains("expected"),
                "{text:?}: {message}"
            );
        }
        let message = "tail@1=1,2,3".parse::<Reach>().unwrap_err().to_string();
        assert!(message.contains("left-hand, right-hand, left-foot, right-foot, head"));
    }
}
