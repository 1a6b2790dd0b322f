//! The errors of places.

use lamogen_motion::BodyError;

use super::facing::Facing;
use super::ground_path::GroundPath;
use super::reach::{Reach, ReachPart};

/// The reason why a place is invalid or a text states none.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[allow(missing_docs)]
pub enum PlaceError {
    /// A path has no places.
    #[error(
        "expected places seconds:x,z such as \"{}\", found nothing",
        GroundPath::EXAMPLE
    )]
    EmptyPath,
    /// The text is no place of a path.
    #[error("expected a place seconds:x,z such as 2:1,0, found {found:?}")]
    Waypoint { found: String },
    /// The text is no place to reach.
    #[error(
        "expected part@seconds=x,y,z such as {}, found {found:?}",
        Reach::EXAMPLE
    )]
    Reach { found: String },
    /// The body has no such part that can reach a place.
    #[error("expected one of {}, found {found:?}", ReachPart::names())]
    Part { found: String },
    /// The text is no direction.
    #[error(
        "expected path, free, or degrees from {} to {} (to the left of the start), found {found:?}",
        -Facing::LARGEST_DEGREES,
        Facing::LARGEST_DEGREES
    )]
    Facing { found: String },
    /// A moment is negative, infinite or not a number.
    #[error("expected seconds that are a finite number of at least 0, found {found}")]
    Seconds { found: f32 },
    /// A coordinate is not finite or far too large.
    #[error(
        "expected metres from {} to {}, found {found}",
        -GroundPath::LARGEST_METRES,
        GroundPath::LARGEST_METRES
    )]
    Metres { found: f32 },
    /// The places of a path are not in the order of time.
    #[error(
        "expected places in the order of time, one at each moment, found {later} s after {earlier} s"
    )]
    Order { earlier: f32, later: f32 },
    /// Two places of a path fall on the same frame.
    #[error(
        "expected the places of a path at least a frame (0.05 s) apart, found {earlier} s and {later} s, which are the same frame"
    )]
    SameFrame { earlier: f32, later: f32 },
    /// A part of the body shall be at two places at once.
    #[error("expected one place for a part of the body at a moment, found {first} and {second}")]
    Twice { first: Reach, second: Reach },
    /// The body shall take two poses at once.
    #[error(
        "expected poses at least a frame (0.05 s) apart, found two at {first} s and {second} s, which are the same frame"
    )]
    TwoPoses { first: f32, second: f32 },
    /// The motion that a pose is of shows no body.
    #[error(transparent)]
    Body(#[from] BodyError),
    /// The path does not begin where the motion begins.
    #[error("expected 0,0 at 0 s, where the pelvis starts, found {x},{z}")]
    Start { x: f32, z: f32 },
    /// A moment is past the end of the motion.
    #[error("expected moments within the motion, 0 to {length} s, found {seconds} s")]
    Beyond { seconds: f32, length: f32 },
    /// A moment is in a part of the motion that has been made.
    #[error("expected moments from {made} s on, before which all is made, found {seconds} s")]
    Passed { seconds: f32, made: f32 },
}

/// Checks a moment in seconds.
pub(super) fn check_seconds(seconds: f32) -> Result<(), PlaceError> {
    match seconds.is_finite() && seconds >= 0.0 {
        true => Ok(()),
        false => Err(PlaceError::Seconds { found: seconds }),
    }
}

/// Checks the coordinates of a place.
pub(super) fn check_metres(place: &[f32]) -> Result<(), PlaceError> {
    let limit = GroundPath::LARGEST_METRES;
    // NaN is in no range.
    match place.iter().find(|x| !(-limit..=limit).contains(*x)) {
        Some(&found) => Err(PlaceError::Metres { found }),
        None => Ok(()),
    }
}

/// Parses `N` numbers with commas between them.
pub(super) fn parse_numbers<const N: usize>(text: &str) -> Option<[f32; N]> {
    let numbers: Result<Vec<f32>, _> = text.split(',').map(|part| part.trim().parse()).collect();
    numbers.ok()?.try_into().ok()
}
