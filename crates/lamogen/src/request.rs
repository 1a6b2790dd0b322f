//! Requests: the prompt, the length, the goals and the options of a motion to generate.

use std::sync::Arc;

use lamogen_guide::{
    Facing, GroundPath, Guidance, KeyPose, LossTerm, LossTerms, PlaceError, Places, Preset, Reach,
};
use lamogen_laban::{Component, Goal, Goals, LabanSeries, PartScale, Tag};
use lamogen_motion::{FRAMES_PER_SECOND, Motion, RootMotion};

use crate::error::RequestError;
use crate::neighbours::{Predecessor, pose_on_body};

/// The length of a motion to generate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Length {
    /// In seconds, rounded to frames.
    Seconds(f32),
    /// In frames, 20 a second.
    Frames(usize),
}

/// A motion to generate: a sentence, and how the motion shall differ from the one that the sentence alone
/// gives.
///
/// ```
/// use lamogen::{Request, Tag};
///
/// let request = Request::new("a person waves with the right hand")
///     .tags([Tag::Light, Tag::Sustained])
///     .seconds(4.0)
///     .seed(7);
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Request {
    pub(crate) prompt: String,
    pub(crate) length: Length,
    pub(crate) seed: u64,
    pub(crate) tags: Vec<Tag>,
    pub(crate) goals: Option<Goals>,
    pub(crate) parts: Vec<PartScale>,
    pub(crate) preset: Option<Preset>,
    pub(crate) steps: Option<usize>,
    pub(crate) guidance: Option<Guidance>,
    pub(crate) loss_terms: LossTerms,
    pub(crate) places: Places,
    pub(crate) is_looped: bool,
    pub(crate) root_motion: RootMotion,
    /// The requests that follow this one in the same motion, which have none of their own.
    pub(crate) following: Vec<Request>,
    /// The motion that this one continues.
    pub(crate) after: Option<Predecessor>,
    /// The motion that this one leads to.
    pub(crate) before: Option<Arc<Motion>>,
    /// The number of frames that are made after those that are requested, and left out: where a motion goes on, its last frames do
    /// not move as if they were the end.
    pub(crate) ahead: usize,
}

impl Request {
    /// The length of the longest prompt in characters: several times as many as the text encoders of text-to-motion
    /// networks read.
    pub const LONGEST_PROMPT: usize = 2000;

    /// The length of the longest motion in frames: an hour.
    pub const LONGEST_MOTION: usize = 72_000;

    /// Makes a request for a motion of 3 seconds with seed 0 and no tags.
    pub fn new(prompt: impl Into<String>) -> Self {
        Request {
            prompt: prompt.into(),
            length: Length::Seconds(3.0),
            seed: 0,
            tags: Vec::new(),
            goals: None,
            parts: Vec::new(),
            preset: None,
            steps: None,
            guidance: None,
            loss_terms: LossTerms::default(),
            places: Places::default(),
            is_looped: false,
            root_motion: RootMotion::default(),
            following: Vec::new(),
            after: None,
            before: None,
            ahead: 0,
        }
    }

    /// Sets the length in seconds.
    pub fn seconds(self, seconds: f32) -> Self {
        self.length(Length::Seconds(seconds))
    }

    /// Sets the length in frames.
    pub fn frames(self, frames: usize) -> Self {
        self.length(Length::Frames(frames))
    }

    /// Sets the length.
    pub fn length(self, length: Length) -> Self {
        Request { length, ..self }
    }

    /// Sets the seed of the start noise. The same seed gives the same motion.
    pub fn seed(self, seed: u64) -> Self {
        Request { seed, ..self }
    }

    /// Adds a tag.
    pub fn tag(mut self, tag: Tag) -> Self {
        self.tags.push(tag);
        self
    }

    /// Adds tags, at most one for each component.
    pub fn tags(mut self, tags: impl IntoIterator<Item = Tag>) -> Self {
        self.tags.extend(tags);
        self
    }

    /// Sets the factors on the four components, instead of tags: a [`Scale`](lamogen_laban::Scale) for the
    /// whole motion, a [`ScaleCurve`](lamogen_laban::ScaleCurve) over time, or all [`Goals`] at once.
    pub fn scale(self, goals: impl Into<Goals>) -> Self {
        Request {
            goals: Some(goals.into()),
            ..self
        }
    }

    /// Sets the goal of a component, instead of a tag: a factor, a peak or a mean in the unit of the component, a
    /// series, or [`Goal::Any`], which leaves the component free.
    ///
    /// ```
    /// use lamogen::{Component, Goal, Request};
    ///
    /// let request = Request::new("a person jumps")
    ///     .goal(Component::Shape, Goal::Peak(1.4))
    ///     .goal(Component::Flow, Goal::Any);
    /// ```
    pub fn goal(self, component: Component, goal: impl Into<Goal>) -> Self {
        let goals = self.goals.clone().unwrap_or_default();
        self.scale(goals.with(component, goal))
    }

