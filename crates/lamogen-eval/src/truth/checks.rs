//! The checks: what a motion can be required to do. Their conditions are in `terms.rs`.

use std::fmt;
use std::str::FromStr;

use serde::{Serialize, Serializer};

use super::measurements::Measurements;
use super::side::Direction;
use super::side::Side::{self, Left, Right};
use super::verdict::Verdict;

/// An action that a motion is checked for. A check without a side holds for either side.
///
/// Checks are written in the words of [`Check::ALL`], such as `turns around left`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Check {
    /// The body moves in a direction, by the way that it faces at each step.
    Travels(Direction),
    /// The body moves at the speed of running.
    Runs,
    /// The body moves no faster than in a slow walk.
    GoesSlowly,
    /// The body stays near its start.
    Stays,
    /// The feet are lifted in turn, and the body stays near its start.
    StepsInPlace,
    /// The body travels first and stands at the end.
    Stops,
    /// The body stands at the start and travels at the end.
    Starts,
    /// The body turns to a side between start and end.
    Turns(Side),
    /// The body turns by about 90 degrees.
    TurnsQuarter(Side),
    /// The body turns by about 180 degrees.
    TurnsAround(Option<Side>),
    /// The body turns by about 360 degrees or more while it travels.
    TurnsInCircle(Option<Side>),
    /// One hand is raised to the shoulder or higher, and the other is not.
    RaisesHand(Side),
    /// One hand is raised over the head, and the other is not.
    RaisesHandOverHead(Side),
    /// Both hands are raised over the shoulders at once.
    RaisesBothHands,
    /// Both hands are raised over the head at once.
    RaisesBothHandsOverHead,
    /// A hand comes near the head.
    BringsHandToHead,
    /// A fist is thrust out or swung while the body stays near its start; with a side, farther than the other fist.
    Punches(Option<Side>),
    /// A stretched leg is flung up or out, higher than the other one.
    Kicks(Option<Side>),
    /// A knee is raised towards the height of the hip while the other leg stands.
    RaisesKnee(Side),
    /// The body stands on one leg for a while.
    StandsOnLeg(Option<Side>),
    /// The body goes down with the foot of this side ahead of the other.
    Lunges(Side),
    /// The body goes down onto the leg of this side, with the other leg stretched out to its side.
    LungesAside(Side),
    /// The body goes down and comes up this number of times.
    Squats(u8),
    /// Both feet leave the floor.
    Jumps,
    /// The body jumps and stays near its start.
    JumpsInPlace,
    /// The body jumps and travels forward.
    JumpsForward,
    /// Both feet leave the floor several times.
    JumpsAgain,
    /// Both feet leave the floor several times, with arms raised and legs spread.
    DoesJumpingJacks,
    /// The body stands at the start and sits at the end.
    SitsDown,
    /// The body sits or crouches at the start and stands at the end.
    StandsUp,
    /// The body stands at the start, goes down, and stands at the end.
    SitsDownAndGetsUp,
    /// The body goes down and lies at the end.
    LiesDown,
    /// The body lies all the time.
    Lies,
    /// The body lies at the start and is up at the end, on the feet or crouching.
    GetsUp,
    /// The body travels forward close to the floor, with the trunk along the floor.
    CrawlsForward,
    /// The body travels backward close to the floor, with the trunk along the floor.
    CrawlsBackward,
    /// A knee is on the floor for a while, with the trunk up.
    Kneels,
    /// The body gets low on the feet.
    Crouches,
    /// The body stands at the start and is higher at the end.
    GoesUp,
    /// The body is lower at the end than at the start, and stands.
    GoesDown,
    /// A hand goes far down and comes up again, and the body stands at the end.
    PicksUp,
    /// The trunk bends and comes up again.
    BendsForward,
    /// The body stands on the feet with little movement.
    StandsStill,
    /// The limbs move a lot while the body travels little.
    Dances,
    /// The head is lower than the hips at some time.
    GoesUpsideDown,
}

