//! Conversion of a clip of any skeleton to a motion.

use std::path::Path;

use glam::{DQuat, DVec3};
use lamogen_motion::{FRAMES_PER_SECOND, JOINTS, Joint, JointTurning, Motion};

use crate::body::MappedBody;
use crate::clip::Clip;
use crate::error::ReadError;
use crate::mapping::JointMapping;
use crate::names::recognise;
use crate::plausibility::{ImportNotice, notices};
use crate::schemes::JointNodes;
use crate::units::{Unit, UpAxis};

/// Known properties of a file. Properties that are `None` are guessed from the body, and [`ImportedMotion`] reports
/// the guesses.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ReadOptions {
    /// The unit of lengths in the file.
    pub unit: Option<Unit>,
    /// The axis of the file that points up.
    pub up: Option<UpAxis>,
    /// The name of each joint in the file, if the skeleton is not a known one.
    pub mapping: Option<JointMapping>,
    /// The animation to read: of a glTF by its name, of an array of several motions by its number from 0. By default
    /// the first one.
    pub animation: Option<String>,
    /// The frame rate of the file, which replaces the one that a BVH states. An array states none and is otherwise read
    /// at 20 frames per second. A glTF has times instead of frames and ignores this option.
    pub frames_per_second: Option<f32>,
}

/// A motion from a file, and the assumptions under which it was read.
#[derive(Clone, Debug, PartialEq)]
pub struct ImportedMotion {
    /// The motion, in metres, Y up, at 20 frames per second. It keeps its position and direction from the file.
    pub motion: Motion,
    /// The turning speed of the joints, measured on the file's own rotations, because the motion keeps only positions.
    /// `None` for arrays. It is measured at 20 frames per second, so a turn forth and back between two such frames is not
    /// measured.
    ///
    /// A joint that was [`placed`](Self::placed) does not turn. Rotations of the file's nodes above it count for the next
    /// joint below.
    pub turning: Option<JointTurning>,
    /// The naming scheme of the file's joints: a known scheme, `mapping file`, or `VRM animation` if the file itself says which
    /// nodes are its human bones. `None` for arrays.
    pub scheme: Option<&'static str>,
    /// The unit of lengths in the file.
    pub unit: Unit,
    /// The axis of the file that points up.
    pub up: UpAxis,
    /// The file's frame rate.
    pub source_frames_per_second: f64,
    /// The file's number of frames.
    pub source_frames: usize,
    /// The number of frames that the file announces, if it actually has more or fewer.
    pub announced_frames: Option<usize>,
    /// The names of the animations in the file that were not read. A glTF may hold several animations;
    /// [`ReadOptions::animation`] selects one.
    pub other_animations: Vec<String>,
    /// The joints that the file lacks, or has at the same position as another joint. Their positions are computed from
    /// the other joints:
    ///
    /// - spine joints lie on the line from the pelvis to the neck through the file's nodes between them, at the same
    ///   fractions of its length as on HumanML3D's body (if the file has exactly three nodes there, these are the spine);
    /// - the neck lies on the line from the upper spine to the head, the head beyond the neck;
    /// - collars lie between upper spine, neck and shoulder;
    /// - feet lie on the line from the ankle to the end of the foot, at most as far as the ball of the foot; if the file
    ///   has no end of the foot, they lie in front of the ankle.
    pub placed: Vec<Joint>,
    /// Unusual properties of the motion, which may be intended.
    pub notices: Vec<ImportNotice>,
}

/// The length of the longest motion that is read: one hour, in seconds.
const MAX_SECONDS: f64 = 3600.0;