    /// Sets the Laban features of another motion as the goals. That motion may have any length: its features are
    /// stretched to the length of this one. Other goals may be set afterwards.
    pub fn like(self, series: &LabanSeries) -> Self {
        self.scale(Goals::like(series))
    }

    /// Gives a part of the body factors of its own on Weight, Time and Flow.
    ///
    /// ```
    /// use lamogen::{BodyPart, PartScale, Request, Tag};
    ///
    /// let request = Request::new("a person walks forward")
    ///     .part(PartScale::new(BodyPart::Arms).tag(Tag::Strong)?)
    ///     .part(PartScale::new(BodyPart::Legs).tag(Tag::Light)?);
    /// # Ok::<(), lamogen::laban::GoalError>(())
    /// ```
    pub fn part(mut self, part: PartScale) -> Self {
        self.parts.push(part);
        self
    }

    /// Sets steps and guidance together; each can still be set separately.
    pub fn preset(self, preset: Preset) -> Self {
        Request {
            preset: Some(preset),
            ..self
        }
    }

    /// Sets the steps of each pass: 1 to 1000, or to as many timesteps as the model was trained with.
    pub fn steps(self, steps: usize) -> Self {
        Request {
            steps: Some(steps),
            ..self
        }
    }

    /// Adds a goal of your own: a term of the loss that guidance lowers, beside the tags or without any
    /// (`docs/own-goal.md` has an example: a hand at a place).
    pub fn loss_term(self, term: Arc<dyn LossTerm>) -> Self {
        Request {
            loss_terms: self.loss_terms.with(term),
            ..self
        }
    }

    /// Sets the path that the pelvis takes along the ground, in metres from where the motion starts. The body faces along the
    /// path, unless [`facing`](Self::facing) says otherwise.
    ///
    /// ```
    /// use lamogen::Request;
    ///
    /// // A metre to the left within two seconds, then two metres forward.
    /// let request = Request::new("a person walks").seconds(4.0).path("0:0,0 2:1,0 4:1,2".parse()?);
    /// # Ok::<(), lamogen::PlaceError>(())
    /// ```
    pub fn path(mut self, path: GroundPath) -> Self {
        self.places.path = Some(path);
        self
    }

    /// Sets where the body faces on its path.
    pub fn facing(mut self, facing: Facing) -> Self {
        self.places.facing = facing;
        self
    }

    /// Adds a position that a part of the body reaches, in metres from where the motion starts.
    ///
    /// ```
    /// use lamogen::Request;
    ///
    /// let request = Request::new("a person raises the right arm")
    ///     .reach("right-hand@1.5=-0.3,1.6,0.5".parse()?);
    /// # Ok::<(), lamogen::PlaceError>(())
    /// ```
    pub fn reach(mut self, reach: Reach) -> Self {
        self.places.reaches.push(reach);
        self
    }

    /// Adds a pose that the body takes at a moment, in seconds from the start: that of a frame of a motion, on any body. Where the body is then and where
    /// it faces is not decided by this.
    ///
    /// # Errors
    ///
    /// If the moment is not a finite number of at least 0, a position is out of range, or the motion shows no body.
    ///
    /// # Panics
    ///
    /// If the motion does not have the frame.
    pub fn pose(self, seconds: f32, motion: &Motion, frame: usize) -> Result<Self, PlaceError> {
        let frames = motion.frames();
        assert!(
            frame < frames,
            "expected one of {frames} frames, found {frame}"
        );
        Ok(self.key_pose(KeyPose::new(seconds, pose_on_body(motion, frame)?)?))
    }

    /// Adds a pose that the body takes, on the body of the generated motions; [`pose`](Self::pose) takes one of any body.
    pub fn key_pose(mut self, pose: KeyPose) -> Self {
        self.places.poses.push(pose);
        self
    }

    /// Sets all places at once: the path, where the body faces on it, the positions that parts of the body reach, and poses.
    pub fn places(self, places: Places) -> Self {
        Request { places, ..self }
    }

    /// Sets whether the motion is a loop: its last frame leads into the first, in pose and velocity, and the body faces
    /// at the end as at the beginning. A loop may travel ([`Motion::loop_travel`]).
    ///
    /// ```
    /// use lamogen::{Request, RootMotion, Tag};
    ///
    /// // A walk cycle for a game, which moves the character itself.
    /// let request = Request::new("a person walks forward")
    ///     .tag(Tag::Light)
    ///     .looped(true)
    ///     .root_motion(RootMotion::None);
    /// ```
    pub fn looped(self, is_looped: bool) -> Self {
        Request { is_looped, ..self }
    }

    /// Sets where files of the motion keep its travel along the ground: in the hips (the default), in a root node above
    /// them, or nowhere.
    pub fn root_motion(self, root_motion: RootMotion) -> Self {
        Request {
            root_motion,
            ..self
        }
    }

