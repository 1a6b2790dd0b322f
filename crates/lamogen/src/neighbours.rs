//! The motions before and after a generated one.
//!
//! ```text
//! clip ──on HumanML3D's body──▶ its last 0.4 seconds ──▶ pose features: the first frames that the network sees
//!                                              └──▶ rotations: the first frames of the body's fit
//!                                              └──▶ where it stands at its end: where the new motion begins
//! ```

use std::sync::Arc;

use lamogen_motion::{
    BodyError, JOINTS, Motion, POSE_FEATURES, Placement, RestPose, Rotations, encode,
};

use crate::error::RequestError;

/// The number of frames of a clip that a network without windows sees: 0.4 seconds. With two seconds, joins are as smooth, but the
/// network goes on with what these frames do instead of what the sentence says: of those who stand, none kicks.
pub(crate) const KNOWN_FRAMES: usize = 8;

/// What a generated motion continues.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Predecessor {
    /// A motion of any body.
    Clip(Arc<Motion>),
    /// The stretch before, of the same generated motion.
    Stretch(Arc<StretchEnd>),
}

impl Predecessor {
    /// Returns the joint positions of the last frames in metres, as many as a network sees, where the guided motion is.
    pub(crate) fn last_frames(&self) -> &[[[f32; 3]; JOINTS]] {
        let joints = match self {
            Predecessor::Clip(clip) => clip.joints(),
            Predecessor::Stretch(end) => end.guided.joints(),
        };
        &joints[joints.len().saturating_sub(KNOWN_FRAMES)..]
    }
}

/// The last frames of a stretch of a generated motion, where it stands.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct StretchEnd {
    /// The motion of the text alone.
    pub(crate) baseline: Motion,
    /// The guided motion, which may be elsewhere by now.
    pub(crate) guided: Motion,
    /// Whether other goals hold from here on, which then set in gradually.
    pub(crate) changes_goals: bool,
}

/// The ends of the motions that the two passes continue.
#[derive(Clone, Debug)]
pub(crate) struct KnownStarts {
    pub(crate) baseline: KnownStart,
    /// The end for the second pass, where it is another one.
    guided: Option<KnownStart>,
}

impl KnownStarts {
    /// Takes the last frames of what is continued: so many, or as many as it has.
    ///
    /// # Errors
    ///
    /// If it has fewer than `least` frames.
    pub(crate) fn of(
        predecessor: &Predecessor,
        frames: usize,
        least: usize,
    ) -> Result<KnownStarts, RequestError> {
        Ok(match predecessor {
            Predecessor::Clip(clip) => KnownStarts {
                baseline: KnownStart::of(clip, None, frames, least)?,
                guided: None,
            },
            // A generated motion is on the ground at height 0, also in the middle of a jump.
            Predecessor::Stretch(end) => KnownStarts {
                baseline: KnownStart::of(&end.baseline, Some(0.0), frames, least)?,
                guided: Some(KnownStart::of(&end.guided, Some(0.0), frames, least)?),
            },
        })
    }

    /// Whether the two passes continue different frames.
    pub(crate) fn differ(&self) -> bool {
        self.guided.is_some()
    }

    /// Returns the end that the second pass continues.
    pub(crate) fn guided(&self) -> &KnownStart {
        self.guided.as_ref().unwrap_or(&self.baseline)
    }
}

/// The end of a motion that another one continues.
#[derive(Clone, Debug)]
pub(crate) struct KnownStart {
    /// The pose features of the last frames.
    pub(crate) features: Vec<[f32; POSE_FEATURES]>,
    /// The rotations of the last frames, where these pose features are.
    pub(crate) rotations: Rotations,
    /// Where the clip stands at its end.
    placement: Placement,
}

impl KnownStart {
    /// Takes the last frames of a clip: so many, or as many as it has. Without a height of the ground, it is estimated.
    ///
    /// # Errors
    ///
    /// If the clip has fewer than `least` frames, or shows no body.
    fn of(
        clip: &Motion,
        ground: Option<f64>,
        frames: usize,
        least: usize,
    ) -> Result<KnownStart, RequestError> {
        let (features, rotations) = features_on_body(clip, ground, least)?;
        let all = features.len();
        let known = all - frames.min(all)..all;
        let features = features[known.clone()].to_vec();
        let rotations = rotations.between(known);
        let decoded = Motion::from_pose_features(features.clone());
        let decoded = decoded.map_err(|_| RequestError::Prefix {
            expected: least,
            found: clip.frames(),
        })?;
        let last = |poses: &[[[f32; 3]; JOINTS]]| Placement::of(&poses[poses.len() - 1]);
        let own = last(&rotations.joints());
        Ok(KnownStart {
            rotations: own.to(&last(decoded.joints())).of_rotations(&rotations),
            features,
            placement: last(clip.joints()),
        })
    }

    /// Returns by how much a motion that goes on from these frames is turned when it is put where the clip stands at its end, in
    /// radians to the left.
    pub(crate) fn heading(&self) -> f32 {
        (self.placement.heading() - self.end().heading()) as f32
    }

    /// Moves a motion that goes on from these frames to where the clip stands at its end.
    pub(crate) fn carry_on(&self, rotations: &Rotations) -> Rotations {
        self.end().to(&self.placement).of_rotations(rotations)
    }

    /// Returns where the known frames stand at their end.
    fn end(&self) -> Placement {
        let last = self.rotations.joints().last().map(Placement::of);
        last.expect("there are known frames")
    }
}

