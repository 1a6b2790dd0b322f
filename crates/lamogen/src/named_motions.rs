//! The motion files that a request names.

use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use lamogen_files::{ReadError, ReadOptions, read};
use lamogen_guide::{KeyPose, PlaceError};
use lamogen_motion::{BodyError, FRAMES_PER_SECOND, Motion};

use crate::neighbours::pose_on_body;
use crate::request::Request;

/// The motions that a request names: the one that it continues, the one that it leads to, and those with the poses that it takes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NamedMotions {
    /// The motion that the request continues.
    pub after: Option<Motion>,
    /// The motion that the request leads to.
    pub before: Option<Motion>,
    /// The poses that the body takes.
    pub poses: Vec<KeyPose>,
}

/// A pose in a motion file, and the moment at which a body takes it.
///
/// The text form is `seconds=file` for the first frame of a file, or `seconds=file@seconds` for another one:
///
/// ```
/// use lamogen::PoseFile;
///
/// let pose: PoseFile = "1.5=dance.bvh@3.2".parse()?;
/// assert_eq!((pose.seconds, pose.at), (1.5, 3.2));
/// assert_eq!(pose.path.to_str(), Some("dance.bvh"));
/// # Ok::<(), lamogen::PoseFileError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "json", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "json", serde(try_from = "String", into = "String"))]
pub struct PoseFile {
    /// The moment in seconds from the start of the motion.
    pub seconds: f32,
    /// The motion file.
    pub path: PathBuf,
    /// The time of the pose in the file, in seconds.
    pub at: f32,
}

/// Why a text is no [`PoseFile`].
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "expected seconds=file or seconds=file@seconds, such as 1.5=sit.npy or 1.5=dance.bvh@3.2, found {found:?}"
)]
#[allow(missing_docs)]
pub struct PoseFileError {
    pub found: String,
}

/// Why the motions that a request names cannot be had.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)]
pub enum NamedMotionError {
    /// A file cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// A file shows no body.
    #[error("{path}: {reason}")]
    Body { path: PathBuf, reason: BodyError },
    /// A pose is at no valid moment, or has positions that are out of range.
    #[error("{path}: {reason}")]
    Pose { path: PathBuf, reason: PlaceError },
    /// A file has no pose at a moment.
    #[error(
        "{path}: expected a time within the motion, 0 to {length} s, for a pose, found {found} s"
    )]
    PoseTime {
        path: PathBuf,
        length: f32,
        found: f32,
    },
}

impl NamedMotions {
    /// Reads the motions from files.
    ///
    /// # Errors
    ///
    /// If a file cannot be read, shows no body, or has no pose at the given moment.
    pub fn read(
        after: Option<&Path>,
        before: Option<&Path>,
        poses: &[PoseFile],
    ) -> Result<NamedMotions, NamedMotionError> {
        let motion = |path: &Path| -> Result<Motion, NamedMotionError> {
            let motion = read(path, &ReadOptions::default())?.motion;
            match motion.check_body() {
                Ok(()) => Ok(motion),
                Err(reason) => Err(NamedMotionError::Body {
                    path: path.to_owned(),
                    reason,
                }),
            }
        };
        let pose = |pose: &PoseFile| {
            let motion = motion(&pose.path)?;
            let frame = (pose.at * FRAMES_PER_SECOND).round();
            // The end of a motion is its last frame. NaN is no time.
            if !(0.0..=motion.frames() as f32).contains(&frame) {
                return Err(NamedMotionError::PoseTime {
                    path: pose.path.clone(),
                    length: motion.seconds(),
                    found: pose.at,
                });
            }
            let frame = (frame as usize).min(motion.frames() - 1);
            { pose_on_body(&motion, frame).map_err(PlaceError::from) }
                .and_then(|joints| KeyPose::new(pose.seconds, joints))
                .map_err(|reason| NamedMotionError::Pose {
                    path: pose.path.clone(),
                    reason,
                })
        };
        Ok(NamedMotions {
            after: after.map(motion).transpose()?,
            before: before.map(motion).transpose()?,
            poses: poses.iter().map(pose).collect::<Result<_, _>>()?,
        })
    }

    /// Sets the motions on a request, whose places must have been set before.
    pub fn apply(&self, mut request: Request) -> Request {
        if let Some(motion) = &self.after {
            request = request.after(motion);
        }
        if let Some(motion) = &self.before {
            request = request.before(motion);
        }
        self.poses.iter().cloned().fold(request, Request::key_pose)
    }
}

impl FromStr for PoseFile {
    type Err = PoseFileError;

    fn from_str(text: &str) -> Result<Self, PoseFileError> {
        let problem = || PoseFileError { found: text.into() };
        let number = |text: &str| {
            let number = text.trim().parse().ok();
            number.filter(|seconds: &f32| seconds.is_finite() && *seconds >= 0.0)
        };
        let (seconds, file) = text.split_once('=').ok_or_else(problem)?;
        let seconds = number(seconds).ok_or_else(problem)?;
        // A file may have an @ in its name.
        let at = { file.rsplit_once('@') }.and_then(|(file, at)| Some((file, number(at)?)));
        let (file, at) = at.unwrap_or((file, 0.0));
        match file.trim().is_empty() {
            true => Err(problem()),
            false => Ok(PoseFile {
                seconds,
                path: file.into(),
                at,
            }),
        }
    }
}

impl fmt::Display for PoseFile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}={}@{}", self.seconds, self.path.display(), self.at)
    }
}

impl From<PoseFile> for String {
    fn from(pose: PoseFile) -> String {
        pose.to_string()
    }
}

impl TryFrom<String> for PoseFile {
    type Error = PoseFileError;

    fn try_from(text: String) -> Result<Self, PoseFileError> {
        text.parse()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_name_a_moment_a_file_and_a_time_in_it() {
        for (text, seconds, path, at) in [
            ("1.5=sit.npy", 1.5, "sit.npy", 0.0),
            ("0 = a@b.bvh@2", 0.0, " a@b.bvh", 2.0),
            ("2=you@home.glb", 2.0, "you@home.glb", 0.0),
            ("1=a=b.npy@0.5", 1.0, "a=b.npy", 0.5),
        ] {
            let pose: PoseFile = text.parse().unwrap();
            let expected = PoseFile {
                seconds,
                path: path.into(),
                at,
            };
            assert_eq!(pose, expected);
            assert_eq!(pose.to_string().parse(), Ok(expected));
        }
        for text in [
            "",
            "sit.npy",
            "=sit.npy",
            "x=sit.npy",
            "-1=sit.npy",
            "inf=a",
            "1=",
            "1=@2",
        ] {
            let message = text.parse::<PoseFile>().unwrap_err().to_string();
            assert!(message.contains("1.5=sit.npy") && message.contains(&format!("{text:?}")));
        }
    }
}