    /// Adds what comes next in the same motion: a sentence with its own length and its own goals, which may be tags, factors
    /// over time and parts of the body. The motion is as long as all of them together, and goes from each to the next without
    /// a stop.
    ///
    /// Seed, steps, guidance and all other options are those of the first request; one that follows may not state any.
    /// A model that makes a motion a window at a time, such as DiP, changes its sentence from one window to the next.
    ///
    /// ```
    /// use lamogen::{Request, Tag};
    ///
    /// let request = Request::new("a person walks forward")
    ///     .seconds(3.0)
    ///     .then(Request::new("a person jumps").seconds(2.0).tag(Tag::Strong))
    ///     .then(Request::new("a person walks forward").seconds(3.0).tag(Tag::Light));
    /// ```
    pub fn then(mut self, request: impl Into<Request>) -> Self {
        let mut next = request.into();
        let after = std::mem::take(&mut next.following);
        self.following.push(next);
        self.following.extend(after);
        self
    }

    /// Sets the motion that this one continues. The first frame follows the last one of that motion, in pose and velocity and,
    /// unless the body is [`Body::Network`](lamogen_guide::Body::Network), where it stands there and facing as it does. The network
    /// sees the last 0.4 seconds; a model that makes a motion a window at a time sees as many frames as it has learnt to, and without
    /// a motion to continue it continues a body that stands still.
    ///
    /// That motion may be of any body; it is continued by the body of all generated motions, on a ground at height 0.
    pub fn after(self, motion: &Motion) -> Self {
        Request {
            after: Some(Predecessor::Clip(Arc::new(motion.clone()))),
            ..self
        }
    }

    /// Sets the motion that this one leads to: its first frame follows the last one of this motion, in pose and velocity. With
    /// [`after`](Self::after), the motion goes from the one to the other. Where the body ends is not decided by this.
    pub fn before(self, motion: &Motion) -> Self {
        Request {
            before: Some(Arc::new(motion.clone())),
            ..self
        }
    }

    /// Sets the options of the guided pass.
    pub fn guidance(self, guidance: Guidance) -> Self {
        Request {
            guidance: Some(guidance),
            ..self
        }
    }
}

/// Makes a request for a motion of 3 seconds with this sentence.
impl From<&str> for Request {
    fn from(prompt: &str) -> Self {
        Request::new(prompt)
    }
}

impl From<String> for Request {
    fn from(prompt: String) -> Self {
        Request::new(prompt)
    }
}

impl Request {
    /// Returns the request and those that follow it in the same motion.
    pub(crate) fn sentences(&self) -> impl Iterator<Item = &Request> {
        [self].into_iter().chain(&self.following)
    }

    /// Returns the request without its places.
    pub(crate) fn without_places(self) -> Request {
        let without = |guidance: Guidance| Guidance {
            places: Places::default(),
            ..guidance
        };
        Request {
            places: Places::default(),
            guidance: self.guidance.map(without),
            ..self
        }
    }

    /// Returns whether the request states nothing but a sentence, a length and goals.
    pub(crate) fn is_segment(&self) -> bool {
        let others = Request {
            prompt: String::new(),
            length: Request::new("").length,
            tags: Vec::new(),
            goals: None,
            parts: Vec::new(),
            ..self.clone()
        };
        others == Request::new("")
    }
}

impl Length {
    /// Returns the length in frames, if a model can generate motions of this length.
    pub(crate) fn frames(self, shortest: usize, longest: usize) -> Result<usize, RequestError> {
        let frames = match self {
            Length::Frames(frames) => Some(frames),
            Length::Seconds(seconds) if seconds.is_finite() && seconds >= 0.0 => {
                Some((seconds * FRAMES_PER_SECOND).round() as usize)
            }
            Length::Seconds(_) => None,
        };
        // A motion has at least one frame, whatever the network states.
        let shortest = shortest.max(1);
        match frames {
            Some(frames) if (shortest..=longest).contains(&frames) => Ok(frames),
            _ => Err(RequestError::Length {
                found: self,
                shortest,
                longest,
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seconds_become_frames() {
        assert_eq!(Length::Seconds(3.0).frames(40, 196).unwrap(), 60);
        assert_eq!(Length::Seconds(9.8).frames(40, 196).unwrap(), 196);
        assert_eq!(Length::Frames(40).frames(40, 196).unwrap(), 40);
    }

    #[test]
    fn lengths_that_the_model_cannot_generate_are_refused() {
        for length in [
            Length::Frames(0),
            Length::Frames(39),
            Length::Frames(197),
            Length::Seconds(0.0),
            Length::Seconds(-3.0),
            Length::Seconds(f32::NAN),
            Length::Seconds(f32::INFINITY),
            Length::Seconds(1e30),
        ] {
            let message = length.frames(40, 196).unwrap_err().to_string();
            assert!(message.contains("40 to 196 frames"), "{message}");
            assert!(message.contains("2.0 to 9.8 s"), "{message}");
        }
    }
}
