//! Places: where the body shall be at given moments.
//!
//! ```text
//! GroundPath, Facing, Reach, KeyPose ──Places::terms──▶ loss terms       of the network's pass and of the rigid body
//!            │
//!            └──────────────RootPlan──▶ path of the root, which every prediction of the guided pass follows
//! ```
//!
//! Positions are in metres, relative to the start of the motion: x to the left of how the body stands at the start, y up
//! from the floor, z forward. The pelvis starts at x = z = 0. A motion that goes on from another one counts from where that one
//! ends ([`PlaceOrigin`]), and so does every stretch of a motion that is made in several ([`Itinerary`]).

mod error;
mod facing;
mod ground_path;
mod itinerary;
mod key_pose;
mod notices;
mod origin;
mod outcome;
mod reach;
mod root_plan;
mod spline;
mod terms;
#[cfg(test)]
mod testing;

use std::borrow::Cow;
use std::sync::Arc;

use lamogen_motion::{FRAMES_PER_SECOND, JOINTS, Motion};

use crate::loss_term::LossTerm;
pub use error::PlaceError;
pub use facing::Facing;
pub use ground_path::{GroundPath, Waypoint};
pub use itinerary::Itinerary;
pub use key_pose::KeyPose;
pub use origin::PlaceOrigin;
pub use outcome::PlaceOutcome;
pub use reach::{Reach, ReachPart};
pub(crate) use root_plan::RootPlan;

/// The places at which a body shall be: a path of the pelvis, positions that hands, feet or head reach, and poses.
///
/// Each place is a term of the loss that guidance lowers ([`Places::terms`]). In the guided pass of a network that makes
/// whole motions, every prediction is moved so that its root follows the path, and the network finds the steps that go
/// with it. The fit to the rigid body removes what is left.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Places {
    /// The path of the pelvis along the ground, if there is one.
    pub path: Option<GroundPath>,
    /// Where the body faces on its path; without a path it has no effect. Default: along the path.
    pub facing: Facing,
    /// The positions that parts of the body reach.
    pub reaches: Vec<Reach>,
    /// The poses that the body takes.
    pub poses: Vec<KeyPose>,
}

impl Places {
    /// Returns whether nothing is asked.
    pub fn is_empty(&self) -> bool {
        self.path.is_none() && self.reaches.is_empty() && self.poses.is_empty()
    }

    /// Checks that a motion of `frames` frames can have the places.
    ///
    /// # Errors
    ///
    /// If a moment is beyond the motion, two moments of a path, of one part of the body or of poses are the same frame, or the path
    /// does not start where the motion does.
    pub fn check(&self, frames: usize) -> Result<(), PlaceError> {
        let is_within = |seconds: f32| seconds * FRAMES_PER_SECOND <= frames as f32 + 0.5;
        for seconds in self.moments() {
            if !is_within(seconds) {
                let length = frames as f32 / FRAMES_PER_SECOND;
                return Err(PlaceError::Beyond { seconds, length });
            }
        }
        if let Some(path) = &self.path {
            for pair in path.waypoints().windows(2) {
                let [earlier, later] = [pair[0], pair[1]].map(|point| point.seconds);
                if frame_at(earlier, frames) == frame_at(later, frames) {
                    return Err(PlaceError::SameFrame { earlier, later });
                }
            }
        }
        for (index, reach) in self.reaches.iter().enumerate() {
            let same = self.reaches[..index].iter().find(|other| {
                other.part() == reach.part()
                    && frame_at(other.seconds(), frames) == frame_at(reach.seconds(), frames)
            });
            if let Some(other) = same {
                return Err(PlaceError::Twice {
                    first: *other,
                    second: *reach,
                });
            }
        }
        for (index, pose) in self.poses.iter().enumerate() {
            let frame = |pose: &KeyPose| frame_at(pose.seconds(), frames);
            let mut earlier = self.poses[..index].iter();
            if let Some(other) = earlier.find(|other| frame(other) == frame(pose)) {
                return Err(PlaceError::TwoPoses {
                    first: other.seconds(),
                    second: pose.seconds(),
                });
            }
        }
        Ok(())
    }