/// Returns the pose features of the first frames of a clip: so many, or as many as it has.
///
/// # Errors
///
/// If the clip has fewer than 2 frames, or shows no body.
pub(crate) fn known_end(
    clip: &Motion,
    frames: usize,
) -> Result<Vec<[f32; POSE_FEATURES]>, RequestError> {
    let (features, _) = features_on_body(clip, None, 2)?;
    Ok(features[..frames.min(features.len())].to_vec())
}

/// Puts a pose of a clip on HumanML3D's body, on the ground at height 0.
///
/// # Errors
///
/// If the clip shows no body.
pub(crate) fn pose_on_body(clip: &Motion, frame: usize) -> Result<[[f32; 3]; JOINTS], BodyError> {
    let rotations = on_body(clip, None)?;
    Ok(rotations.between(frame..frame + 1).joints()[0])
}

/// Puts a clip on HumanML3D's body, with the ground, whose height is estimated if it is not given, at height 0, and the first pose at the origin, facing +Z. Returns its pose
/// features, a row for each frame, and its rotations.
fn features_on_body(
    clip: &Motion,
    ground: Option<f64>,
    least: usize,
) -> Result<(Vec<[f32; POSE_FEATURES]>, Rotations), RequestError> {
    if clip.frames() < least.max(2) {
        return Err(RequestError::Prefix {
            expected: least.max(2),
            found: clip.frames(),
        });
    }
    let rotations = on_body(clip, ground)?;
    let joints = rotations.joints();
    // A row describes a step, and the heading of the first row is special, so the clip gets a frame more at each end.
    let extrapolate = |from: &[[f32; 3]; JOINTS], to: &[[f32; 3]; JOINTS]| {
        std::array::from_fn(|joint| {
            std::array::from_fn(|axis| 2.0 * to[joint][axis] - from[joint][axis])
        })
    };
    let count = joints.len();
    let before = extrapolate(&joints[1], &joints[0]);
    let after = extrapolate(&joints[count - 2], &joints[count - 1]);
    let rows = encode(&[&[before], &joints[..], &[after]].concat());
    Ok((rows[1..=count].to_vec(), rotations))
}

/// Puts a clip on HumanML3D's body, as [`features_on_body`] does.
///
/// # Errors
///
/// If the clip shows no body.
fn on_body(clip: &Motion, ground: Option<f64>) -> Result<Rotations, BodyError> {
    clip.check_body()?;
    let body = RestPose::humanml3d();
    let rotations = clip.rotations().on(&body);
    let rotations = rotations.between(0..rotations.frames());
    let ground = ground.unwrap_or_else(|| {
        Motion::from_rotations(rotations.clone())
            .map(|motion| lamogen_body::ground(&motion))
            .unwrap_or(0.0)
    });
    let root = rotations.root().iter();
    let root = root.map(|[x, y, z]| [*x, (f64::from(*y) - ground) as f32, *z]);
    let rotations = Rotations::new(
        body,
        root.collect(),
        rotations.local().to_vec(),
        rotations.frames_per_second(),
    );
    let first = Placement::of(&rotations.joints()[0]);
    Ok(first.to(&Placement::ORIGIN).of_rotations(&rotations))
}

#[cfg(test)]
mod tests {
    use super::*;
    use lamogen_motion::FRAMES_PER_SECOND;

    /// A body that walks a curve on stiff legs.
    fn clip(frames: usize) -> Motion {
        let turn = |frame: usize| 2.0 + 0.05 * frame as f32;
        let local = (0..frames).map(|frame| {
            let mut pose = [[0.0, 0.0, 0.0, 1.0]; JOINTS];
            let half = turn(frame) / 2.0;
            pose[0] = [0.0, half.sin(), 0.0, half.cos()];
            let swing = 0.5 * (0.2 * frame as f32).sin();
            pose[16] = [0.0, 0.0, swing.sin(), swing.cos()];
            pose
        });
        let root = (0..frames).map(|frame| [3.0 - 0.02 * frame as f32, 1.0, 0.03 * frame as f32]);
        let rotations = Rotations::new(
            RestPose::humanml3d(),
            root.collect(),
            local.collect(),
            FRAMES_PER_SECOND,
        );
        Motion::from_rotations(rotations).unwrap()
    }

    #[test]
    fn features_and_rotations_of_the_end_are_at_one_place() {
        let clip = clip(50);
        let start = KnownStart::of(&clip, None, 20, 2).unwrap();
        let decoded = Motion::from_pose_features(start.features.clone()).unwrap();
        let rigid = Motion::from_rotations(start.rotations.clone()).unwrap();
        assert_eq!((decoded.frames(), rigid.frames()), (20, 20));
        assert!(
            decoded.distance(&rigid) < 2e-3,
            "{}",
            decoded.distance(&rigid)
        );
        // What goes on from there is where the clip ends, but for the height of the ground.
        let back = Motion::from_rotations(start.carry_on(&start.rotations)).unwrap();
        let (ends, own) = (clip.joints()[49], back.joints()[19]);
        for (expected, found) in ends.iter().zip(own) {
            assert!((expected[0] - found[0]).abs() < 1e-3);
            assert!((expected[2] - found[2]).abs() < 1e-3);
        }
    }

    #[test]
    fn a_single_frame_continues_nothing() {
        let message = KnownStart::of(&clip(1), None, 20, 2)
            .unwrap_err()
            .to_string();
        assert!(message.contains("at least 2 frames") && message.contains("found 1"));
        assert!(known_end(&clip(1), 20).is_err());
        assert_eq!(known_end(&clip(30), 20).unwrap().len(), 20);
    }
}
