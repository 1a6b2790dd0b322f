//! A clip of any skeleton as a motion.

use std::path::Path;

use glam::{DQuat, DVec3};
use lamogen_motion::{FRAMES_PER_SECOND, JOINTS, Joint, JointTurning, Motion};

use crate::body::Body;
use crate::clip::Clip;
use crate::error::ReadError;
use crate::mapping::JointMapping;
use crate::names::recognise;
use crate::plausibility::{ImportNotice, notices};
use crate::units::{Unit, Up};

/// What is known of a file beforehand. What is not said is guessed from the body, and
/// [`ImportedMotion`] tells the guess.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ReadOptions {
    /// What one unit of the file is.
    pub unit: Option<Unit>,
    /// Which axis of the file points up.
    pub up: Option<Up>,
    /// Which joint has which name, if the skeleton is none that is known.
    pub mapping: Option<JointMapping>,
    /// Which animation of a glTF to read, by its name, or which motion of an array of several, by its number from 0; the first if not said.
    pub animation: Option<String>,
    /// How many frames of the file are a second, where that is known better than the file says it: of a BVH, or of an array, which says nothing
    /// and is otherwise taken for one of 20. A glTF has times instead of frames.
    pub frames_per_second: Option<f32>,
}

/// A motion from a file, and what was taken for granted.
#[derive(Clone, Debug, PartialEq)]
pub struct ImportedMotion {
    /// The motion, in metres, Y up, at 20 frames a second. It is where and faces where it does in
    /// the file.
    pub motion: Motion,
    /// How fast the joints turn by the file's own rotations, of which the motion keeps nothing but positions; none for arrays. At
    /// 20 frames a second: what turns and turns back in between is not seen.
    ///
    /// A joint that was [`placed`](Self::placed) does not turn, and what the file turns above it counts for the next joint
    /// below.
    pub turning: Option<JointTurning>,
    /// How the file names its joints: a known scheme, or `mapping file`; none for arrays.
    pub scheme: Option<&'static str>,
    /// What one unit of the file is.
    pub unit: Unit,
    /// Which axis of the file points up.
    pub up: Up,
    /// The file's frame rate.
    pub source_frames_per_second: f64,
    /// The file's number of frames.
    pub source_frames: usize,
    /// The number of frames that the file announces, where it has more or fewer.
    pub announced_frames: Option<usize>,
    /// Names of animations in the file that were not read: a glTF may hold several, of which
    /// [`ReadOptions::animation`] chooses.
    pub other_animations: Vec<String>,
    /// Joints that the file lacks, or has in the same place as another. They were placed:
    ///
    /// - spine joints on the line from pelvis to neck through what the file has between them, where they
    ///   are on HumanML3D's body (if that is three joints, these are the spine's);
    /// - the neck on the way from upper spine to head, the head on from the neck;
    /// - collars between upper spine, neck and shoulder;
    /// - feet from the ankle towards the end of the foot, at most as far as the ball of the foot is; without an
    ///   end forward.
    pub placed: Vec<Joint>,
    /// What is strange about the motion, though it may be meant.
    pub notices: Vec<ImportNotice>,
}

/// The longest motion that is read, in seconds: an hour.
const MAX_SECONDS: f64 = 3600.0;

/// The motion of a clip; `path` stands in error messages.
pub(crate) fn import(
    clip: &Clip,
    options: &ReadOptions,
    path: &Path,
) -> Result<ImportedMotion, ReadError> {
    let (scheme, nodes) = match &options.mapping {
        Some(mapping) => {
            let nodes = mapping.nodes(clip).map_err(|reason| ReadError::Mapping {
                path: path.to_owned(),
                reason,
            })?;
            ("mapping file", nodes)
        }
        None => recognise(clip).map_err(|reason| ReadError::Skeleton {
            path: path.to_owned(),
            reason,
        })?,
    };
    let body = Body::new(clip, nodes);
    let rate = options
        .frames_per_second
        .map_or_else(|| whole(clip), f64::from);
    let seconds = (clip.frames - 1) as f64 / rate;
    if seconds > MAX_SECONDS {
        return Err(ReadError::Long {
            path: path.to_owned(),
            seconds,
        });
    }
    let frames = frames_of(seconds);
    let (poses, turns): (Vec<_>, Vec<_>) = (0..frames)
        .map(|frame| {
            let source_frame = frame as f64 / f64::from(FRAMES_PER_SECOND) * rate;
            let placed = clip.placed(source_frame * clip.seconds_per_frame);
            let (positions, turns): (Vec<DVec3>, Vec<DQuat>) = { placed.into_iter() }
                .map(|node| (node.position, node.turn))
                .unzip();
            (body.pose(&positions), body.turns(&turns))
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
        .unwrap_or_else(|| up(&body.pose(&clip.rest_positions()), &poses));
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
        turning: Some(JointTurning::of_local(&turns)),
        scheme: Some(scheme),
        unit,
        up,
        source_frames_per_second: rate,
        source_frames: clip.frames,
        announced_frames: None,
        other_animations: Vec::new(),
        placed: body.placed(),
    })
}

/// How many frames at [`FRAMES_PER_SECOND`] lie within so many seconds, the first included.
pub(crate) fn frames_of(seconds: f64) -> usize {
    // Half a thousandth of a frame: the time of a frame is often cut to a few digits.
    (seconds * f64::from(FRAMES_PER_SECOND) + 5e-4) as usize + 1
}

/// The frame rate, whole if it nearly is: 0.0083333 s a frame are 120 frames a second.
fn whole(clip: &Clip) -> f64 {
    if clip.seconds_per_frame <= 0.0 {
        return f64::from(FRAMES_PER_SECOND);
    }
    let rate = 1.0 / clip.seconds_per_frame;
    match (rate - rate.round()).abs() < 1e-4 * rate {
        true => rate.round(),
        false => rate,
    }
}

/// Which axis points up: the one along which the body stands in the rest pose, unless the whole motion
/// stands along the other. Where the rest pose is no standing body, as in files whose bones all lie along
/// one axis, the motion alone decides.
fn up(rest: &[DVec3; JOINTS], poses: &[[DVec3; JOINTS]]) -> Up {
    let moving = poses.iter().map(standing).sum::<DVec3>() / poses.len() as f64;
    let rest_up = match standing(rest) {
        rest if rest.y > 0.9 => Some(Up::Y),
        rest if rest.z > 0.9 => Some(Up::Z),
        _ => None,
    };
    match rest_up {
        Some(Up::Y) if moving.z > 0.85 => Up::Z,
        Some(Up::Z) if moving.y > 0.85 => Up::Y,
        Some(up) => up,
        None if moving.z > moving.y => Up::Z,
        None => Up::Y,
    }
}

/// The direction of a body's length: from its ankles over the pelvis to its head. Shorter than 1 where it is
/// bent.
fn standing(pose: &[DVec3; JOINTS]) -> DVec3 {
    let at = |joint: Joint| pose[joint.index()];
    let ankles = at(Joint::LeftAnkle).midpoint(at(Joint::RightAnkle));
    let pelvis = at(Joint::Pelvis);
    let legs = (pelvis - ankles).normalize_or_zero();
    let trunk = (at(Joint::Head) - pelvis).normalize_or_zero();
    legs.midpoint(trunk)
}