/// Converts a clip to a motion. `path` is used only in error messages.
///
/// The joints are found by the mapping of the options, or else are the `known` ones, with the name of their scheme, or else
/// are recognised by the names of the nodes.
pub(crate) fn import(
    clip: &Clip,
    known: Option<(&'static str, JointNodes)>,
    options: &ReadOptions,
    path: &Path,
) -> Result<ImportedMotion, ReadError> {
    let (scheme, nodes) = match (&options.mapping, known) {
        (Some(mapping), _) => {
            let nodes = mapping.nodes(clip).map_err(|reason| ReadError::Mapping {
                path: path.to_owned(),
                reason,
            })?;
            ("mapping file", nodes)
        }
        (None, Some(known)) => known,
        (None, None) => recognise(clip).map_err(|reason| ReadError::Skeleton {
            path: path.to_owned(),
            reason,
        })?,
    };
    let body = MappedBody::new(clip, nodes);
    let rate = options
        .frames_per_second
        .map_or_else(|| frame_rate(clip), f64::from);
    let seconds = (clip.frames - 1) as f64 / rate;
    if seconds > MAX_SECONDS {
        return Err(ReadError::Long {
            path: path.to_owned(),
            seconds,
        });
    }
    let frames = frame_count(seconds);
    let (poses, rotations): (Vec<_>, Vec<_>) = (0..frames)
        .map(|frame| {
            let source_frame = frame as f64 / f64::from(FRAMES_PER_SECOND) * rate;
            let node_poses = clip.node_poses(source_frame * clip.seconds_per_frame);
            let (positions, rotations): (Vec<DVec3>, Vec<DQuat>) = { node_poses.into_iter() }
                .map(|node| (node.position, node.rotation))
                .unzip();
            (body.pose(&positions), body.local_rotations(&rotations))
        })
        .unzip();
    let size = body.size(&clip.positions(0.0));
    let unit = options.unit.or_else(|| Unit::of_body(size));
    let unit = unit.ok_or_else(|| ReadError::Size {
        path: path.to_owned(),
        size,
    })?;
    let up = options
        .up
        .unwrap_or_else(|| guess_up(&body.pose(&clip.rest_positions()), &poses));
    let joints = poses
        .iter()
        .map(|pose| pose.map(|place| (up.to_y_up(place) * unit.metres()).as_vec3().to_array()))
        .collect();
    let motion = Motion::from_joints(joints).map_err(|reason| ReadError::Motion {
        path: path.to_owned(),
        reason,
    })?;
    Ok(ImportedMotion {
        notices: notices(&motion),
        motion,
        turning: Some(JointTurning::of_local(&rotations)),
        scheme: Some(scheme),
        unit,
        up,
        source_frames_per_second: rate,
        source_frames: clip.frames,
        announced_frames: None,
        other_animations: Vec::new(),
        placed: body.placed_joints(),
    })
}

/// Returns the number of frames at [`FRAMES_PER_SECOND`] within a duration, including the frame at time 0.
pub(crate) fn frame_count(seconds: f64) -> usize {
    // The tolerance is half a thousandth of a frame, because files often round the frame time to a few digits.
    (seconds * f64::from(FRAMES_PER_SECOND) + 5e-4) as usize + 1
}

/// Returns the frame rate of a clip, rounded to an integer if it is close to one: 0.0083333 s per frame are 120 frames
/// per second.
fn frame_rate(clip: &Clip) -> f64 {
    if clip.seconds_per_frame <= 0.0 {
        return f64::from(FRAMES_PER_SECOND);
    }
    let rate = 1.0 / clip.seconds_per_frame;
    match (rate - rate.round()).abs() < 1e-4 * rate {
        true => rate.round(),
        false => rate,
    }
}

/// Guesses the axis that points up: the axis along which the body stands in the rest pose, unless the body stands along
/// the other axis throughout the motion. If the body does not stand in the rest pose, as in files that have all bones
/// along one axis, the motion alone decides.
pub(crate) fn guess_up(rest: &[DVec3; JOINTS], poses: &[[DVec3; JOINTS]]) -> UpAxis {
    let moving = poses.iter().map(body_axis).sum::<DVec3>() / poses.len() as f64;
    let rest_up = match body_axis(rest) {
        rest if rest.y > 0.9 => Some(UpAxis::Y),
        rest if rest.z > 0.9 => Some(UpAxis::Z),
        _ => None,
    };
    match rest_up {
        Some(UpAxis::Y) if moving.z > 0.85 => UpAxis::Z,
        Some(UpAxis::Z) if moving.y > 0.85 => UpAxis::Y,
        Some(up) => up,
        None if moving.z > moving.y => UpAxis::Z,
        None => UpAxis::Y,
    }
}

/// Returns the direction from the ankles over the pelvis to the head: the mean of the unit vectors along the legs and
/// along the trunk. It is shorter than 1 if the body is bent.
fn body_axis(pose: &[DVec3; JOINTS]) -> DVec3 {
    let at = |joint: Joint| pose[joint.index()];
    let ankles = at(Joint::LeftAnkle).midpoint(at(Joint::RightAnkle));
    let pelvis = at(Joint::Pelvis);
    let legs = (pelvis - ankles).normalize_or_zero();
    let trunk = (at(Joint::Head) - pelvis).normalize_or_zero();
    legs.midpoint(trunk)
}