impl Check {
    /// All checks, each with the words that it is written in.
    pub const ALL: &'static [(&'static str, Check)] = &[
        ("travels forward", Check::Travels(Direction::Forward)),
        ("travels backward", Check::Travels(Direction::Backward)),
        ("travels left", Check::Travels(Direction::Sideways(Left))),
        ("travels right", Check::Travels(Direction::Sideways(Right))),
        ("runs", Check::Runs),
        ("goes slowly", Check::GoesSlowly),
        ("stays", Check::Stays),
        ("steps in place", Check::StepsInPlace),
        ("stops", Check::Stops),
        ("starts", Check::Starts),
        ("turns left", Check::Turns(Left)),
        ("turns right", Check::Turns(Right)),
        ("turns a quarter left", Check::TurnsQuarter(Left)),
        ("turns a quarter right", Check::TurnsQuarter(Right)),
        ("turns around", Check::TurnsAround(None)),
        ("turns around left", Check::TurnsAround(Some(Left))),
        ("turns around right", Check::TurnsAround(Some(Right))),
        ("turns in a circle", Check::TurnsInCircle(None)),
        ("turns in a circle left", Check::TurnsInCircle(Some(Left))),
        ("turns in a circle right", Check::TurnsInCircle(Some(Right))),
        ("raises left hand", Check::RaisesHand(Left)),
        ("raises right hand", Check::RaisesHand(Right)),
        (
            "raises left hand over head",
            Check::RaisesHandOverHead(Left),
        ),
        (
            "raises right hand over head",
            Check::RaisesHandOverHead(Right),
        ),
        ("raises both hands", Check::RaisesBothHands),
        (
            "raises both hands over head",
            Check::RaisesBothHandsOverHead,
        ),
        ("brings a hand to the head", Check::BringsHandToHead),
        ("punches", Check::Punches(None)),
        ("punches left", Check::Punches(Some(Left))),
        ("punches right", Check::Punches(Some(Right))),
        ("kicks", Check::Kicks(None)),
        ("kicks left", Check::Kicks(Some(Left))),
        ("kicks right", Check::Kicks(Some(Right))),
        ("raises left knee", Check::RaisesKnee(Left)),
        ("raises right knee", Check::RaisesKnee(Right)),
        ("stands on one leg", Check::StandsOnLeg(None)),
        ("stands on left leg", Check::StandsOnLeg(Some(Left))),
        ("stands on right leg", Check::StandsOnLeg(Some(Right))),
        ("lunges left", Check::Lunges(Left)),
        ("lunges right", Check::Lunges(Right)),
        ("lunges aside left", Check::LungesAside(Left)),
        ("lunges aside right", Check::LungesAside(Right)),
        ("squats once", Check::Squats(1)),
        ("squats twice", Check::Squats(2)),
        ("squats three times", Check::Squats(3)),
        ("jumps", Check::Jumps),
        ("jumps in place", Check::JumpsInPlace),
        ("jumps forward", Check::JumpsForward),
        ("jumps again and again", Check::JumpsAgain),
        ("does jumping jacks", Check::DoesJumpingJacks),
        ("sits down", Check::SitsDown),
        ("stands up", Check::StandsUp),
        ("sits down and gets up", Check::SitsDownAndGetsUp),
        ("lies down", Check::LiesDown),
        ("lies", Check::Lies),
        ("gets up", Check::GetsUp),
        ("crawls forward", Check::CrawlsForward),
        ("crawls backward", Check::CrawlsBackward),
        ("kneels", Check::Kneels),
        ("crouches", Check::Crouches),
        ("goes up", Check::GoesUp),
        ("goes down", Check::GoesDown),
        ("picks up", Check::PicksUp),
        ("bends forward", Check::BendsForward),
        ("stands still", Check::StandsStill),
        ("dances", Check::Dances),
        ("goes upside down", Check::GoesUpsideDown),
    ];

    /// Checks a motion by its measurements.
    pub fn judge(self, measured: &Measurements) -> Verdict {
        Verdict {
            check: self,
            terms: self.terms(measured),
        }
    }
}

impl fmt::Display for Check {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let words = Check::ALL.iter().find(|(_, check)| check == self);
        match words {
            Some((words, _)) => f.pad(words),
            // A check without words is in no sentence.
            None => write!(f, "{self:?}"),
        }
    }
}

impl Serialize for Check {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

/// The error for words that are not a check. It holds the words.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected a check such as `travels forward`, found `{0}`")]
pub struct CheckError(pub String);

impl FromStr for Check {
    type Err = CheckError;

    fn from_str(words: &str) -> Result<Check, CheckError> {
        let words = words.trim();
        let found = Check::ALL.iter().find(|(name, _)| *name == words);
        found
            .map(|(_, check)| *check)
            .ok_or_else(|| CheckError(words.into()))
    }
}