    /// Returns the places where they are in a motion with known frames, in which they are counted from an origin.
    pub(crate) fn counted_from(&self, origin: Option<&PlaceOrigin>) -> Cow<'_, Places> {
        match origin {
            Some(origin) => Cow::Owned(origin.places(self)),
            None => Cow::Borrowed(self),
        }
    }

    /// Returns the terms of the loss for a motion of `frames` frames. In a motion with known frames, places are counted from an
    /// origin.
    pub fn terms(&self, origin: Option<&PlaceOrigin>, frames: usize) -> Vec<Arc<dyn LossTerm>> {
        let places = self.counted_from(origin);
        let mut all: Vec<Arc<dyn LossTerm>> = Vec::new();
        if let Some(path) = &places.path {
            all.push(Arc::new(terms::PathTerm::new(path, frames)));
            if let Some(directions) = root_plan::directions(path, places.facing, origin, frames) {
                all.push(Arc::new(terms::FacingTerm::new(directions)));
            }
        }
        for reach in &places.reaches {
            all.push(Arc::new(terms::ReachTerm::new(*reach, frames)));
        }
        for pose in &places.poses {
            all.push(Arc::new(terms::PoseTerm::new(pose.clone(), frames)));
        }
        all
    }

    /// Returns the frames of a motion of `frames` frames that have a place.
    pub(crate) fn frames(&self, frames: usize) -> Vec<usize> {
        let moments = self.moments();
        moments.map(|seconds| frame_at(seconds, frames)).collect()
    }

    /// Returns the moments of all places in seconds.
    fn moments(&self) -> impl Iterator<Item = f32> {
        let waypoints = self.path.iter().flat_map(GroundPath::waypoints);
        { waypoints.map(|point| point.seconds) }
            .chain(self.reaches.iter().map(Reach::seconds))
            .chain(self.poses.iter().map(KeyPose::seconds))
    }

    /// Measures how near a motion comes to each place, in the order of the path, of the reaches and of the poses.
    pub fn outcomes(&self, motion: &Motion) -> Vec<PlaceOutcome> {
        outcomes_of(self, motion.joints())
    }

    /// Measures how near a motion with known frames comes to each place, as [`outcomes`](Self::outcomes) does: with positions and
    /// moments from an origin.
    pub fn outcomes_from(
        &self,
        origin: Option<&PlaceOrigin>,
        motion: &Motion,
    ) -> Vec<PlaceOutcome> {
        match origin {
            Some(origin) => outcomes_of(&origin.asked(self), &origin.seen(motion.joints())),
            None => self.outcomes(motion),
        }
    }

    /// Returns what is unusual about the places, in sentences: ways that are faster than people run, and positions that no body
    /// reaches from the ground.
    pub fn notices(&self) -> Vec<String> {
        notices::notices(self)
    }
}

/// Measures the places of a whole motion, whose poses are joint positions in metres.
fn outcomes_of(places: &Places, poses: &[[[f32; 3]; JOINTS]]) -> Vec<PlaceOutcome> {
    outcome::outcomes(places, poses, |seconds| {
        Some(frame_at(seconds, poses.len()))
    })
}

/// Returns the frame of a moment.
fn frame_of(seconds: f32) -> usize {
    (seconds * FRAMES_PER_SECOND).round() as usize
}

/// Returns the frame of a moment in a motion of `frames` frames. The end of a motion is its last frame.
pub(crate) fn frame_at(seconds: f32, frames: usize) -> usize {
    frame_of(seconds).min(frames.saturating_sub(1))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn places(path: &str, reaches: &[&str]) -> Places {
        Places {
            path: (!path.is_empty()).then(|| path.parse().unwrap()),
            reaches: reaches.iter().map(|text| text.parse().unwrap()).collect(),
            ..Places::default()
        }
    }

    #[test]
    fn the_end_of_a_motion_is_its_last_frame() {
        assert_eq!(places("0:0,0 3:0,2", &["head@3=0,1.2,2"]).check(60), Ok(()));
        assert_eq!(
            [0.0, 1.5, 2.95, 3.0].map(|t| frame_at(t, 60)),
            [0, 30, 59, 59]
        );
    }

    #[test]
    fn places_that_a_motion_cannot_have_are_named() {
        for (places, parts) in [
            (places("0:0,0 3.2:0,2", &[]), &["3.2 s", "0 to 3 s"][..]),
            (places("", &["head@4=0,1,0"]), &["4 s", "0 to 3 s"]),
            (
                places("1:0,1 1.01:0,2", &[]),
                &["1 s", "1.01 s", "same frame"],
            ),
            (places("2.95:0,1 3:0,2", &[]), &["2.95 s", "3 s"]),
            (
                places(
                    "",
                    &["head@1=0,1,0", "left-hand@1=0,1,0", "head@1.01=0,2,0"],
                ),
                &["head@1=0,1,0", "head@1.01=0,2,0"],
            ),
        ] {
            let message = places.check(60).unwrap_err().to_string();
            for part in parts {
                assert!(message.contains(part), "{message}");
            }
        }
    }
}
